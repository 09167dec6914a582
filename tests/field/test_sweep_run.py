"""The sweep as a run: table, journal, resumption, workers that die."""

import dataclasses
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import FieldSolverError
from femfit.core.sweep_columns import COLUMNS
from femfit.device.load import read_actuator
from femfit.field import sweep as sweep_module
from femfit.field import sweep_task
from femfit.field.sweep import plan_sweep, run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import GEOMETRY

QUICK = SolverSettings(order=3)


@pytest.fixture(scope="module")
def rig():
    return read_actuator(GEOMETRY / "emaws-rig.toml")


def with_distances(actuator, distances):
    return dataclasses.replace(actuator, sweep=dataclasses.replace(actuator.sweep, distances_m=tuple(distances)))


@pytest.fixture(scope="module")
def few(rig):
    return with_distances(rig, (0.015, 0.02, 0.03, 0.045))


def test_table_has_the_contracts_columns_one_row_a_point(few, tmp_path):
    table = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    assert list(table.rows.columns) == [name for name in COLUMNS if not name.startswith("newton_")]
    assert len(table.rows) == 4 * len(few.sweep.currents_A)
    assert not table.rows.duplicated(["current_A", "distance_m"]).any()
    again = read_sweep_table(tmp_path)
    pd.testing.assert_frame_equal(again.rows, table.rows)
    assert again.manifest["actuator"]["mass_kg"] == few.mechanics.mass_kg
    assert again.manifest["versions"]["ngsolve"]
    csv = pd.read_csv(tmp_path / "sweep.csv")
    np.testing.assert_array_equal(csv["force_N"], table.rows["force_N"])


def test_an_actuator_without_hall_element_has_no_hall_column(few, tmp_path):
    table = run_sweep(
        with_distances(dataclasses.replace(few, sensors=()), (0.02,)), tmp_path, workers=1, settings=QUICK
    )
    assert "hall_T" not in table.rows


def test_two_processes_give_the_numbers_of_one(few, tmp_path):
    one = run_sweep(few, tmp_path / "one", workers=1, settings=QUICK)
    two = run_sweep(few, tmp_path / "two", workers=2, settings=QUICK)
    pd.testing.assert_frame_equal(one.rows, two.rows, check_exact=True)


def test_progress_counts_rows_up_to_all(few, tmp_path):
    calls = []
    run_sweep(few, tmp_path, workers=1, settings=QUICK, progress=lambda at: calls.append((at.points_done, at.points)))
    assert [done for done, _ in calls] == [0, 8, 16, 24, 32]
    assert {total for _, total in calls} == {32}


def test_a_finished_sweep_is_not_solved_again(few, tmp_path, monkeypatch):
    first = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    monkeypatch.setattr(sweep_module, "solve_task", lambda task: pytest.fail(f"{task.distance} solved again"))
    again = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    pd.testing.assert_frame_equal(first.rows, again.rows, check_exact=True)


def test_an_edited_drawing_is_solved_anew_in_the_same_directory_and_the_old_one_costs_nothing(few, tmp_path):
    states = []
    first = run_sweep(few, tmp_path, workers=1, settings=QUICK, progress=states.append)
    assert not any(state.changed for state in states)
    other = dataclasses.replace(few, coils=(dataclasses.replace(few.coil, turns=100),))
    edited = run_sweep(other, tmp_path, workers=1, settings=QUICK, progress=states.append)
    assert states[-1].changed == ("the drawing",)
    assert not edited.rows["force_N"].equals(first.rows["force_N"])
    back = []
    again = run_sweep(few, tmp_path, workers=1, settings=QUICK, progress=back.append)
    assert back[0].points_done == back[0].points == len(first.rows)
    pd.testing.assert_frame_equal(first.rows, again.rows, check_exact=True)


def test_a_line_cut_short_in_the_journal_is_solved_again(few, tmp_path):
    first = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-40])
    again = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    pd.testing.assert_frame_equal(first.rows, again.rows, check_exact=True)


def test_a_journal_cut_in_its_first_line_starts_afresh(few, tmp_path):
    (tmp_path / "journal.jsonl").write_bytes(b'{"configuration_ha')
    assert summarise(run_sweep(with_distances(few, (0.02,)), tmp_path, workers=1, settings=QUICK))["failed"] == 0


def failing_at(distance, solve):
    def solve_or_fail(task):
        if task.distance == distance:
            return {"status": "failed: no mesh"}
        return solve(task)

    return solve_or_fail


def test_a_distance_that_fails_is_a_row_with_its_reason(few, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_module, "solve_task", failing_at(0.02, sweep_module.solve_task))
    table = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    failed = table.rows[table.rows["status"] != "ok"]
    assert set(failed["distance_m"]) == {0.02}
    assert failed["force_N"].isna().all()
    summary = summarise(table)
    assert summary["failed"] == 8
    assert summary["failures"] == {"failed: no mesh": 8}


def test_a_mesher_that_gives_up_is_a_status_and_no_crash(few, monkeypatch):
    def give_up(*_):
        raise FieldSolverError("no mesh")

    monkeypatch.setattr("femfit.field.problem.prepare", give_up)
    sweep_task.MESHES.clear()
    assert sweep_module.solve_task(plan_sweep(few, QUICK)[0]) == {"status": "failed: no mesh"}


def test_groups_cover_every_distance_once(rig):
    tasks = plan_sweep(rig, SolverSettings())
    assert [task.distance for task in tasks] == list(rig.sweep.distances_m)
    assert 1 < len({task.mesh for task in tasks}) < 6


def test_a_script_without_a_main_guard_sweeps_in_processes_and_ends(tmp_path):
    script = tmp_path / "sweep.py"
    text = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
    distances = "distance_mm = [18, 20, 22]"
    (tmp_path / "rig.toml").write_text(re.sub(r"(?m)^distance_mm = .*$", distances, text), encoding="utf-8")
    script.write_text(
        "from femfit.device.load import read_actuator\n"
        "from femfit.field.sweep import run_sweep\n"
        "table = run_sweep(read_actuator('rig.toml'), 'out', workers=2)\n"
        "print(len(table.rows), (table.rows['status'] == 'ok').all())\n",
        encoding="utf-8",
    )
    result = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.split() == ["24", "True"]
