"""``femfit simulate`` as users type it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.device.sensors import CurrentSensor, PositionSensor
from femfit.model.json_file import write_model
from support.command import femfit


@pytest.fixture
def model_file(levitation_model, tmp_path):
    path = tmp_path / "model.json"
    write_model(levitation_model, path)
    return path


def simulate(*arguments):
    return femfit("simulate", *arguments)


@pytest.mark.long
def test_the_default_compares_controllers_and_filters(model_file, tmp_path):
    result = simulate(model_file, "--json", tmp_path / "result.json")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    for part in ("held the body", "bound", "pulled in", "Hall offset", "force +1 %"):
        assert part in result.stdout
    data = json.loads((tmp_path / "result.json").read_text())
    assert {row["measurement"] for row in data["steps"]} == {"direct", "ukf"}


def test_one_loop_is_summed_up_and_its_series_written(model_file, tmp_path):
    result = simulate(
        model_file, "--controller", "pid", "--filter", "ukf4", "--offset", 0.02, "--seconds", 0.3, "--runs", 2,
        "--csv", tmp_path / "series.csv", "--json", tmp_path / "result.json", "--seed", 7,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("Held: 2 of 2 runs")
    table = np.genfromtxt(tmp_path / "series.csv", delimiter=",", names=True)
    assert len(table) == 2 * 600
    assert {"run", "time_s", "voltage_V", "true_current_A", "true_distance_m", "hall_V"} <= set(table.dtype.names)
    data = json.loads((tmp_path / "result.json").read_text())
    assert data["outcomes"] == {"HELD": 2}
    assert data["experiment"]["offset"] == 0.02


def test_a_lost_magnet_is_named_and_no_rms_is_printed(model_file):
    result = simulate(model_file, "--filter", "direct", "--seconds", 0.5)
    assert result.returncode == 0
    assert "1 run lost" in result.stdout
    assert "rms of estimated" not in result.stdout


def test_a_model_without_a_hall_sensor_says_how_to_get_one_and_exits_1(levitation_model, tmp_path):
    write_model(replace(levitation_model, sensor=None), tmp_path / "model.json")
    result = simulate(tmp_path / "model.json")
    assert result.returncode == 1
    assert "[sensors.NAME]" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    "option", [("--runs", 0), ("--seconds", -1), ("--dropout", 2), ("--seed", -1), ("--controller", "fuzzy")]
)
def test_impossible_options_are_usage_errors(model_file, option):
    assert simulate(model_file, *option).returncode == 2


def test_a_filter_reads_the_drawn_sensors_of_a_simulated_record_and_finds_their_noise(levitation_model, tmp_path):
    laser = PositionSensor(name="laser", noise=2e-4, distances_m=(0.0, 1.0), readings=(0.0, 10.0))
    ammeter = CurrentSensor(name="ammeter", noise=4e-3, circuit=levitation_model.circuit.name)
    model = replace(levitation_model, sensor=None, other_sensors=(laser, ammeter), reference_distances_m=(0.022,))
    write_model(model, tmp_path / "model.json")
    done = femfit(
        "simulate", tmp_path / "model.json", "--runs", 1, "--seconds", 0.5, "--controller", "pid",
        "--csv", tmp_path / "log.csv",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    table = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True)
    assert {"true_distance_m", "true_current_A", "position_V", "current_A"} <= set(table.dtype.names)
    assert "distance_m" not in table.dtype.names
    # The column of the ammeter is what it reads, noise and all
    assert np.std(table["current_A"] - table["true_current_A"]) == pytest.approx(4e-3, rel=0.1)
    seen = femfit("observe", tmp_path / "model.json", tmp_path / "log.csv", "--json", tmp_path / "seen.json")
    assert seen.returncode == 0, seen.stderr
    told = json.loads((tmp_path / "seen.json").read_text())
    assert sorted(told["sensors"]) == ["ammeter", "laser"]
    noise = {one["name"]: one["value"] for one in told["noise"]["estimates"]}
    assert noise["laser"] == pytest.approx(2e-4, rel=0.15)
    assert noise["ammeter"] == pytest.approx(4e-3, rel=0.15)
