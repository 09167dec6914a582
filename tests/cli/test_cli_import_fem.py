"""``femfit import-fem`` as users type it."""

import json

import pytest

from femfit.device.load import read_actuator
from support.command import femfit
from support.fem_files import STEEL, suspension


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "pull magnet.fem"
    path.write_text(suspension(below=True, face=3.0, unit="inches").text())
    return path


def run_import(*arguments):
    return femfit("import-fem", *arguments)


def test_a_model_becomes_an_actuator_file_that_says_where_it_comes_from(model, tmp_path):
    written = tmp_path / "out" / "actuator.toml"
    options = ["--distance-mm", "2:6:0.5", "--current-A", "0,1", "--mass-g", "2.5", "--json", tmp_path / "result.json"]
    result = run_import(model, "-o", written, *options)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("pull magnet.fem: 2 A at 4 mm\n")
    assert "only body with a magnet" in result.stdout
    assert "mirrored" in result.stdout
    actuator = read_actuator(written)
    assert actuator.name == "pull-magnet"
    assert actuator.sweep.currents_A == (0, 1, 2)
    assert len(actuator.sweep.distances_m) == 9
    assert actuator.mechanics.mass_kg == 2.5e-3
    text = written.read_text()
    assert "# block 'Pure Steel' at (r, z) = (2, 9) mm, group 1" in text
    assert "# circuit 'coil': block 'Copper'" in text
    data = json.loads((tmp_path / "result.json").read_text())
    assert (data["kind"], data["current_A"], data["distance_m"]) == ("import-fem", 2, 0.004)
    assert data["mirrored"] is True
    assert {finding["code"] for finding in data["findings"]} >= {"mover", "frame", "near-boundary", "assumed-wire"}


def test_the_moving_part_can_be_named_by_group_or_block(model, tmp_path):
    for option in (("--moving-group", 3), ("--moving-block", "N40")):
        result = run_import(model, "-o", tmp_path / "a.toml", *option)
        assert result.returncode == 0, result.stderr
        assert "only body" not in result.stdout
        assert [region.name for region in read_actuator(tmp_path / "a.toml").moving.regions] == ["n40"]


def test_what_cannot_be_taken_exits_1_with_every_cause_and_writes_nothing(tmp_path):
    drawing = suspension(header={"Format": 3.2})
    drawing.materials[STEEL]["Mu_y"] = 3
    (tmp_path / "m.fem").write_text(drawing.text())
    result = run_import(tmp_path / "m.fem", "-o", tmp_path / "out" / "a.toml")
    assert result.returncode == 1
    assert "m.fem cannot be imported:" in result.stderr
    assert "3.2" in result.stderr
    assert "anisotropic" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_missing_file_exits_1(tmp_path):
    result = run_import(tmp_path / "none.fem", "-o", tmp_path / "a.toml")
    assert result.returncode == 1
    assert "none.fem" in result.stderr
