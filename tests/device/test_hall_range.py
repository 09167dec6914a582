"""A Hall element's output is clipped where its field is too strong, and the sentence says where that begins."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.device.electrics import HallElement, where_clipped
from femfit.device.rewrite import only, read_variants
from femfit.field.sweep_rows import clipped_hall
from femfit.tables.sweep_table import SweepTable
from support.actuators import GEOMETRY
from support.expected import unmentioned

HALL = HallElement(0.0, 0.0)  # 50 V/T about 2.5 V, clipped at 0 and 5 V: beyond 50 mT on either side


@pytest.fixture
def grid():
    """60 mT of the magnet at 1 mm, 10 mT less a millimetre; 20 mT/A of the coil."""
    distance, current = (x.ravel() for x in np.meshgrid(1e-3 * np.arange(1, 11), [0.0, 0.5, 1.0]))
    return distance, current, 0.07 - 10.0 * distance + 0.02 * current


def test_clipping_is_said_at_the_smallest_current_and_at_the_one_that_reaches_farthest(grid):
    facts = ["5 V", "1.00 to 2.00 mm", "at 0 A", "1.00 to 4.00 mm", "at 1.0 A"]
    assert not unmentioned(facts, where_clipped(HALL, *grid))


def test_the_lower_end_clips_too_and_a_wide_range_never(grid):
    distance, current, field = grid
    assert not unmentioned(["0 V", "1.00 to 2.00 mm"], where_clipped(HALL, distance, current, -field))
    assert where_clipped(replace(HALL, sensitivity_V_per_T=5.0), *grid) == ""


def test_a_point_that_failed_is_not_clipped(grid):
    distance, current, field = grid
    assert where_clipped(HALL, distance, current, np.full_like(field, np.nan)) == ""


def test_a_sweep_says_where_its_element_is_clipped(grid):
    names = ("distance_m", "current_A", "hall_T")
    table = SweepTable(pd.DataFrame(dict(zip(names, grid, strict=True))).assign(force_N=1.0, status="ok"), {})
    sweep = read_variants(GEOMETRY / "emaws-rig.toml")
    assert sweep.actuator.hall is not None
    actuator = replace(sweep.actuator, sensors=(HALL,))
    (said,) = clipped_hall(only(actuator), table)
    assert where_clipped(HALL, *grid) in said
    assert clipped_hall(only(replace(actuator, sensors=())), table) == []
