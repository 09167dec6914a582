"""The files of a user survive every command that is given them, or their neighbours, as an output."""

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from femfit.cli.command import Outcome, command
from femfit.core.errors import OutputError
from femfit.model.json_file import write_model
from support.command import femfit, worked

BENCH = "current_A,distance_m,force_N\n0.1,0.02,0.03\n0.2,0.02,0.04\n0.3,0.02,0.05\n"
FEM = '[Format]      =  4.0\n[ProblemType] =  "axisymmetric"\n'


@pytest.fixture(scope="module")
def files(levitation_model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs")
    write_model(levitation_model, folder / "model.json")
    (folder / "bench.csv").write_text(BENCH)
    shutil.copyfile("geometry/plunger-solenoid.toml", folder / "rig.toml")
    (folder / "rig.fem").write_text(FEM)
    time = np.arange(2000) * 1e-3
    rows = np.column_stack([time, np.zeros(2000), np.zeros(2000), np.full(2000, 0.02)])
    np.savetxt(
        folder / "rec.csv", rows, delimiter=",", header="time_s,coil_voltage_V,current_A,distance_m", comments=""
    )
    return folder


COMMANDS = [
    ("bench rec.csv --resistance-ohm 2.69 -o rig.csv", "rig.toml"),
    ("integrate rec.csv -o model.bin --method trapezoid", "model.json"),
    ("integrate rec.csv -o rec.csv", "rec.csv"),
    ("integrate rec.csv -o new.csv --json model.json", "model.json"),
    ("import-fem rig.fem -o rig.fem", "rig.fem"),
    ("import bench.csv -o runs --json model.json", "model.json"),
    ("fit bench.csv --model F1e -o rig.toml", "rig.toml"),
    ("simulate model.json --drive rec.csv --csv rec.csv", "rec.csv"),
    ("diagnose model.json bench.csv --report model.json", "model.json"),
    ("add model.json force_offset bench.csv -o bench.csv", "bench.csv"),
    ("run rig.toml -o runs --json rig.toml", "rig.toml"),
    ("view rig.toml -o new.png --json rig.toml", "rig.toml"),
    ("export model.json -o est --json model.json", "model.json"),
]


@pytest.mark.parametrize(("line", "kept"), COMMANDS)
def test_a_command_replaces_no_input_and_no_file_of_another_kind(files, line, kept):
    before = hashlib.sha256((files / kept).read_bytes()).hexdigest()
    done = femfit(*line.split(), cwd=files)
    assert hashlib.sha256((files / kept).read_bytes()).hexdigest() == before
    assert done.returncode == 1
    assert kept in done.stderr
    assert "name" in done.stderr


@pytest.mark.parametrize(
    "line",
    [
        "simulate model.json --seconds 0.01 --csv new.parquet",
        "compare model.json bench.csv --json new.csv",
        "diagnose model.json bench.csv --report new.pdf",
        "bench rec.csv -o new.parquet",
    ],
)
def test_a_name_that_promises_another_format_is_refused_and_nothing_is_written(files, line):
    done = femfit(*line.split(), cwd=files)
    assert done.returncode == 1
    assert "new." in done.stderr
    assert not list(files.glob("new.*"))


def test_a_result_whose_page_cannot_be_written_is_told_and_kept_as_json(tmp_path, capsys):
    class Found:
        def to_dict(self):
            return {"distance_m": 0.02}

        def __str__(self):
            return "20 mm"

    def page(path):
        raise OutputError(f"{path} cannot be written")

    @command()
    def measure(report: Path) -> Outcome:
        return Outcome(Found(), files=[(report, page)])

    with pytest.raises(OutputError):
        measure(tmp_path / "page.html", json=tmp_path / "result.json")
    assert capsys.readouterr().out == "20 mm\n"
    assert json.loads((tmp_path / "result.json").read_text())["distance_m"] == 0.02


def test_a_command_of_tables_loads_no_table_library_before_it_runs():
    code = "import sys, femfit.cli.fit, femfit.cli.compare; print('pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_an_empty_name_keeps_its_place_among_the_names_of_columns(tmp_path):
    rows = [f"0.00{11 + k},{0.3 + k / 100},{0.2 + k / 100},{0.1 + k / 100}" for k in range(5)]
    (tmp_path / "matrix.csv").write_text("\n".join(rows))
    names = ("--columns", ",0 A,0.5 A,1 A", "--matrix-rows", "distance", "--unit", "distance=m")
    worked("import", tmp_path / "matrix.csv", *names, "-o", tmp_path / "out", "--accept", "all")
    assert sorted(pd.read_parquet(tmp_path / "out" / "sweep.parquet")["current_A"].unique()) == [0.0, 0.5, 1.0]
