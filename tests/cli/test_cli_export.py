"""``femfit export`` as users type it."""

import json

import pytest

from femfit.model.json_file import write_model
from support.command import femfit


@pytest.fixture
def model_file(levitation_model, tmp_path):
    path = tmp_path / "model.json"
    write_model(levitation_model, path)
    return path


def export(*arguments):
    return femfit("export", *arguments)


def test_export_writes_the_package_and_lists_its_files(model_file, tmp_path):
    result = export(model_file, "--to", "estimator", "-o", tmp_path / "out", "--json", tmp_path / "result.json")
    assert result.returncode == 0, result.stderr
    data = json.loads((tmp_path / "result.json").read_text())
    assert data["target"] == "estimator"
    assert {"model.json", "example.py", "README.md"} <= set(data["files"])
    assert all((tmp_path / "out" / name).is_file() for name in data["files"])


def test_an_unknown_target_names_the_known_ones_and_exits_2(model_file, tmp_path):
    result = export(model_file, "--to", "fmu", "-o", tmp_path / "out")
    assert result.returncode == 2
    assert "estimator" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_missing_output_is_a_usage_error(model_file):
    result = export(model_file)
    assert result.returncode == 2
    assert "--output" in result.stdout + result.stderr
    assert "Traceback" not in result.stderr


def test_a_file_that_is_no_model_is_named(tmp_path):
    (tmp_path / "table.csv").write_text("current_A,distance_m\n")
    result = export(tmp_path / "table.csv", "-o", tmp_path / "out")
    assert result.returncode == 1
    assert "table.csv must be JSON" in result.stderr
