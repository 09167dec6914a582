"""The command line as a whole: help, failures, signals, pipes, progress, a full disk."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.cli import output
from femfit.cli.main import COMMANDS
from femfit.cli.output import progress, status
from femfit.field import sweep_task
from support.command import FEMFIT, femfit, python, worked
from support.small_drawing import SMALL

FEW = SMALL.replace("stop = 12", "stop = 6")


def test_help_lists_every_command_and_a_page_says_all_of_it():
    text = femfit("--help").stdout
    assert all(f" {name} " in text for name in COMMANDS)
    assert "--install-completion" in text
    assert "Otherwise the loop is closed." not in text  # which stands on the command's own page
    assert "Otherwise the loop is closed." in femfit("simulate", "--help").stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("line", ["export model.json -o out --json /dev/full", "view small.toml -o field.vtu"])
def test_a_full_disk_is_an_error_and_nothing_is_said_to_be_written(model_file, line):
    model_file.with_name("field.vtu").symlink_to("/dev/full")
    model_file.with_name("small.toml").write_text(SMALL)
    done = femfit(*line.split(), cwd=model_file.parent)
    assert done.returncode == 1
    assert "No space left" in done.stderr
    assert "written" not in done.stdout


CURRENT = np.repeat([0.0, 1.0, 0.0], 20)
PLATEAUS = {"time_s": 0.05 * np.arange(60), "coil_voltage_V": 0.0 * CURRENT, "current_A": CURRENT, "distance_m": 0.02}
LONG = {"time_s": np.arange(2000) * 1e-3, "coil_voltage_V": 0.0}


@pytest.mark.parametrize(
    ("rows", "size", "line"),
    [
        (
            PLATEAUS,
            300,
            "bench rec.csv -o b.csv",
        ),  # of a table of three rows and its notes, there is room for the table
        (LONG, 4000, "integrate rec.csv --method trapezoid -o i.csv"),
        (LONG, 4000, "integrate rec.csv --method trapezoid -o i.parquet"),
    ],
    ids=["table and sidecar", "csv", "parquet"],
)
def test_a_full_disk_leaves_no_half_of_a_result(tmp_path, largest_file, rows, size, line):
    pd.DataFrame(rows).to_csv(tmp_path / "rec.csv", index=False)
    largest_file(size)
    done = femfit(*line.split(), cwd=tmp_path)
    largest_file(None)
    assert (done.returncode, line.split()[-1] in done.stderr) == (1, "integrate" in line)
    assert [file.name for file in tmp_path.iterdir()] == ["rec.csv"]
    worked(*line.split(), cwd=tmp_path)
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) > size


def test_an_unforeseen_failure_is_one_line_with_a_log_file(monkeypatch, tmp_path):
    error = TypeError("something that nobody thought of\nand more")
    monkeypatch.setattr("femfit.export", mock.Mock(side_effect=error))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    result = femfit("export", "model.json", "-o", tmp_path / "out")
    assert (result.returncode, len(result.stderr.splitlines())) == (70, 1)
    (log,) = tmp_path.glob("femfit-*.log")
    assert str(log) in result.stderr
    assert "TypeError: something that nobody thought of" in log.read_text()
    monkeypatch.setattr("femfit.export", mock.Mock(side_effect=MemoryError))  # which is no bug
    assert femfit("export", "model.json", "-o", tmp_path / "out").returncode == 1


def test_a_name_from_a_file_does_not_steer_the_terminal(tmp_path):
    result = femfit("export", "\x1b[31mmodel.json", "-o", tmp_path / "out")
    assert result.returncode == 1
    assert "\x1b" not in result.stderr
    assert "[31mmodel.json" in result.stderr


def test_a_terminal_that_knows_only_ascii_loses_no_result():
    code = "import sys, femfit.cli.main as m; m._print_what_the_terminal_can_show(); print('3.2 µm')"
    assert python(code, env=os.environ | {"PYTHONIOENCODING": "ascii"}) == "3.2 ?m\n"


def test_a_reader_that_has_seen_enough_is_no_error(model_file):
    line = [FEMFIT, "audit", "model.json", "--json", "audit.json"]
    command = subprocess.Popen(line, cwd=model_file.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    command.stdout.close()
    _, said = command.communicate(timeout=60.0)
    assert (command.returncode, said) == (0, "")
    assert json.loads((model_file.parent / "audit.json").read_text())


# A shell's background jobs begin with SIGINT ignored
WAITING = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from femfit.cli import main
main.build_app = lambda _: lambda *_, **__: (print("waiting", flush=True), time.sleep(60))
main.main()
"""


@pytest.mark.parametrize(("number", "word"), [(signal.SIGTERM, "SIGTERM"), (signal.SIGINT, "interrupted")])
def test_a_signal_ends_a_command_with_its_own_code_and_one_line(number, word):
    child = subprocess.Popen([sys.executable, "-c", WAITING], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == "waiting\n"
        child.send_signal(number)
        _, said = child.communicate(timeout=60.0)  # a busy machine
    finally:
        child.kill()
    assert child.returncode == 128 + number
    (line,) = said.splitlines()
    assert word in line


SOLVED = sweep_task.DistanceTask.result


def swallowing(number, pending):
    """Solutions of which one meets a signal, as pybind11 does where the solver calls back: it becomes an error."""

    def result(task):
        if task.distance in pending:
            pending.clear()
            try:
                signal.raise_signal(number)
            except BaseException as interrupt:
                raise RuntimeError("Unable to cast Python instance of type <class 'tuple'>") from interrupt
        return SOLVED(task)

    return result


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_the_solver_swallows_is_no_failed_distance(tmp_path, monkeypatch, request, number):
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for work in the background
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, handler))
    (tmp_path / "a.toml").write_text(FEW)
    command = ("sweep", tmp_path / "a.toml", "-o", tmp_path / "run", "--workers", 1)
    monkeypatch.setattr(sweep_task.DistanceTask, "result", swallowing(number, {5e-3}))
    assert femfit(*command).returncode == 128 + number
    assert "failed" not in (tmp_path / "run" / "journal.jsonl").read_text()
    worked(*command)
    rows = ff.read_sweep(tmp_path / "run").rows
    assert ((rows["status"] == "ok").all(), len(rows)) == (True, 9)


def spoken(capsys):
    """What is said while nothing happens."""
    capsys.readouterr()
    time.sleep(0.1)
    return set(capsys.readouterr().err.split("\n")) - {""}


def test_work_without_a_terminal_says_now_and_then_what_is_done_and_when_it_ends(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(output, "monotonic", lambda: clock[0])
    monkeypatch.setattr(output, "INTERVAL_S", 0.01)
    with progress("valve", "samples") as show:
        assert spoken(capsys) == {"valve"}
        for part, name in (("", "valve"), ("trial 1", "trial 1 of valve")):
            show(20, 100, part)
            clock[0] += 10.0
            show(25, 100, part)
            assert spoken(capsys) == {f"{name}: 25 of 100 samples, about 150 s left"}  # 5 in 10 s
    with status("Reading") as say:
        say("Scoring the effects")
        clock[0] += 12.0
        assert spoken(capsys) == {"Scoring the effects, 12 s after the start"}
    assert spoken(capsys) == set()


def test_short_work_and_what_is_being_done_are_not_told_where_there_is_no_terminal(capsys):
    with progress("sweep x", "points") as show, status("Reading") as say:
        for done in range(11):
            show(done, 10)
        say("Estimating the noise")
    assert capsys.readouterr().err == ""
