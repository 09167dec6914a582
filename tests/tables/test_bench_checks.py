"""What cannot be right in a bench table is set aside and said; what is physics is left alone."""

import numpy as np
import pandas as pd
import pytest

from femfit.tables.measurement import branch_from_order
from femfit.tables.measurement_file import read_bench_table
from femfit.tables.outliers import isolated_outliers, without_outliers

DISTANCES, CURRENTS = np.linspace(0.016, 0.044, 10), np.linspace(0.0, 1.4, 8)
NOISE = 4e-4


def curve(d, i):
    """The force of the drawing, in N."""
    return 4.2e-9 / d**4 + 0.29 * np.exp(-d / 0.0166) * i


def bench(runs=3, seed=0, step=1e-5):
    """A sweep of a force that rises steeply towards the electromagnet, up and down in current at each distance."""
    generator = np.random.default_rng(seed)
    d, i = (x.ravel() for x in np.meshgrid(DISTANCES, [*CURRENTS, *CURRENTS[::-1]], indexing="ij"))
    branch, force = np.tile(np.repeat([1, -1], len(CURRENTS)), len(DISTANCES)), curve(d, i)
    columns = {"order": np.arange(len(d)), "current_A": i, "distance_m": d, "branch": branch}
    pieces = []
    for run in range(runs):
        reading = force * (1.0 + 0.002 * run) + NOISE * generator.standard_normal(len(d))
        pieces.append(pd.DataFrame({"run": run + 1, **columns, "force_N": np.round(reading / step) * step}))
    return pd.concat(pieces, ignore_index=True)


def read(path, rows):
    rows.to_csv(path / "bench.csv", index=False)
    return read_bench_table(path / "bench.csv")


def codes(table):
    return [one.code for one in table.findings]


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("step", [1e-9, 1e-5, 1e-3])
def test_a_clean_bench_is_left_alone(tmp_path, runs, step):
    rows = bench(runs, step=step)
    table = read(tmp_path, rows)
    assert table.findings == ()
    assert table.rows["force_N"].to_numpy() == pytest.approx(rows["force_N"].to_numpy())


def judged(table, share=1.0):
    """A table without the outliers from a model that has so much of the force."""
    predicted = share * curve(table.rows["distance_m"].to_numpy(), table.rows["current_A"].to_numpy())
    return without_outliers(table, {"force_N": predicted})


@pytest.mark.parametrize("share", [1.0, 0.75, 0.0])
def test_lone_outliers_are_set_aside_and_said(tmp_path, share):
    rows = bench()
    for row, wrong in ((37, 0.5), (205, -0.2), (400, 0.05)):  # 1250, 500 and 125 times the noise
        rows.loc[row, "force_N"] += wrong
    table = judged(read(tmp_path, rows), share)
    assert np.flatnonzero(table.rows["force_N"].isna()).tolist() == [37, 205, 400]
    (finding,) = table.findings
    assert (finding.code, finding.column) == ("outliers", "force_N")
    assert "order 37" in str(finding)


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize(
    "effect",
    [
        lambda r: 0.05 * (r["distance_m"] < 0.0165),  # a stop that is touched at one distance only
        lambda r: -0.03 * (r["current_A"] > 1.3) * (r["distance_m"] < 0.0165),  # a corner that saturates
        lambda r: 0.01 * r["branch"],  # hysteresis
        lambda r: 0.02 * (r["run"] == 2),  # one run off
        lambda r: 0.05 * (r["order"] > 80),  # something slipped during the run
        lambda r: 0.03 * np.sin(r["distance_m"] / 5e-4),  # a stage's periodic error
        lambda r: 0.2 * np.random.default_rng(1).standard_t(2, len(r)) * NOISE,  # heavy tails
    ],
)
def test_an_effect_however_sharp_is_no_outlier(tmp_path, runs, effect):
    rows = bench(runs)
    table = judged(read(tmp_path, rows.assign(force_N=rows["force_N"] + effect(rows))))
    assert table.rows["force_N"].notna().all()
    assert table.findings == ()


