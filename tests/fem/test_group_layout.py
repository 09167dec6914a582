"""The layer round the moving part is as wide as its group of distances has room for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from femfit.actuator.load import read_actuator
from femfit.fem.drawing import build_mesh
from femfit.fem.layout import layout_of, layout_of_group, stretch_groups
from femfit.fem.settings import SolverSettings
from support.field import prepared

SETTINGS = SolverSettings(order=4)
NARROW, FAR = 1e-4, 8e-3


def swept_over(distances):
    actuator = read_actuator(Path(__file__).parents[2] / "geometry" / "biased-electromagnet.toml")
    return replace(actuator, hall=None, sweep=replace(actuator.sweep, distances_m=tuple(distances)))


def test_a_narrow_gap_costs_nothing_where_the_gap_is_wide():
    actuator = swept_over([NARROW, FAR])
    thin = build_mesh(actuator, FAR, layout_of(actuator, SETTINGS), SETTINGS)
    assert prepared(actuator, FAR, SETTINGS).mesh.ne < 0.1 * thin.ne


def test_the_width_of_the_layer_does_not_matter_to_the_force():
    moderate = swept_over([2e-3, FAR])
    near, alone = (prepared(a, FAR, SETTINGS).rows(FAR, a.sweep.currents_A) for a in (moderate, swept_over([FAR])))
    np.testing.assert_allclose(near["force_N"], alone["force_N"], rtol=1e-9)  # the same mesh, solved twice
    finer = prepared(swept_over([FAR]), FAR, SolverSettings(order=6, corner_fraction=0.03))
    reference = finer.rows(FAR, moderate.sweep.currents_A)
    off = np.abs(np.subtract(near["force_N"], reference["force_N"]))
    assert np.all(off <= np.array(near["force_error_N"]))  # the estimate covers the error


@pytest.mark.parametrize("count", [12, 40])
def test_no_group_is_stretched_beyond_the_limit(count):
    actuator = swept_over(np.geomspace(NARROW, FAR, count))
    layout = layout_of(actuator, SETTINGS)
    for group in stretch_groups(actuator.sweep.distances_m, layout, SETTINGS):
        own = layout_of_group(actuator, group, layout, SETTINGS)
        near, far = (d - own.fixed_top - own.outer_offset for d in (group[0], group[-1]))
        assert near > 0.0
        assert far / near <= SETTINGS.stretch_limit * (1.0 + 1e-9)
        assert own.outer_offset >= layout.outer_offset
