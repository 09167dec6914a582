"""``femfit simulate`` in open loop as users type it."""

import json

import numpy as np
import pytest

from femfit.device.circuit import Drive
from femfit.model.json_file import write_model
from support.command import femfit
from support.halves import cut_in_two
from support.solenoids import solenoid


@pytest.fixture
def model_file(tmp_path):
    path = tmp_path / "model.json"
    write_model(solenoid(drive=Drive(diode_V=0.7)), path)
    return path


def test_a_profile_gives_pull_in_and_drop_out_and_all_files(model_file, tmp_path):
    drive = tmp_path / "12V.csv"
    drive.write_text("time_ms,voltage_V\n0,12\n70,0\n200,0\n")
    result = femfit(
        "simulate", model_file, "--drive", drive, "--csv", tmp_path / "motion.csv", "--json", tmp_path / "motion.json",
        "--picture", tmp_path / "motion.png",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert [line.split()[0] for line in result.stdout.splitlines()[:2]] == ["Pull-in", "Drop-out"]
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert table["time_s"][-1] == pytest.approx(0.2)
    assert table["distance_m"].min() == pytest.approx(0.2e-3)
    data = json.loads((tmp_path / "motion.json").read_text())
    assert [one["kind"] for one in data["switchings"]] == ["pull_in", "drop_out"]
    assert abs(data["energy"]["remainder_J"]) < 1e-6 * data["energy"]["supplied_J"]
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")
    again = femfit("simulate", model_file, "--voltage", 12, "--csv", tmp_path / "motion.csv")
    assert again.returncode == 0, again.stderr  # its own table is replaced


def test_start_and_duration_are_taken_in_millimetres_and_milliseconds(model_file, tmp_path):
    result = femfit(
        "simulate", model_file, "--voltage", 0, "--start-mm", 2, "--duration-ms", 5, "--csv", tmp_path / "motion.csv"
    )
    assert result.returncode == 0, result.stderr
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert (table["distance_m"][0], table["time_s"][-1]) == (pytest.approx(2e-3), pytest.approx(5e-3))


def test_the_rows_of_the_table_stand_as_far_apart_as_asked_for(model_file, tmp_path):
    motion = tmp_path / "motion.csv"
    result = femfit("simulate", model_file, "--voltage", 12, "--duration-ms", 5, "--step-ms", 0.05, "--csv", motion)
    assert result.returncode == 0, result.stderr
    np.testing.assert_allclose(np.diff(np.genfromtxt(motion, delimiter=",", names=True)["time_s"]), 5e-5)


def test_a_command_beyond_the_supply_is_cut_and_said(model_file):
    result = femfit("simulate", model_file, "--voltage", 24)
    assert result.returncode == 0, result.stderr
    assert "it is cut there" in result.stdout
    assert result.stdout.splitlines()[0] == femfit("simulate", model_file, "--voltage", 12).stdout.splitlines()[0]


@pytest.mark.parametrize("options", [("--controller", "pid"), ("--noise", 3), ("--force-scale", 1.1), ("--runs", 3)])
def test_options_of_the_closed_loop_are_refused_in_open_loop(model_file, options):
    result = femfit("simulate", model_file, "--voltage", 12, *options)
    assert result.returncode != 0
    assert "open loop" in result.stderr


def test_a_duration_alone_asks_for_a_command(model_file):
    result = femfit("simulate", model_file, "--duration-ms", 5)
    assert result.returncode != 0
    assert "--voltage" in result.stderr


def test_each_of_several_circuits_takes_its_own_voltage(tmp_path):
    path = tmp_path / "model.json"
    write_model(cut_in_two(solenoid()), path)
    result = femfit("simulate", path, "--voltage", "inner=6,outer=6", "--csv", tmp_path / "motion.csv")
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("Pull-in")
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert set(table.dtype.names) >= {"current_inner_A", "voltage_outer_V", "flux_linkage_inner_Wb"}
    refused = femfit("simulate", path, "--voltage", "inner=six")
    assert refused.returncode != 0
    assert "bias=2,diff=1" in refused.stderr