@pytest.mark.parametrize("share", [1.0, 0.0])
@pytest.mark.parametrize("runs", [1, 2])
@pytest.mark.parametrize("factor", [1.06, 1.3])
def test_the_steep_end_of_a_smooth_curve_is_no_outlier(tmp_path, share, runs, factor):
    d = np.tile(0.008 * factor ** np.arange(20), runs)  # towards the pole
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(d))
    rows = pd.DataFrame({"run": np.repeat(range(runs), 20), "current_A": 0.5, "distance_m": d})
    table = judged(read(tmp_path, rows.assign(force_N=curve(d, 0.5) + noise)), share)
    assert table.rows["force_N"].notna().all()


@pytest.mark.parametrize("slip", [-1.0, 0.4, 2.5])
def test_a_slip_of_sign_or_digit_at_the_end_of_a_range_is_an_outlier(tmp_path, slip):
    d = 0.012 * 1.06 ** np.arange(20)
    rows = pd.DataFrame({"current_A": 0.5, "distance_m": d, "force_N": curve(d, 0.5)})
    rows["force_N"] += 1e-5 * np.random.default_rng(1).standard_normal(len(rows))
    rows.loc[0, "force_N"] *= slip
    assert np.flatnonzero(judged(read(tmp_path, rows)).rows["force_N"].isna()).tolist() == [0]


@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_a_right_reading_at_the_corner_of_the_range_is_no_outlier(tmp_path, seed, shuffled):
    generator = np.random.default_rng(seed)
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.003, 0.011, 6), [-1.2, -0.4, 0.4, 1.2, 2.0]))
    force = 2.5e-6 * i**2 / (d + 1e-4) ** 2 + 3e-4 * generator.standard_normal(len(d))
    rows = pd.DataFrame({"current_A": i, "distance_m": d, "force_N": force})
    table = read(tmp_path, rows.sample(frac=1.0, random_state=seed) if shuffled else rows)
    model = 2.5e-6 * table.rows["current_A"].to_numpy() ** 2 / table.rows["distance_m"].to_numpy() ** 2
    assert without_outliers(table, {"force_N": model}).rows["force_N"].notna().all()


def hovering(*weights, runs=1):
    """The weight of a body, at the current that holds it."""
    d, force = np.tile(np.linspace(0.018, 0.03, 12), len(weights)), np.repeat(weights, 12)
    rows = pd.DataFrame({"current_A": 0.2 + 30.0 * (d - 0.018) + force, "distance_m": d, "force_N": force})
    return pd.concat([rows.assign(run=run + 1) for run in range(runs)])


def computed():
    """A force that is zero without a current."""
    rows = bench(1)[["current_A", "distance_m"]].drop_duplicates().sort_values(["current_A", "distance_m"])
    return rows.assign(force_N=1e-5 * rows["current_A"] ** 2 / rows["distance_m"] ** 2)


@pytest.mark.parametrize(
    ("rows", "others"),
    [
        (hovering(0.35), {"one-current"}),
        (hovering(0.35, 0.42, 0.35), set()),
        (hovering(0.35, 0.42, runs=3), set()),
        # a balance that shows 0.00 N beyond 30 mm in every run
        (bench().assign(force_N=lambda r: np.where(r["distance_m"] > 0.03, 0.0, r["force_N"]).round(2)), set()),
        (computed(), set()),
        (bench().assign(voltage_V=lambda r: np.where(r["distance_m"] > 0.03, 12.0, 6.0)), set()),
    ],
    ids=["one weight", "weights", "weights in runs", "coarse", "computed", "commanded"],
)
def test_what_stays_the_same_as_physics_or_a_display_has_it_is_no_stuck_channel(tmp_path, rows, others):
    table = read(tmp_path, rows)
    assert table.rows["force_N"].notna().all()
    assert set(codes(table)) <= others


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("count", [7, 8, 20])
def test_a_channel_with_noise_is_stuck_from_eight_equal_readings_on(tmp_path, runs, count):
    rows = bench(runs, step=1e-9)
    rows.loc[50 : 50 + count - 1, "force_N"] = rows.loc[50, "force_N"]
    rows.loc[50 : 50 + count - 1, "current_A"] += 0.3  # which is never off there
    table = read(tmp_path, rows)
    lost = list(range(50, 50 + count)) if count >= 8 else []
    assert np.flatnonzero(table.rows["force_N"].isna()).tolist() == lost
    assert [(one.code, one.column) for one in table.findings] == [("stuck", "force_N")] * bool(lost)
    assert all(f"{count} rows" in str(one) for one in table.findings)


