"""Bench tables as labs write them, through ``femfit compare``: plain passes, copies, dead channels, mixed units."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.model.json_file import write_model
from support.campaign import campaign
from support.command import femfit

SIGMA = 1e-3


@pytest.fixture(scope="module")
def folder(levitation_model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    write_model(levitation_model, folder / "model.json")
    return folder


@pytest.fixture(scope="module")
def bench(levitation_model):
    """Two runs of seven distances and four currents, all channels, as a file has them."""
    return campaign(levitation_model, 3, runs=2, distances=7, currents=4, rho=0.0, mount_m=0.0).rows.drop(
        columns="mount"
    )


def passes(model, seed, count, offset_N=0.0):
    """Passes over 20 settings with white noise of the force, without a column that says which pass or when."""
    box = model.validity
    d, i = np.meshgrid(np.linspace(0.0165, 0.0435, 5), np.linspace(box.current_min_A, box.current_max_A, 4))
    force = np.tile(model.force(d.ravel(), i.ravel()), count) + offset_N
    read = force + SIGMA * np.random.default_rng(seed).standard_normal(len(force))
    return pd.DataFrame(
        {"distance_m": np.tile(d.ravel(), count), "current_A": np.tile(i.ravel(), count), "force_N": read}
    )


def compared(folder, rows, *options):
    """What is printed, and the JSON of a comparison."""
    rows.to_csv(folder / "bench.csv", index=False)
    done = femfit("compare", folder / "model.json", folder / "bench.csv", *options, "--json", folder / "c.json")
    assert done.returncode == 0, done.stderr
    data = json.loads((folder / "c.json").read_text())
    return done.stdout, data, {one["channel"]: one for one in data["channels"]}


def found(data, code):
    return [one for one in data["findings"] if one["code"] == code]


@pytest.mark.parametrize(
    ("count", "order", "seeds"),
    [(2, "as measured", 20), (2, "shuffled", 10), (4, "sorted", 10)],
)
def test_the_white_noise_of_passes_without_a_run_column_is_found(levitation_model, folder, count, order, seeds):
    """20 differences know a standard deviation to 16 %: 89 of 100 lie within a quarter of the truth."""
    ratios = []
    for seed in range(seeds):
        rows = passes(levitation_model, seed, count)
        rows = rows.sort_values(["distance_m", "current_A"], kind="stable") if order == "sorted" else rows
        rows = rows.sample(frac=1.0, random_state=seed) if order == "shuffled" else rows
        rows.to_csv(folder / "passes.csv", index=False)
        (force,) = ff.compare(levitation_model, folder / "passes.csv").channels
        ratios.append(force.noise_floor / SIGMA)
    within = np.abs(np.array(ratios) - 1.0) <= 0.25
    assert within.sum() >= 0.9 * seeds, ratios
    assert max(ratios) < 1.4


@pytest.mark.parametrize(("times", "source"), [(1.0, "declared and repeats"), (10.0, "repeats")])
def test_a_declared_noise_is_printed_beside_what_repeats_show(levitation_model, folder, times, source):
    said, data, channels = compared(folder, passes(levitation_model, 1, 2), "--noise", f"force_N={times * SIGMA}")
    assert channels["force_N"]["noise_source"] == source
    assert channels["force_N"]["noise_declared"] == pytest.approx(times * SIGMA)
    assert channels["force_N"]["noise_readings"] == pytest.approx(20.0)
    assert " mN declared" in said
    assert bool(found(data, "declared-noise")) is (source == "repeats")


def test_a_comparison_says_one_probability(levitation_model, folder):
    said, data, _ = compared(folder, passes(levitation_model, 1, 2, offset_N=5.0 * SIGMA))
    assert data["verdict"] == "fails"
    assert len(re.findall(r"\bp [<=]", said)) == 1
    assert "Lack of fit: p" in said


@pytest.mark.parametrize("rows", [12, 21])
@pytest.mark.parametrize("weight_N", [0.04267, 0.05])
def test_a_constant_force_does_not_fit_at_any_other_distance(folder, rows, weight_N):
    """A weight that hovers: no shift makes the model's force constant."""
    hover = {"distance_m": np.linspace(0.01575, 0.04275, rows), "current_A": np.linspace(0.2, 1.2, rows)}
    said, data, _ = compared(folder, pd.DataFrame({**hover, "force_N": weight_N}), "--noise", f"force_N={SIGMA}")
    assert not found(data, "suspected-zero")
    assert "would fit" not in said


def test_a_hover_table_with_another_zero_of_the_distance_is_told_so(levitation_model, folder):
    d, weight_N = np.linspace(0.0195, 0.0285, 12), 0.08
    currents = np.linspace(0.0, 1.4, 200)
    i = [np.interp(weight_N, levitation_model.force(np.full(200, one), currents), currents) for one in d]
    rows = pd.DataFrame({"distance_m": d - 4e-3, "current_A": i, "force_N": weight_N})
    assert len(rows) == 12
    (finding,) = found(compared(folder, rows, "--noise", f"force_N={SIGMA}")[1], "suspected-zero")
    assert finding["size"] == pytest.approx(4e-3, rel=0.05)


