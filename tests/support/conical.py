"""A push solenoid with a conical pole, whose rim and cone are turned in one setting; its steel does not saturate."""

CONICAL = """
schema = 2
name = "conical"
[materials.iron]
relative_permeability = 2000
[fixed.regions.frame]
material = "iron"
polygon_mm = [[1.6, -10], [16, -10], [16, 34], [6.3, 34], [6.3, 30], [14, 30], [14, -6], [8, -6],
  # turned in one setting
  [8, 5], [6, 5], [1.6, 0.1111]]
[coils.winding]
r_mm = [8.5, 13.5]
z_mm = [-5, 29]
turns = 1800
resistance_ohm = 43
[moving.regions.plunger]
material = "iron"
polygon_mm = [[0, 0], [1.5, 0], [6, 5], [6, 44], [0, 44]]
[mechanics]
mass_g = 40
gravity = "horizontal"
[supply]
voltage_min_V = 0
voltage_max_V = 24
[sweep]
current_A = [0.15, 0.25, 0.3]
distance_mm = [0.4, 0.47, 0.55, 0.65, 0.78, 0.95, 1.15, 1.4, 1.8, 2.3, 3, 4]
[solver]
tolerance = 5e-3
"""


def moved(change):
    """The drawing of a device whose pole, rim and cone, stands by so many mm elsewhere along z."""
    corners = "[8, 5], [6, 5], [1.6, 0.1111]"
    assert corners in CONICAL
    return CONICAL.replace(corners, f"[8, {5 + change:g}], [6, {5 + change:g}], [1.6, {0.1111 + change:.4f}]")


def at_distances(text, distances):
    """A drawing swept at other distances in mm, as the file has them."""
    before, _, after = text.partition("distance_mm = ")
    return f"{before}distance_mm = {distances}\n{after.partition(chr(10))[2]}"
