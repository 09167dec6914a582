"""``femfit import`` as users type it."""

import json

import numpy as np
import pytest

from femfit.tables.sweep_table import read_sweep_table
from support.command import femfit


@pytest.fixture
def table_file(tmp_path):
    lines = ["Strom (A);Luftspalt (mm);Kraft (mN)"]
    lines += [f"{i};{d};{1e3 * (i + 0.5) / d**2:.8g}" for i in (0.0, 0.5, 1.0) for d in np.linspace(5, 15, 11)]
    path = tmp_path / "kraft.csv"
    path.write_text("\n".join(lines).replace(".", ","), encoding="cp1252")
    return path


def run_import(*arguments):
    return femfit("import", *arguments)


def test_import_writes_the_table_and_says_how_it_was_read(table_file, tmp_path):
    result = run_import(table_file, "-o", tmp_path / "out", "--json", tmp_path / "result.json")
    assert result.returncode == 0, result.stderr
    assert "force_N from Kraft (mN), in mN, times 0.001" in result.stdout
    assert "decimal ," in result.stdout
    table = read_sweep_table(tmp_path / "out")
    assert len(table.rows) == 33
    assert table.rows["distance_m"].max() == 0.015
    data = json.loads((tmp_path / "result.json").read_text())
    assert data["kind"] == "import"
    assert {entry["quantity"] for entry in data["mapping"]} == {"current", "distance", "force"}


def test_errors_of_the_table_exit_1_with_the_remedy_and_write_nothing(tmp_path):
    (tmp_path / "t.csv").write_text("current,position,force\n0,5,1\n0,6,0.9\n1,5,2\n1,6,1.8\n")
    result = run_import(tmp_path / "t.csv", "-o", tmp_path / "out")
    assert result.returncode == 1
    assert "--unit distance_m=mm" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_overrides_reach_the_reader(tmp_path):
    (tmp_path / "a.txt").write_text("5 -1\n6 -0.9\n")
    (tmp_path / "b.txt").write_text("5 -2\n6 -1.8\n")
    options = ["--columns", "position,force", "--unit", "distance=mm", "--file-current-A", "0,1", "--keep-force"]
    result = run_import(tmp_path / "a.txt", tmp_path / "b.txt", "-o", tmp_path / "out", *options)
    assert result.returncode == 0, result.stderr
    rows = read_sweep_table(tmp_path / "out").rows
    assert rows["current_A"].tolist() == [0, 0, 1, 1]
    assert rows["force_N"].tolist() == [-1, -0.9, -2, -1.8]


def test_an_actuator_file_goes_into_the_manifest(table_file, tmp_path, request):
    geometry = request.config.rootpath / "geometry" / "emaws-rig.toml"
    result = run_import(table_file, "-o", tmp_path / "out", "--actuator", geometry)
    assert result.returncode == 0, result.stderr
    actuator = read_sweep_table(tmp_path / "out").manifest["actuator"]
    assert actuator["mass_kg"] == pytest.approx(4.35e-3)
    assert actuator["hall"] is not None


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (["--flip-force", "--keep-force"], "exclude each other", 2),
        (["--file-current-A", "one"], "numbers separated by commas", 2),
        (["--column", "nothing=force"], "its columns are", 1),
        (["--unit", "force=parsec"], "--unit force", 1),
    ],
)
def test_wrong_options_are_clear_errors(table_file, tmp_path, arguments, words, code):
    result = run_import(table_file, "-o", tmp_path / "out", *arguments)
    assert result.returncode == code
    assert words in result.stderr
    assert "Traceback" not in result.stderr


def test_a_missing_output_is_a_usage_error(table_file):
    assert run_import(table_file).returncode == 2
