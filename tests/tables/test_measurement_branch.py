"""Rising and falling current are told apart by the order of measuring, and only where the currents were cycled."""

import numpy as np
import pandas as pd
import pytest

from femfit.tables.measurement_checks import branch_from_order

UP = np.linspace(0.0, 1.4, 6)
CYCLE = [*UP, *UP[-2::-1]]


def table(current, distance=0.02, run=1.0):
    return pd.DataFrame({"run": run, "distance_m": distance, "current_A": current})


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (pd.concat([table(CYCLE), table(CYCLE, 0.03)], ignore_index=True), 2 * [*6 * [1.0], *5 * [-1.0]]),
        # a turning point that is read twice, and an ammeter's noise
        (table(np.array([*UP, *UP[::-1]]) + 1e-4 * np.tile([1.0, -1.0, 0.5], 4)), [*7 * [1.0], *5 * [-1.0]]),
    ],
)
def test_a_cycle_rises_to_its_turning_point_and_falls_after_it(rows, expected):
    branch, (finding,) = branch_from_order(rows)
    assert branch.tolist() == expected
    assert (finding.code, finding.column) == ("branch-assumed", "branch")


@pytest.mark.parametrize(
    "rows",
    [
        table(np.tile(UP, 4), np.repeat([0.02, 0.03, 0.04, 0.05], 6)),  # sorted: every distance begins anew
        table(np.repeat(UP, 6), np.tile(np.linspace(0.02, 0.03, 6), 6)),  # distances within currents
        table(np.random.default_rng(1).permutation(np.tile(UP, 6))),  # in random order
        table(np.full(9, 0.7)),
        table(np.full(9, np.nan)),
    ],
)
def test_currents_that_were_not_cycled_tell_no_branch(rows):
    assert branch_from_order(rows) == (None, [])
