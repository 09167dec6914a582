"""A pot of solid iron with a magnet beneath its disc: everything that induces currents, on few elements.

The same with two windings side by side in place of its one.
"""

POT = """
schema = 2
name = "eddy-pot"

[materials.iron]
relative_permeability = 200
conductivity_MS_per_m = 5

[materials.ring_magnet]
relative_permeability = 1.05
remanence_T = 0.5

[fixed.regions.pot]
material = "iron"
polygon_mm = [[0, -12], [12, -12], [12, 0], [9.5, 0], [9.5, -9], [5, -9], [5, 0], [0, 0]]

[coils.winding]
r_mm = [5.5, 9]
z_mm = [-8.5, -2]
turns = 200
resistance_ohm = 5

[moving.regions.disc]
material = "iron"
r_mm = [0, 12]
z_mm = [0, 3]

[moving.regions.magnet]
material = "ring_magnet"
magnetization = "+z"
r_mm = [0, 4]
z_mm = [3, 5]

[mechanics]
mass_g = 20
gravity = "horizontal"

[sensors.hall]
kind = "hall"
r_mm = 7.2
z_mm = -1
direction = "r"

[supply]
voltage_min_V = -12
voltage_max_V = 12
sample_time_ms = 0.2

[sweep]
current_A = [-1, 0, 1]
distance_mm = [1, 1.5, 2, 2.5]

[solver]
frequency_Hz = { start = 10, stop = 1000, per_decade = 2 }
eddy_error = 0.02
"""

_WINDING = """[coils.winding]
r_mm = [5.5, 9]
z_mm = [-8.5, -2]
turns = 200
resistance_ohm = 5
"""

_COILS = """[coils.inner]
r_mm = [5.5, 7]
z_mm = [-8.5, -2]
turns = 120
resistance_ohm = 3

[coils.outer]
r_mm = [7.2, 9]
z_mm = [-8.5, -2]
turns = 80
resistance_ohm = 2
"""

_CIRCUIT = """
[circuits.{name}]
coils = [{coils}]
voltage_min_V = -12
voltage_max_V = 12
"""


def _wound(**circuits):
    """The pot whose circuits have these coils."""
    more = "".join(_CIRCUIT.format(name=name, coils=coils) for name, coils in circuits.items())
    return POT.replace(_WINDING, _COILS + more)


TWO_WINDINGS = _wound(inner='"inner"', outer='"outer"').replace(
    "current_A = [-1, 0, 1]", "current_A = { inner = [-1, 1], outer = [-1, 1] }"
)
IN_SERIES = _wound(both='"inner", "outer"')
