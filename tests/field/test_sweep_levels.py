"""Sweeps to a tolerance: a group's level is chosen once, by its first distance's task, and kept in the journal."""

import json

import pandas as pd
import pytest

from femfit.field import sweep_task
from femfit.field import tolerance as tolerance_module
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.sweep_task import DIED
from femfit.field.tolerance import SolverSettings
from support.actuators import device, magnet

SETTINGS = SolverSettings(tolerance=1e-2)
DISTANCES = (0.01, 0.0105, 0.011, 0.0115, 0.03, 0.031, 0.032, 0.033)


@pytest.fixture(scope="module")
def actuator():
    lower = magnet(1.3, 0.01, 0.01, z_min=-0.01, name="lower")
    return device("pair", fixed=[lower], moving=[magnet(1.3, 0.01, 0.01)], distances=DISTANCES)


@pytest.fixture(scope="module")
def whole(actuator, tmp_path_factory):
    directory, calls = tmp_path_factory.mktemp("whole"), []
    table = run(actuator, directory, progress=lambda at: calls.append((at.points_done, at.points)))
    return directory, table, calls


def run(actuator, directory, workers=1, **options):
    sweep_task.MESHES.clear()  # as in a new process
    return run_sweep(actuator, directory, workers=workers, settings=SETTINGS, **options)


def test_a_sweep_cut_anywhere_ends_in_the_table_of_one_never_cut(actuator, whole, tmp_path, monkeypatch):
    directory, expected, calls = whole
    assert calls == [(done, 8) for done in range(9)]
    lines = (directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    assert len(lines) == 1 + len(DISTANCES)
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
    actuator, whole, tmp_path, monkeypatch
):
    solve = sweep_task.solve_task
    monkeypatch.setattr(
        sweep_task, "solve_task", lambda task: dict(DIED) if task.distance == DISTANCES[0] else solve(task)
    )
    assert summarise(run(actuator, tmp_path))["failures"] == {DIED["status"]: 4}
    monkeypatch.undo()
    pd.testing.assert_frame_equal(run(actuator, tmp_path).rows, whole[1].rows, check_exact=True)