def displayed():
    """A pass over nine settings as a coarse display shows it."""
    d, i = np.repeat([2.0, 4.0, 6.0], 3), np.tile([1.0, 2.0, 3.0], 3)
    return pd.DataFrame({"distance_mm": d, "current_A": i, "force_N": np.round(2.0 * i**2 / d, 1)})


ONCE, NOISY = bench(1), bench(1)[["distance_m", "current_A", "force_N"]]


@pytest.mark.parametrize(
    ("rows", "count", "copies"),
    [
        (pd.concat([ONCE, ONCE[:50]]), len(ONCE), "50"),
        (pd.concat([ONCE, ONCE[:1]]).drop(columns=["order"]).round(12), len(ONCE) + 1, ""),  # by chance
        (pd.concat([NOISY, NOISY]), len(NOISY), str(len(NOISY))),
        (pd.concat([NOISY, bench(1, seed=1)[[*NOISY]]]), 2 * len(NOISY), ""),
        (pd.concat([displayed(), displayed()]), 18, ""),
    ],
    ids=["with an order", "one row", "the whole", "another pass", "coarse display"],
)
def test_rows_that_were_pasted_twice_count_once_and_equal_readings_as_often_as_they_were_taken(
    tmp_path, rows, count, copies
):
    table = read(tmp_path, rows)
    assert len(table.rows) == count
    assert [copies in str(one) for one in table.findings if one.code == "copies"] == [True] * bool(copies)


def test_runs_without_a_column_are_told_apart(tmp_path):
    table = read(tmp_path, bench(3).drop(columns=["run"]))
    assert table.rows["run"].unique().tolist() == [1.0, 2.0, 3.0]
    assert "2 times" in str(table.findings[0])


def test_a_clock_that_was_reset_is_told_and_a_sorted_file_put_back(tmp_path):
    rows = bench(1)
    clock = 0.7 * rows["order"] + 0.013
    clock[60:] -= 30.0
    table = read(tmp_path, rows.assign(order=clock))
    assert codes(table)[0] == "order"
    assert "run 1" in str(table.findings[0])
    assert table.rows["distance_m"].to_numpy() == pytest.approx(rows["distance_m"].to_numpy())
    assert table.rows["order"].tolist() == list(range(len(rows)))
    rows = bench(2)
    table = read(tmp_path, rows.sort_values(["run", "current_A", "distance_m"], kind="stable"))
    assert table.findings == ()
    assert table.rows["force_N"].to_numpy() == pytest.approx(rows["force_N"].to_numpy())


@pytest.mark.parametrize("column", ["current_A", "force_N"])
@pytest.mark.parametrize("code", ["9.9E37", "+9.91E+37", "-9.9e+37", "1e37"])
def test_an_instruments_code_of_an_overload_counts_as_a_missing_number(tmp_path, column, code):
    k = np.arange(20)
    rows = pd.DataFrame({"distance_m": 0.01 * (1 + k % 5), "current_A": k, "force_N": 1 + k}).astype(str)
    rows.loc[[3, 11], column] = code
    table = read(tmp_path, rows)
    assert np.flatnonzero(table.rows[column].isna()).tolist() == [3, 11]
    (said,) = [one for one in table.findings if one.code == "cells" and one.column == column]
    assert f"In {column} 2 cells hold no number below 1e+37, as of an overload" in str(said)


@pytest.mark.parametrize("value", [1e308, -1e200, 1e90])
def test_a_cell_with_an_absurd_number_costs_none_of_its_neighbours(tmp_path, value):
    rows = bench(1, step=1e-9)
    rows.loc[44, "force_N"] = value
    assert np.flatnonzero(judged(read(tmp_path, rows)).rows["force_N"].isna()).tolist() == [44]


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


def test_what_two_runs_of_four_show_at_a_setting_is_no_outlier():
    i, j, run = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 8), np.linspace(0, 1, 6), range(4)))
    value = np.random.default_rng(3).normal(size=192)
    here = np.flatnonzero((i == i[80]) & (j == j[80]))
    for off, found in ((here[run[here] >= 2], []), (here[run[here] == 2], here[run[here] == 2])):
        read = value + 30.0 * np.isin(np.arange(192), off)
        outliers = isolated_outliers(read, np.column_stack([i, j, 0 * i]), run, np.ones(192))
        assert np.flatnonzero(outliers).tolist() == list(found)
