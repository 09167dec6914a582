"""Exhausted memory, a full disk, a mesh that fails, SIGKILL, a tolerance's levels: no kind of sweep loses its rows."""

import contextlib
import dataclasses
import json
import signal
import subprocess
import sys
import time

import pandas as pd
import psutil
import pytest

from femfit.core.errors import FieldSolverError
from femfit.device.rewrite import read_variants, variants_from_toml
from femfit.field import moving_mesh, sweep_task
from femfit.field import tolerance as tolerance_module
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.sweep_task import DIED
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, device, magnet
from support.command import FEMFIT
from support.dying_worker import die_at_20_mm, starve_at_20_mm
from support.small_drawing import SMALL

QUICK = SolverSettings(order=3)
DISTANCES = (0.015, 0.02, 0.025)

PATIENCE = 120.0
"""Seconds for a moment to come, on a busy machine."""


def sweep_of():
    """Three distances of a small drawing on one mesh."""
    return variants_from_toml(SMALL.replace("{ start = 4, stop = 12, step = 1 }", "[15, 20, 25]"))


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    sweep, directory = sweep_of(), tmp_path_factory.mktemp("whole")
    sweep_task.MESHES.clear()
    return sweep, run_sweep(sweep, directory, workers=1, settings=QUICK), directory


def assert_only_20_mm_failed(table, whole, reason):
    here = table.rows["distance_m"] == 0.02
    assert table.rows[here]["status"].str.contains(reason).all()
    assert table.rows[here]["force_N"].isna().all()
    # Whole numbers become floats in a column with a hole; the values are the same bits.
    pd.testing.assert_frame_equal(table.rows[~here], whole.rows[~here], check_exact=True, check_dtype=False)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [(starve_at_20_mm, "failed: out of memory"), pytest.param(die_at_20_mm, "process died", marks=pytest.mark.nightly)],
)
def test_a_worker_without_memory_or_killed_costs_its_own_rows_only(case, tmp_path, monkeypatch, fault, reason):
    sweep, whole, _ = case
    monkeypatch.setattr(sweep_task, "solve_task", fault)
    assert_only_20_mm_failed(run_sweep(sweep, tmp_path, workers=2, settings=QUICK), whole, reason)
    monkeypatch.undo()  # the machine has its memory back: the same command solves what it could not
    again = run_sweep(sweep, tmp_path, workers=1, settings=QUICK)
    pd.testing.assert_frame_equal(again.rows, whole.rows, check_exact=True)


def refuse_at(refused):
    build = moving_mesh.build_mesh

    def build_or_refuse(actuator, distance, layout, settings):
        if refused(distance):
            raise FieldSolverError("no mesh")
        return build(actuator, distance, layout, settings)

    return build_or_refuse


def test_a_distance_that_cannot_be_meshed_is_rows_with_the_reason(case, tmp_path, monkeypatch):
    sweep, *_ = case
    settings = dataclasses.replace(QUICK, stretch_limit=1.0)  # a mesh of its own for each distance
    whole = run_sweep(sweep, tmp_path / "whole", workers=1, settings=settings)
    monkeypatch.setattr(moving_mesh, "build_mesh", refuse_at(lambda distance: distance == 0.02))
    sweep_task.MESHES.clear()
    table = run_sweep(sweep, tmp_path / "run", workers=1, settings=settings)
    assert_only_20_mm_failed(table, whole, "^failed: no mesh$")


def test_a_group_whose_mesh_fails_is_meshed_distance_by_distance(case, tmp_path, monkeypatch):
    sweep, whole, _ = case
    monkeypatch.setattr(moving_mesh, "build_mesh", refuse_at(lambda distance: distance not in DISTANCES))
    sweep_task.MESHES.clear()
    table = run_sweep(sweep, tmp_path, workers=1, settings=QUICK)
    assert (table.rows["status"] == "ok").all()
    # Other meshes, other errors: the force agrees within twice the estimates.
    error = table.rows["force_error_N"] + whole.rows["force_error_N"]
    assert ((table.rows["force_N"] - whole.rows["force_N"]).abs() <= 2.0 * error).all()


FULL = """
import resource, sys
from pathlib import Path
from femfit.core.errors import RunDirectoryError
from femfit.field.tolerance import SolverSettings
from femfit.field.sweep import run_sweep
sys.path.insert(0, sys.argv[1])
from field.test_sweep_failures import sweep_of
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
try:
    run_sweep(sweep_of(), Path(sys.argv[2]), workers=1, settings=SolverSettings(order=3))
except RunDirectoryError as error:
    sys.exit(str(error))
"""


