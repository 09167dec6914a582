"""``femfit bench``: from a record of a winding's voltage to a table that compare and diagnose read."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest

from femfit.identify.readings.bench import conditions_of
from femfit.model.json_file import write_model
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement_file import read_bench_table
from support.campaign import settings
from support.command import femfit

RESISTANCE = 2.69
OFFSET = 2e-6
NOISE = 2e-6
RATE = 20.0
HOLD = 20
"""Samples of a plateau, 1 s; one sample half way follows, whose two trapezoids are the step."""


def with_steps(column):
    held = np.asarray(column)
    half_way = 0.5 * (held + np.append(held[1:], held[-1]))
    return np.concatenate([np.append(np.full(HOLD, one), half) for one, half in zip(held, half_way, strict=True)])


@pytest.fixture(scope="module")
def files(levitation_model, tmp_path_factory):
    """A voltage whose trapezoids are the model's flux linkage, plus R i, a growing offset and white noise."""
    generator = np.random.default_rng(4)
    plan = settings(levitation_model, runs=3, distances=8, currents=6)
    pieces = []
    for run in (1, 2, 3):
        rows = plan[plan["run"] == run].reset_index(drop=True)
        at = conditions_of(rows.assign(run=0, mount=0, elapsed=rows["order"]), nominal_of(levitation_model))
        read = predict_readings(levitation_model, rows["distance_m"].to_numpy(), rows["current_A"].to_numpy(), at)
        flux, current, distance = (
            with_steps(column) for column in (read["flux_linkage_Wb"], rows["current_A"], rows["distance_m"])
        )
        time = np.arange(len(flux)) / RATE
        change = np.diff(read["flux_linkage_Wb"]) * RATE
        induced = np.zeros(len(flux))
        induced[HOLD :: HOLD + 1][: len(change)] = change
        offset = OFFSET * (run + time / time[-1])
        noise = generator.normal(0.0, NOISE, len(flux))
        pieces.append(
            pd.DataFrame(
                {
                    "run": run,
                    "time_s": time,
                    "coil_voltage_V": induced + RESISTANCE * current + offset + noise,
                    "current_A": current,
                    "distance_m": distance,
                }
            )
        )
    folder = tmp_path_factory.mktemp("bench")
    write_model(levitation_model, folder / "model.json")
    pd.concat(pieces).to_csv(folder / "record.csv", index=False)
    return folder


def make(files, name, *more):
    done = femfit(
        "bench", files / "record.csv", "-o", files / f"{name}.csv", "--resistance-ohm", RESISTANCE, "--model",
        files / "model.json", "--settling-s", 0.1, *more,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def diagnosed(files, name):
    done = femfit(
        "diagnose", files / "model.json", files / f"{name}.csv", "--bootstrap", 0, "--json", files / f"{name}.json"
    )
    assert done.returncode == 0, done.stderr
    return json.loads((files / f"{name}.json").read_text())


def test_an_offset_left_in_the_integral_is_named_as_the_integrators_drift(files):
    make(files, "plain", "--method", "trapezoid")
    data = diagnosed(files, "plain")
    assert [one["name"] for one in data["missing"]] == ["flux_integrator_drift"]


def test_an_offset_taken_from_the_plateaus_leaves_nothing_missing(files):
    make(files, "held")
    assert diagnosed(files, "held")["missing"] == []
    assert femfit("compare", files / "model.json", files / "held.csv").returncode == 0


def test_the_table_has_one_row_a_plateau_with_branch_noise_and_what_was_assumed(files):
    said = make(files, "told")
    table = read_bench_table(files / "told.csv")
    assert len(table.rows) == 3 * 8 * (2 * 6 - 1)  # the top of a cycle is held twice as long: one plateau
    assert set(table.rows["branch"]) == {-1.0, 0.0, 1.0}
    assert "taken from model.json, not measured" in said
    assert "taken from model.json, not measured" in tomllib.loads((files / "told.toml").read_text())["notes"]


def test_the_declared_noise_is_the_scatter_about_the_truth(files, levitation_model):
    make(files, "noise")
    table = read_bench_table(files / "noise.csv")
    rows = table.rows
    numbered = rows.assign(run=0, mount=0, elapsed=rows["order"])
    read = predict_readings(
        levitation_model, rows["distance_m"].to_numpy(), rows["current_A"].to_numpy(),
        conditions_of(numbered, nominal_of(levitation_model)),
    )  # fmt: skip
    rms = np.sqrt(np.mean((rows["flux_linkage_Wb"] - read["flux_linkage_Wb"]) ** 2))
    declared = table.declared_noise["flux_linkage_Wb"]
    # Three random walks, so a loose factor; a walk of half or thrice this noise fails.
    assert 0.3 * declared < rms < 2.0 * declared


def test_a_gap_and_a_forgotten_resistance_are_said_and_noted(files, tmp_path):
    rows = pd.read_csv(files / "record.csv")
    rows.loc[200:202, "coil_voltage_V"] = np.nan
    rows.to_csv(tmp_path / "gap.csv", index=False)
    done = femfit("bench", tmp_path / "gap.csv", "-o", tmp_path / "b.csv", "--json", tmp_path / "b.json")
    assert done.returncode == 0, done.stderr
    assert "gap: Run 1: 1 gap" in done.stdout
    assert "needs --resistance-ohm 2.69" in done.stdout
    assert [one["code"] for one in json.loads((tmp_path / "b.json").read_text())["findings"]] == ["gap", "resistance"]
    assert "1 gap" in tomllib.loads((tmp_path / "b.toml").read_text())["notes"]


def test_a_good_record_has_no_findings(files):
    make(files, "good", "--json", files / "good_said.json")
    assert json.loads((files / "good_said.json").read_text())["findings"] == []


def test_a_record_without_plateaus_or_distance_is_refused(files, tmp_path):
    rows = pd.read_csv(files / "record.csv")
    rows.drop(columns="distance_m").to_csv(tmp_path / "short.csv", index=False)
    done = femfit("bench", tmp_path / "short.csv", "-o", tmp_path / "b.csv")
    assert done.returncode == 1
    assert "needs distance_m" in done.stderr
    rows.assign(current_A=np.linspace(0.0, 9.0, len(rows))).to_csv(tmp_path / "ramp.csv", index=False)
    done = femfit("bench", tmp_path / "ramp.csv", "-o", tmp_path / "b.csv", "--still-A", 1e-6)
    assert done.returncode == 1
    assert "at least 2 plateaus" in done.stderr
