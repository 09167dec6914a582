"""A Hall element's output is clipped where its field is too strong, and the sentence says where that begins."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.device.electrics import HallElement, where_clipped
from femfit.device.load import read_actuator
from femfit.device.rewrite import only
from femfit.field.sweep_rows import clipped_hall
from femfit.tables.sweep_table import SweepTable
from support.actuators import GEOMETRY
from support.expected import unmentioned

HALL = HallElement(0.0, 0.0)  # 50 V/T about 2.5 V, clipped at 0 and 5 V: beyond 50 mT on either side


DISTANCE, CURRENT = (x.ravel() for x in np.meshgrid(1e-3 * np.arange(1, 11), [0.0, 0.5, 1.0]))
FIELD = 0.07 - 10.0 * DISTANCE + 0.02 * CURRENT  # 60 mT of the magnet at 1 mm, 10 mT less a millimetre; the coil's


@pytest.mark.parametrize(
    ("sensitivity", "factor", "facts"),
    [
        (50.0, 1.0, ["5 V", "1.00 to 2.00 mm", "at 0 A", "1.00 to 4.00 mm", "at 1.0 A"]),
        (50.0, -1.0, ["0 V", "1.00 to 2.00 mm"]),
        (5.0, 1.0, []),
        (50.0, np.nan, []),  # points that failed are not clipped
    ],
)
def test_clipping_is_said_at_the_smallest_current_and_at_the_one_that_reaches_farthest(sensitivity, factor, facts):
    said = where_clipped(replace(HALL, sensitivity_V_per_T=sensitivity), DISTANCE, CURRENT, factor * FIELD)
    assert not unmentioned(facts, said)
    assert bool(said) == bool(facts)


def test_a_sweep_says_where_its_element_is_clipped():
    rows = pd.DataFrame({"distance_m": DISTANCE, "current_A": CURRENT, "hall_T": FIELD})
    table = SweepTable(rows.assign(force_N=1.0, status="ok"), {})
    actuator = replace(read_actuator(GEOMETRY / "emaws-rig.toml"), sensors=(HALL,))
    (said,) = clipped_hall(only(actuator), table)
    assert where_clipped(HALL, DISTANCE, CURRENT, FIELD) in said
    assert clipped_hall(only(replace(actuator, sensors=())), table) == []