def test_a_full_disk_keeps_what_fits_and_the_same_command_goes_on(case, tmp_path):
    sweep, whole, directory = case
    lines = (directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    room = len(lines[0] + lines[1]) + len(lines[2]) // 2  # the second result's line finds half of its room
    tests, target = str(GEOMETRY.parent / "tests"), tmp_path / "full"
    arguments = [tests, str(target), str(room)]
    result = subprocess.run([sys.executable, "-c", FULL, *arguments], capture_output=True, text=True, check=False)
    count = len(lines) - 1
    assert f"1 of {count} results" in result.stderr
    assert result.returncode == 1
    assert [path.name for path in target.iterdir()] == ["journal.jsonl"]
    assert len([json.loads(line) for line in (target / "journal.jsonl").read_bytes().splitlines()]) == 2
    resumed = run_sweep(sweep, target, workers=1, settings=QUICK)
    pd.testing.assert_frame_equal(whole.rows, resumed.rows, check_exact=True)


def kill_when(command, moment):
    """Run a command and kill it, not its workers, at a moment."""
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + PATIENCE
    while child.poll() is None and not moment():
        assert time.monotonic() < deadline
        time.sleep(0.005)
    children = []
    with contextlib.suppress(psutil.NoSuchProcess):
        children = psutil.Process(child.pid).children(recursive=True)
    child.send_signal(signal.SIGKILL)
    child.wait()
    return child.returncode, children


@pytest.mark.nightly
def test_a_sweep_killed_twice_ends_in_the_table_of_one_never_killed(tmp_path):
    path, target = tmp_path / "small.toml", tmp_path / "killed"
    path.write_text(SMALL.replace("stop = 12", "stop = 13"), encoding="utf-8")
    sweep = read_variants(path)
    journal = target / "journal.jsonl"
    command = [FEMFIT, "sweep", str(path), "-o", str(target), "--workers", "2"]
    for lines in (2, 5):  # the header and one result, and some more: each time in the middle of others
        code, children = kill_when(
            command, lambda lines=lines: journal.exists() and journal.read_bytes().count(b"\n") >= lines
        )
        assert code == -signal.SIGKILL
        _, left = psutil.wait_procs(children, timeout=PATIENCE)
        assert left == []  # no worker outlives it
    before = [json.loads(line) for line in journal.read_bytes().splitlines()[1:] if line.endswith(b"}")]
    assert 4 <= len(before) < 10
    sweep_task.MESHES.clear()  # as in a new process
    resumed = run_sweep(sweep, target, workers=1)
    sweep_task.MESHES.clear()
    whole = run_sweep(sweep, tmp_path / "whole", workers=1)
    assert len(whole.rows) == 30
    assert (whole.rows["status"] == "ok").all()
    pd.testing.assert_frame_equal(resumed.rows, whole.rows, check_exact=True)
    for name in ("sweep.csv", "sweep.parquet", "manifest.json"):
        assert (target / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


TO_A_PERCENT = SolverSettings(tolerance=1e-2)
GROUPS = (0.01, 0.0105, 0.011, 0.0115, 0.03, 0.031, 0.032, 0.033)


@pytest.fixture(scope="module")
def actuator():
    lower = magnet(1.3, 0.01, 0.01, z_min=-0.01, name="lower")
    return device("pair", fixed=[lower], moving=[magnet(1.3, 0.01, 0.01)], distances=GROUPS)


@pytest.fixture(scope="module")
def to_a_percent(actuator, tmp_path_factory):
    directory, calls = tmp_path_factory.mktemp("whole"), []
    table = run(actuator, directory, progress=lambda at: calls.append((at.points_done, at.points)))
    return directory, table, calls


def run(actuator, directory, workers=1, **options):
    sweep_task.MESHES.clear()  # as in a new process
    return run_sweep(actuator, directory, workers=workers, settings=TO_A_PERCENT, **options)


def test_a_sweep_cut_anywhere_ends_in_the_table_of_one_never_cut(actuator, to_a_percent, tmp_path, monkeypatch):
    directory, expected, calls = to_a_percent
    assert calls == [(done, 8) for done in range(9)]
    lines = (directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    assert len(lines) == 1 + len(GROUPS)
    searches = []
    search = tolerance_module.meet_tolerance
    monkeypatch.setattr("femfit.field.problem.meet_tolerance", lambda *given: searches.append(given) or search(*given))
    for kept in (2, 6):
        target = tmp_path / str(kept)
        target.mkdir()
        (target / "journal.jsonl").write_bytes(b"".join(lines[:kept]) + lines[kept][:30])
        chosen = sum("choice" in json.loads(line).get("result", json.loads(line)) for line in lines[:kept])
        assert chosen == min(kept - 1, 2)
        searches.clear()
        resumed = run(actuator, target)
        assert len(searches) == 2 - chosen  # what the journal has is not searched again
        pd.testing.assert_frame_equal(resumed.rows, expected.rows, check_exact=True)


def test_a_worker_that_dies_at_a_level_costs_that_group_until_the_command_is_given_again(
    actuator, to_a_percent, tmp_path, monkeypatch
):
    solve = sweep_task.solve_task
    monkeypatch.setattr(
        sweep_task, "solve_task", lambda task: dict(DIED) if task.distance == GROUPS[0] else solve(task)
    )
    assert summarise(run(actuator, tmp_path))["failures"] == {DIED["status"]: 4}
    monkeypatch.undo()
    pd.testing.assert_frame_equal(run(actuator, tmp_path).rows, to_a_percent[1].rows, check_exact=True)
