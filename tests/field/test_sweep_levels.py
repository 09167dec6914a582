"""Sweeps to a tolerance: a group's level is chosen once, by one worker, and kept in the journal."""

import json

import pandas as pd
import pytest

from femfit.device.load import read_actuator
from femfit.field import sweep as sweep_module
from femfit.field import sweep_task
from femfit.field import tolerance as tolerance_module
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.sweep_task import DIED, LevelTask
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, swept_at

SETTINGS = SolverSettings(tolerance=1e-2)
DISTANCES = (0.015, 0.016, 0.017, 0.018, 0.03, 0.033, 0.036, 0.039)


@pytest.fixture(scope="module")
def actuator():
    """Two groups of four distances."""
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    return swept_at(rig, DISTANCES)


@pytest.fixture(scope="module")
def whole(actuator, tmp_path_factory):
    """Directory, table, and what the progress said."""
    directory, calls = tmp_path_factory.mktemp("whole"), []
    table = run(actuator, directory, progress=lambda at: calls.append((at.points_done, at.points)))
    return directory, table, calls


def run(actuator, directory, workers=1, **options):
    sweep_task.MESHES.clear()  # as in a new process
    return run_sweep(actuator, directory, workers=workers, settings=SETTINGS, **options)


def test_progress_counts_points_and_no_levels(whole):
    _, _, calls = whole
    counts = [done for done, _ in calls]
    assert sorted(set(counts)) == [8 * k for k in range(9)]
    assert {total for _, total in calls} == {64}


def test_a_sweep_cut_anywhere_ends_in_the_table_of_one_never_cut(actuator, whole, tmp_path, monkeypatch):
    directory, expected, _ = whole
    lines = (directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    assert len(lines) == 1 + 2 + len(DISTANCES)
    searches = []
    search = tolerance_module.meet_tolerance
    monkeypatch.setattr("femfit.field.problem.meet_tolerance", lambda *given: searches.append(given) or search(*given))
    for kept in range(1, len(lines), 4):
        target = tmp_path / str(kept)
        target.mkdir()
        (target / "journal.jsonl").write_bytes(b"".join(lines[:kept]) + lines[kept][:30])
        levels = sum("level" in json.loads(line).get("key", "") for line in lines[:kept])
        searches.clear()
        resumed = run(actuator, target)
        assert len(searches) == 2 - levels  # what the journal has is not searched again
        pd.testing.assert_frame_equal(resumed.rows, expected.rows, check_exact=True)


def test_a_worker_that_dies_at_a_level_costs_that_group_until_the_command_is_given_again(
    actuator, whole, tmp_path, monkeypatch
):
    solve = sweep_module.solve_task

    def die(task):
        return dict(DIED) if isinstance(task, LevelTask) and 0.015 in task.mesh.distances else solve(task)

    monkeypatch.setattr(sweep_module, "solve_task", die)
    summary = summarise(run(actuator, tmp_path))
    assert summary["failures"] == {DIED["status"]: 32}
    monkeypatch.undo()
    pd.testing.assert_frame_equal(run(actuator, tmp_path).rows, whole[1].rows, check_exact=True)
