"""A small linear drawing with everything that signatures are of: a core, a coil round it, a magnet, a Hall element."""

SMALL = """
schema = 2
name = "small"
[materials.iron]
relative_permeability = 500
[materials.hard]
remanence_T = 1.2
relative_permeability = 1.05
[fixed.regions.core]
material = "iron"
r_mm = [0, 5]
z_mm = [-10, 0]
[coils.coil]
r_mm = [6, 9]
z_mm = [-9, -1]
turns = 100
resistance_ohm = 2
[moving.regions.magnet]
material = "hard"
magnetization = "+z"
r_mm = [0, 4]
z_mm = [0, 4]
[sensors.hall]
kind = "hall"
r_mm = 0
z_mm = 1
[mechanics]
mass_g = 2
[supply]
voltage_min_V = 0
voltage_max_V = 5
[sweep]
current_A = [0, 0.5, 1]
distance_mm = { start = 4, stop = 12, step = 1 }
[tolerances]
length_mm = 0.03
"fixed.regions.core.r_mm[1]" = 0.01
"materials.iron.relative_permeability" = 50
"""

SLEEVED = (
    SMALL.partition("[sensors.hall]")[0]
    .replace('"small"', '"sleeved"')
    .replace(
        "r_mm = [0, 5]\nz_mm = [-10, 0]\n",
        "polygon_mm = [[0, -10], [9, -10], [9, -9], [5, -9], [5, -1], [9, -1], [9, 0], [0, 0]]\n"
        '[fixed.regions.sleeve]\nmaterial = "iron"\nr_mm = [5, 6]\nz_mm = [-9, -1]\n',
    )
    + """[mechanics]
mass_g = 2
[supply]
voltage_min_V = 0
voltage_max_V = 0.5
[sweep]
current_A = [0, 0.5, 1]
distance_mm = [4, 5, 6, 8, 10]
"""
)
"""A drawing without sensor whose sleeve has no face in the open air: between core and winding."""
