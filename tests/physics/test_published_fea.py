"""The force of a moving coil beside finite elements that others printed; the validation page has the other cases."""

import dataclasses

import numpy as np
import pytest

from femfit.device.load import read_actuator
from support.field import prepared
from support.published_fea import DRAWINGS, MOVING_COIL, MOVING_COIL_ATTRACTED, moving_coil


def test_a_moving_coils_reluctance_force_is_that_of_other_finite_elements():
    # The part that is even in the current, half of i^2 dL/dx: 1.7 N beside 11.4 N.
    repelled, attracted, _ = moving_coil(-16.0)
    assert repelled + attracted == pytest.approx(MOVING_COIL[-16.0][0] + MOVING_COIL_ATTRACTED, rel=1.5e-2)
    assert attracted == pytest.approx(MOVING_COIL_ATTRACTED, rel=5e-3)


@pytest.mark.parametrize("height", [8e-3, 14e-3])
def test_the_height_of_the_coil_that_the_source_leaves_open_moves_its_middle_force_by_one_per_cent(height):
    drawn = read_actuator(DRAWINGS / "moving-coil.toml")
    (coil,) = drawn.coils
    corners = [(r, height if z > 0.0 else 0.0) for r, z in coil.vertices_m]
    distance = -0.010 - 0.5 * height
    sweep = dataclasses.replace(drawn.sweep, distances_m=(distance,))
    other = dataclasses.replace(
        drawn, coils=(dataclasses.replace(coil, vertices_m=tuple(corners)),), sweep=sweep, tolerance=None
    )
    force = prepared(other, distance).solve(distance).force
    sources = np.array([1.0, -3.0])
    assert sources @ force @ sources == pytest.approx(MOVING_COIL[-16.0][0], rel=1.5e-2)
