"""``femfit simulate`` as users type it."""

import json
from dataclasses import replace

import numpy as np
import pytest

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
    assert "[hall]" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    "option", [("--runs", 0), ("--seconds", -1), ("--dropout", 2), ("--seed", -1), ("--controller", "fuzzy")]
)
def test_impossible_options_are_usage_errors(model_file, option):
    assert simulate(model_file, *option).returncode == 2
