"""Rising and falling current are told apart by the order of measuring, and only where the currents were cycled."""

import numpy as np
import pandas as pd
import pytest

from femfit.tables.measurement_checks import branch_from_order
from femfit.tables.measurement_file import read_bench_table

UP = np.linspace(0.0, 1.4, 6)


def table(current, distance=0.02, run=1.0):
    return pd.DataFrame({"run": run, "distance_m": distance, "current_A": current})


def test_a_cycle_rises_to_its_turning_point_and_falls_after_it():
    cycle = [*UP, *UP[-2::-1]]
    branch, said = branch_from_order(pd.concat([table(cycle), table(cycle, 0.03)], ignore_index=True))
    assert branch.tolist() == 2 * [*6 * [1.0], *5 * [-1.0]]
    assert "order of the rows" in str(said[0])


def test_a_turning_point_that_is_read_twice_and_an_ammeters_noise_are_no_steps():
    cycle = np.array([*UP, *UP[::-1]]) + 1e-4 * np.tile([1.0, -1.0, 0.5], 4)
    branch, _ = branch_from_order(table(cycle))
    assert branch.tolist() == [*7 * [1.0], *5 * [-1.0]]


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


def test_a_file_without_a_branch_gets_it_and_says_so_and_a_given_one_stays(tmp_path):
    cycle = [*UP, *UP[-2::-1]]
    rows = "".join(f"1,{i},0.02,{k}\n" for k, i in enumerate(cycle))
    (tmp_path / "a.csv").write_text("run,current_A,distance_m,force_N\n" + rows)
    read = read_bench_table(tmp_path / "a.csv")
    assert read.rows["branch"].tolist() == [*6 * [1.0], *5 * [-1.0]]
    assert any("no column branch" in str(said) for said in read.findings)
    given = "run,branch,current_A,distance_m,force_N\n" + "".join(f"1,1,{i},0.02,{k}\n" for k, i in enumerate(cycle))
    (tmp_path / "b.csv").write_text(given)
    read = read_bench_table(tmp_path / "b.csv")
    assert set(read.rows["branch"]) == {1.0}
    assert not any("no column branch" in str(said) for said in read.findings)