@pytest.mark.parametrize("runs", [1, 2])
def test_rows_that_were_copied_and_numbered_anew_are_no_repeats(folder, bench, runs):
    rows = bench[bench["run"] <= runs]
    copied = rows.loc[rows.index.repeat(3)]
    copied = copied.assign(order=copied.groupby("run").cumcount().to_numpy(dtype=float))
    once, data = compared(folder, rows)[2], compared(folder, copied)[1]
    (finding,) = found(data, "copies")
    assert finding["size"] == 2 * len(rows)
    for one in data["channels"]:
        assert one["readings"] == once[one["channel"]]["readings"]
        # The copies' numbers make gaps of three in the order, so that a correlation of neighbours is another
        assert one["noise_floor"] == pytest.approx(once[one["channel"]]["noise_floor"], rel=0.1)


def test_equal_readings_of_a_coarse_channel_are_repeats(levitation_model, folder):
    rows = passes(levitation_model, 2, 4)
    rows = rows.assign(force_N=np.round(rows["force_N"] / SIGMA) * SIGMA, run=np.repeat([1.0, 2.0, 3.0, 4.0], 20))
    again = rows.duplicated(["distance_m", "current_A", "force_N"]).sum()
    assert again > 10
    _, data, channels = compared(folder, rows)
    assert not found(data, "copies")
    assert channels["force_N"]["readings"] == 80


def test_rows_in_another_unit_are_counted_and_not_the_column(folder, bench):
    half = bench["distance_m"].where(bench.index % 2 == 0, 1e3 * bench["distance_m"])
    second = bench["force_N"].where(bench["run"] == 1.0, 1e3 * bench["force_N"])
    for rows, column, count in (
        (bench.assign(distance_m=half), "distance_m", (bench.index % 2 == 1).sum()),
        (bench.assign(force_N=second), "force_N", (bench["run"] == 2.0).sum()),
    ):
        said, data, _ = compared(folder, rows)
        (finding,) = found(data, "suspected-unit")
        assert (finding["column"], finding["size"]) == (column, count)
        assert f"{count} of {len(bench)} rows" in said.split("\n")[0]
        assert "--unit" not in finding["remedy"]


@pytest.mark.parametrize("value", [0.0, 0.05])
def test_a_channel_of_one_value_over_varying_settings_is_called_dead(folder, bench, value):
    said, data, _ = compared(folder, bench.assign(force_N=value))
    assert [one["column"] for one in found(data, "suspected-dead")] == ["force_N"]
    assert "dead channel" in said.split("\n")[0]
    assert not found(data, "suspected-scale")


def test_a_unit_is_not_suspected_that_would_still_be_impossible(folder, bench):
    _, data, _ = compared(folder, bench.assign(force_N=1e12 * bench["force_N"]))
    assert not found(data, "suspected-unit")
    assert [one["column"] for one in found(data, "suspected-scale")] == ["force_N"]


def test_a_bench_of_more_rows_than_can_be_compared_is_refused_at_once(levitation_model, folder):
    passes(levitation_model, 4, 251).to_csv(folder / "long.csv", index=False)
    done = femfit("compare", folder / "model.json", folder / "long.csv")
    assert done.returncode == 1
    assert "5,000" in done.stderr
    assert "5,020" in done.stderr
    assert len(done.stderr.strip().split("\n")) == 1


@pytest.mark.parametrize("count", [2, 4])
def test_readings_that_are_equal_by_their_coarse_digit_are_repeats_of_their_noise(folder, levitation_model, count):
    """Steps five times as wide as the sensor's noise: most repeats agree, many on end, and some are a step apart."""
    digit, floors = 5.0 * SIGMA, []
    for seed in range(4):
        rows = passes(levitation_model, seed, count)
        _, data, channels = compared(folder, rows.assign(force_N=(rows["force_N"] / digit).round() * digit))
        assert not found(data, "copies")
        floors.append(channels["force_N"]["noise_floor"])
    assert np.mean(floors) == pytest.approx(np.hypot(SIGMA, digit / np.sqrt(12.0)), rel=0.2)


def test_rows_pasted_twice_beside_repeats_that_differ_are_still_copies(folder, levitation_model):
    rows = passes(levitation_model, 1, 2).round({"force_N": 5})
    _, data, _ = compared(folder, pd.concat([rows, rows[:12]]))
    (copies,) = found(data, "copies")
    assert copies["size"] == 12


def test_an_ammeters_column_that_gives_way_to_the_true_current_is_not_asked_for(folder, levitation_model):
    """As docs/reference/files.md advises for a record of ideal instruments."""
    rows = passes(levitation_model, 1, 2)
    both = rows.rename(columns={"distance_m": "true_distance_m"}).assign(true_current_A=rows["current_A"])
    ideal = ("--column", "true_distance_m=distance_m", "--column", "true_current_A=current_A")
    said, data, _ = compared(folder, both, *ideal)
    assert "current_A is needed" not in said
    (unused,) = found(data, "unused-column")
    assert not unused["column"]
