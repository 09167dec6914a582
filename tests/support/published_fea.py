"""Finite-element results that others printed, and the same devices drawn in schema 2.

The Modelica Standard Library (Modelica Association, Magnetic.FluxTubes) prints stationary finite-element results beside
its lumped networks: for a lifting magnet in Examples.SolenoidActuator.ComparisonQuasiStatic, for a moving coil in
Examples.MovingCoilActuator, ForceStrokeBehaviour and ForceCurrentBehaviour. Program, mesh and boundary are not stated.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from femfit.device.load import read_actuator
from femfit.field.layout import layout_of
from femfit.field.point_rows import swept_currents
from femfit.field.problem import prepare
from femfit.field.tolerance import settings_for
from support.field import prepared

DRAWINGS = Path(__file__).with_name("published")

LIFTING_MAGNET = {
    0.25: (85.8619, 0.11954),
    0.5: (59.9662, 0.11004),
    1.0: (28.88, 0.088425),
    2.0: (11.1188, 0.064492),
    3.0: (6.5591, 0.052733),
    5.0: (3.5869, 0.039467),
}
"""Gap in mm -> pull in N and static inductance in H at 12 V over 10 ohm."""

MOVING_COIL = {-20.0: (-9.05337, 6.38e-3), -16.0: (-9.65616, 4.86e-3), -12.0: (-9.07503, 3.32e-3)}
"""Distance of the drawing in mm -> force in N at -3 A and inductance in H, with iron of a permeability of 1000."""

MOVING_COIL_ATTRACTED = 13.07415
"""Force in N at 3 A in the middle."""


@cache
def solved(name, distance_mm):
    """Columns of a drawing's sweep at a distance, as arrays."""
    actuator = read_actuator(DRAWINGS / f"{name}.toml")
    settings, distance = settings_for(actuator), 1e-3 * distance_mm
    problem = prepare(actuator, (distance,), layout_of(actuator, settings), settings)
    rows = problem.rows(distance, swept_currents(actuator.sweep))
    return {name: np.array(values) for name, values in rows.items()}


def lifting_magnet(gap_mm):
    """Pull in N and static inductance in H."""
    rows = solved("lifting-magnet", gap_mm)
    return float(rows["force_N"][0]), float(rows["flux_linkage_Wb"][0] / 1.2)


def moving_coil(distance_mm):
    """Force in N at -3 A and at 3 A, and inductance in H."""
    rows = solved("moving-coil", distance_mm)
    return float(rows["force_N"][0]), float(rows["force_N"][2]), float(rows["inductance_H"][1])


def reluctance_force():
    """Of a moving coil in its middle what is even in the current, i^2 dL/dx in N at 3 A: 3.4 N beside 11.4 N."""
    repelled, attracted, _ = moving_coil(-16.0)
    return repelled + attracted


def moving_coil_of_height(height):
    """Force in N at -3 A in the middle of a coil of another height in m, which the source leaves open."""
    drawn = read_actuator(DRAWINGS / "moving-coil.toml")
    (coil,) = drawn.coils
    corners = tuple((r, height if z > 0.0 else 0.0) for r, z in coil.vertices_m)
    distance = -0.010 - 0.5 * height
    sweep = replace(drawn.sweep, distances_m=(distance,))
    other = replace(drawn, coils=(replace(coil, vertices_m=corners),), sweep=sweep, tolerance=None)
    sources = np.array([1.0, -3.0])
    return float(sources @ prepared(other, distance).solve(distance).force @ sources)
