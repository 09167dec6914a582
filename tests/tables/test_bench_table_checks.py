"""What cannot be right in a bench table is set aside with a sentence; what is physics is left alone."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.measurement_checks import without_outliers
from femfit.tables.measurement_file import read_bench_table

DISTANCES, CURRENTS = np.linspace(0.016, 0.044, 10), np.linspace(0.0, 1.4, 8)
NOISE = 4e-4


def bench(runs=3, seed=0, step=1e-5):
    """A sweep of a force that rises steeply towards the electromagnet, up and down in current at each distance."""
    generator = np.random.default_rng(seed)
    cycle = np.concatenate([CURRENTS, CURRENTS[::-1]])
    branch = np.repeat([1, -1], len(CURRENTS))
    d, i = (x.ravel() for x in np.meshgrid(DISTANCES, cycle, indexing="ij"))
    force = 4.2e-9 / d**4 + 0.29 * np.exp(-d / 0.0166) * i
    pieces = []
    for run in range(runs):
        reading = force * (1.0 + 0.002 * run) + NOISE * generator.standard_normal(len(d))
        pieces.append(
            pd.DataFrame(
                {
                    "run": run + 1,
                    "order": np.arange(len(d)),
                    "current_A": i,
                    "distance_m": d,
                    "branch": np.tile(branch, len(DISTANCES)),
                    "force_N": np.round(reading / step) * step,
                }
            )
        )
    return pd.concat(pieces, ignore_index=True)


def read(path, rows):
    rows.to_csv(path / "bench.csv", index=False)
    return read_bench_table(path / "bench.csv")


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("step", [1e-9, 1e-5, 1e-3])
def test_a_clean_bench_is_left_alone(tmp_path, runs, step):
    rows = bench(runs, step=step)
    table = read(tmp_path, rows)
    assert table.findings == ()
    assert table.rows["force_N"].to_numpy() == pytest.approx(rows["force_N"].to_numpy())


def curve(d, i):
    """The force of the drawing, in N."""
    return 4.2e-9 / d**4 + 0.29 * np.exp(-d / 0.0166) * i


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
    assert len(table.findings) == 1
    assert "3 readings contradict all neighbours in force_N" in str(table.findings[0])
    assert "order 37" in str(table.findings[0])


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


@pytest.mark.parametrize("share", [1.0, 0.75, 0.0])
@pytest.mark.parametrize("runs", [1, 2])
@pytest.mark.parametrize("factor", [1.06, 1.15, 1.3])
def test_the_steep_end_of_a_smooth_curve_is_no_outlier(tmp_path, share, runs, factor):
    """A staircase of distances towards the pole at one current: its last readings are the most informative."""
    d = 0.008 * factor ** np.arange(20)
    rows = pd.concat([pd.DataFrame({"run": run, "current_A": 0.5, "distance_m": d}) for run in range(runs)])
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(rows))
    read_back = judged(read(tmp_path, rows.assign(force_N=curve(rows["distance_m"], 0.5) + noise)), share)
    assert read_back.rows["force_N"].notna().all()


@pytest.mark.parametrize("slip", [-1.0, 0.1, 0.4, 2.5, 10.0])
def test_a_slip_of_sign_or_digit_at_the_end_of_a_range_is_an_outlier(tmp_path, slip):
    d = 0.012 * 1.06 ** np.arange(20)
    rows = pd.DataFrame({"current_A": 0.5, "distance_m": d, "force_N": curve(d, 0.5)})
    rows["force_N"] += 1e-5 * np.random.default_rng(1).standard_normal(len(rows))
    rows.loc[0, "force_N"] *= slip
    assert np.flatnonzero(judged(read(tmp_path, rows)).rows["force_N"].isna()).tolist() == [0]


@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_right_reading_at_the_corner_of_the_range_is_no_outlier(tmp_path, seed, shuffled):
    """A gap 0.1 mm wider than drawn shows most where the force is steepest: at the corner, in a single reading."""
    generator = np.random.default_rng(seed)
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.003, 0.011, 6), [-1.2, -0.4, 0.4, 1.2, 2.0]))
    force = 2.5e-6 * i**2 / (d + 1e-4) ** 2 + 3e-4 * generator.standard_normal(len(d))
    rows = pd.DataFrame({"current_A": i, "distance_m": d, "force_N": force})
    table = read(tmp_path, rows.sample(frac=1.0, random_state=seed) if shuffled else rows)
    model = 2.5e-6 * table.rows["current_A"].to_numpy() ** 2 / table.rows["distance_m"].to_numpy() ** 2
    assert without_outliers(table, {"force_N": model}).rows["force_N"].notna().all()


@pytest.mark.parametrize("weights", [[0.35], [0.35, 0.42], [0.35, 0.42, 0.35]])
@pytest.mark.parametrize("runs", [1, 3])
def test_the_weight_of_a_body_that_hovers_is_no_stuck_channel(tmp_path, weights, runs):
    d = np.tile(np.linspace(0.018, 0.03, 12), len(weights))
    force = np.repeat(weights, 12)
    hover = pd.DataFrame({"current_A": 0.2 + 30.0 * (d - 0.018) + force, "distance_m": d, "force_N": force})
    table = read(tmp_path, pd.concat([hover.assign(run=run + 1) for run in range(runs)]))
    assert table.rows["force_N"].notna().all()
    assert not [said for said in table.findings if said.code == "stuck"]


def test_a_stuck_channel_is_set_aside_from_where_it_sticks(tmp_path):
    rows = bench()
    rows.loc[100:139, "force_N"] = rows.loc[100, "force_N"]
    table = read(tmp_path, rows)
    assert np.flatnonzero(table.rows["force_N"].isna()).tolist() == list(range(100, 140))
    assert "40 rows on end" in str(table.findings[0])


def test_a_coarse_channel_that_hardly_changes_is_not_stuck(tmp_path):
    rows = bench()
    far = rows["distance_m"] > 0.03
    flat = np.where(far, 0.0, rows["force_N"])  # a balance that shows 0.00 N beyond 30 mm in every run
    table = read(tmp_path, rows.assign(force_N=np.round(flat, 2)))
    assert table.findings == ()


def test_rows_that_stand_twice_count_once(tmp_path):
    rows = bench(1)
    table = read(tmp_path, pd.concat([rows, rows[:50]]))
    assert len(table.rows) == len(rows)
    assert "50 rows repeat an earlier one" in " ".join(map(str, table.findings))
    one = read(tmp_path, pd.concat([rows, rows[:1]]).drop(columns=["order"]).round(12))
    assert "1 row repeats" not in " ".join(map(str, one.findings))  # readings to 0.01 mN may be equal by chance


def test_runs_without_a_column_are_told_apart_by_their_order(tmp_path):
    table = read(tmp_path, bench(3).drop(columns=["run"]))
    assert table.rows["run"].unique().tolist() == [1.0, 2.0, 3.0]
    assert "starts anew 2 times" in str(table.findings[0])


def test_a_clock_that_was_reset_within_a_run_is_not_sorted_by(tmp_path):
    rows = bench(1)
    clock = 0.7 * rows["order"] + 0.013
    clock[60:] -= 30.0
    table = read(tmp_path, rows.assign(order=clock))
    assert "order goes back 1 time in run 1: the clock was reset" in str(table.findings[0])
    assert table.rows["distance_m"].to_numpy() == pytest.approx(rows["distance_m"].to_numpy())
    assert table.rows["order"].tolist() == list(range(len(rows)))


def test_a_file_sorted_by_setting_is_put_back_into_the_order_of_measuring(tmp_path):
    rows = bench(2)
    table = read(tmp_path, rows.sort_values(["run", "current_A", "distance_m"], kind="stable"))
    assert table.findings == ()
    assert table.rows["force_N"].to_numpy() == pytest.approx(rows["force_N"].to_numpy())


def test_a_jump_of_the_clock_is_told(tmp_path):
    rows = bench(1)
    table = read(tmp_path, rows.assign(order=rows["order"] + 5000 * (rows["order"] > 70)))
    assert [said.code for said in table.findings] == ["order"]
    assert "by 5001 after 70 in run 1" in str(table.findings[0])


def test_an_outlier_whose_neighbours_weights_are_not_found_is_kept(tmp_path, monkeypatch):
    """The search for the weights may end at its most iterations; whether readings surround this one is then unknown."""

    def endless(*_):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr("femfit.tables.outliers.nnls", endless)
    rows = bench(1)
    rows.loc[37, "force_N"] += 0.05
    table = judged(read(tmp_path, rows), 1.0)
    assert table.rows["force_N"].notna().all()


def test_a_temperature_below_absolute_zero_is_refused_with_its_line(tmp_path):
    rows = bench(1).assign(coil_temperature_C=20.0)
    rows.loc[3, "coil_temperature_C"] = -300.0
    with pytest.raises(TableError, match=r"line 5 holds -300 .*Leave a cell empty"):
        read(tmp_path, rows)


def test_distances_in_millimetres_and_temperatures_in_kelvin_are_suspected(tmp_path):
    rows = bench(1)
    said = read(tmp_path, rows.assign(distance_m=1e3 * rows["distance_m"])).findings
    assert [(one.code, one.column) for one in said] == [("suspected-unit", "distance_m")]
    said = read(tmp_path, rows.assign(coil_temperature_C=295.0 + 0.01 * rows["order"])).findings
    assert [(one.code, one.column) for one in said] == [("suspected-unit", "coil_temperature_C")]


def test_a_body_that_passes_the_face_keeps_its_distances(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("current_A,distance_m,force_N\n1,0,0.03\n1,-0.02,0.03\n2,0.02,0.05\n", encoding="utf-8")
    table = read_bench_table(path)
    assert table.rows["distance_m"].tolist() == [0.0, -0.02, 0.02]
    assert not table.findings


def test_a_table_without_a_current_column_is_read_as_without_current(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("distance_m,force_N\n0.01,0.03\n0.02,0.03\n", encoding="utf-8")
    table = read_bench_table(path)
    assert table.rows["current_A"].tolist() == [0.0, 0.0]
    assert "current_A" not in table.given


@pytest.mark.parametrize("value", ["1e308", "-1e200", "1e90"])
def test_a_cell_with_an_absurd_number_costs_none_of_its_neighbours(tmp_path, value):
    rows = [(1e-3 * d, 0.1 * i, 5.0 * (0.1 * i) ** 2 / d**2) for d in range(5, 15) for i in range(1, 11)]
    lines = ["distance_m,current_A,force_N", *(f"{d:g},{i:g},{f:.6g}" for d, i, f in rows)]
    lines[45] = ",".join([*lines[45].split(",")[:2], value])
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    table = read_bench_table(tmp_path / "a.csv")
    smooth = {
        "force_N": np.array(
            [5.0 * i**2 / (1e3 * d) ** 2 for d, i in table.rows[["distance_m", "current_A"]].to_numpy()]
        )
    }
    kept = without_outliers(table, smooth).rows["force_N"].notna()
    assert kept.sum() == len(rows) - 1
    assert not kept[44]
