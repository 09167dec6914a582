"""A command ends on SIGTERM and Ctrl-C, also where Python cannot interrupt it."""

import json
import signal
import subprocess
import sys

import pytest

import femfit as ff
from femfit.cli.signals import PATIENCE
from femfit.field import sweep_task
from femfit.model.json_file import write_model
from support.command import FEMFIT, femfit
from support.small_drawing import SMALL

IN_C = """
import sys, threading, ctypes, signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs begin with it ignored
from femfit.cli import main
def app():
    def command(*_, **__):
        print("in C", flush=True)
        {wait}
    return command
main.build_app = app
main.main()
"""
# A mutex locked twice stands for the mesher: C code without the interpreter's lock, which takes
# up its wait again after a signal
STUCK = (
    "libc = ctypes.CDLL(None); lock = ctypes.create_string_buffer(64); [libc.pthread_mutex_lock(lock) for _ in '12']"
)


@pytest.mark.parametrize(("number", "word"), [(signal.SIGTERM, "ended by SIGTERM"), (signal.SIGINT, "interrupted")])
@pytest.mark.parametrize("wait", [STUCK, "import time; time.sleep(60)"], ids=["in C", "in Python"])
def test_a_signal_ends_a_command_with_its_own_code_and_words(wait, number, word):
    child = subprocess.Popen(
        [sys.executable, "-c", IN_C.format(wait=wait)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert child.stdout.readline() == "in C\n"
        child.send_signal(number)
        _, said = child.communicate(timeout=PATIENCE + 60.0)  # a busy machine
    finally:
        child.kill()
    assert child.returncode == 128 + number
    assert said == f"femfit: {word}; what was finished is kept\n"


SOLVED = sweep_task.DistanceTask.result


def swallowing_at(distance, number):
    """Solutions of which one meets a signal, as pybind11 does where the solver calls back: it becomes an error."""
    pending = [distance]

    def result(task):
        if task.distance == distance and pending:
            pending.clear()
            try:
                signal.raise_signal(number)
            except BaseException as interrupt:
                text = "Unable to cast Python instance of type <class 'tuple'>"
                raise RuntimeError(text) from interrupt
        return SOLVED(task)

    return result


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_the_solver_swallows_is_no_failed_distance(tmp_path, monkeypatch, request, number):
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for work in the background
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, handler))
    (tmp_path / "a.toml").write_text(SMALL.replace("stop = 12", "stop = 6"))
    command = ("sweep", tmp_path / "a.toml", "-o", tmp_path / "run", "--workers", 1)
    monkeypatch.setattr(sweep_task.DistanceTask, "result", swallowing_at(5e-3, number))
    ended = femfit(*command)
    assert ended.returncode == 128 + number
    journal = (tmp_path / "run" / "journal.jsonl").read_text()
    assert "failed" not in journal
    assert femfit(*command).returncode == 0
    rows = ff.read_sweep(tmp_path / "run").rows
    assert (rows["status"] == "ok").all()
    assert len(rows) == 9


def test_a_reader_that_has_seen_enough_is_no_error(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    command = subprocess.Popen(
        [FEMFIT, "audit", "model.json", "--json", "audit.json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    command.stdout.close()
    _, said = command.communicate(timeout=60.0)
    assert (command.returncode, said) == (0, "")
    assert json.loads((tmp_path / "audit.json").read_text())


IMPORTING = """
import atexit, builtins, signal, sys
from femfit.cli import main
load = builtins.__import__
def hit(name, *rest, **named):
    if name == "ngslib":  # of NGSolve in C++, within the import of NGSolve
        builtins.__import__ = load
        signal.raise_signal(signal.SIGINT)
    return load(name, *rest, **named)
builtins.__import__ = hit
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv = ["femfit", "sweep", "a.toml", "-o", "run", "--workers", "1"]
atexit.register(lambda: print("loaded" if "ngsolve.ngslib" in sys.modules else "not loaded"))
main.main()
"""


def test_a_ctrl_c_waits_until_the_solver_is_loaded_which_would_print_it_as_its_own_error(tmp_path):
    (tmp_path / "a.toml").write_text(SMALL)
    command = [sys.executable, "-c", IMPORTING]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 130
    assert "not loaded" not in done.stdout  # nothing is printed where it loads for longer than a signal waits
    assert done.stderr == "femfit: interrupted; what was finished is kept\n"
