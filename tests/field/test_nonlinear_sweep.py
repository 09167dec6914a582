"""Sweeps of saturating actuators as runs: columns, points that do not converge, resumption, workers."""

import shutil

import numpy as np
import pandas as pd
import pytest

from femfit.core.sweep_columns import COLUMNS
from femfit.field import newton as current_path
from femfit.field import nonlinear_system, sweep_task
from femfit.field import sweep as sweep_module
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import failed_points, summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import magnet, swept_at
from support.saturating import bobbin, rows_at

QUICK = SolverSettings(order=3)
CURRENTS = (-2.0, 0.0, 2.0, 8.0)


@pytest.fixture(scope="module")
def actuator():
    body = [magnet(1.2, 0.0055, 0.003, permeability=1.05)]
    return bobbin(distances=(0.008, 0.009, 0.01, 0.011), currents=CURRENTS, mover=body)


@pytest.fixture(scope="module")
def directory(actuator, tmp_path_factory):
    """Of a sweep that was solved to its end."""
    place = tmp_path_factory.mktemp("whole")
    run_sweep(actuator, place, workers=1, settings=QUICK)
    return place


@pytest.fixture(scope="module")
def whole(directory):
    return read_sweep_table(directory)


def test_table_has_the_contracts_columns_with_iterations_and_residual(whole, actuator, tmp_path):
    assert list(whole.rows.columns) == list(COLUMNS)
    assert (whole.rows["status"] == "ok").all()
    assert whole.rows["newton_iterations"].between(1, 40).all()
    assert whole.rows["newton_residual"].between(0.0, 1e-8).all()
    assert len(whole.rows) == len(CURRENTS) * len(actuator.sweep.distances_m)
    assert not whole.rows.isna().any(axis=None)


@pytest.mark.nightly
def test_a_sweep_cut_short_resumes_to_the_same_table_bit_for_bit(whole, directory, actuator, tmp_path):
    shutil.copytree(directory, tmp_path, dirs_exist_ok=True)
    journal = tmp_path / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    for kept in (2, 4):
        journal.write_bytes(b"".join(lines[:kept]) + lines[kept][:30])
        sweep_task.MESHES.clear()  # as in a new process
        resumed = run_sweep(actuator, tmp_path, workers=1, settings=QUICK)
        pd.testing.assert_frame_equal(whole.rows, resumed.rows, check_exact=True)


def failing_at(current, minimise):
    """Newton's iteration given up at one current after two corrections."""

    def limited(system, i, start, **options):
        return minimise(system, i, start, limit=2 if i == current else 60, **options)

    return limited


def test_a_point_that_does_not_converge_is_a_row_and_the_others_go_on(actuator, tmp_path, monkeypatch):
    monkeypatch.setattr(current_path, "minimise", failing_at(2.0, current_path.minimise))
    sweep_task.MESHES.clear()
    few = swept_at(actuator, (0.008,))
    table = run_sweep(few, tmp_path, workers=1, settings=QUICK)
    rows = table.rows.set_index("current_A")
    assert rows.loc[2.0, "status"].startswith("failed")
    (line,) = failed_points(table)
    assert "8 mm (2 A)" in line
    assert rows.loc[2.0, "newton_iterations"] == 2
    assert np.isnan(rows.loc[2.0, ["force_N", "flux_linkage_Wb", "hall_T"]].astype(float)).all()
    good = rows.drop(index=2.0)
    assert (good["status"] == "ok").all()
    assert np.isfinite(good["force_N"]).all()
    assert summarise(table)["failed"] == 1
    assert len(read_sweep_table(tmp_path).valid_rows()) == 3
    sweep_task.MESHES.clear()
    monkeypatch.setattr(sweep_module, "solve_task", lambda task: pytest.fail(f"{task.distance} solved again"))
    again = run_sweep(few, tmp_path, workers=1, settings=QUICK)  # its journal is read, missing fields and all
    pd.testing.assert_frame_equal(again.rows, table.rows, check_exact=True)


def test_a_point_whose_inductance_does_not_converge_is_not_passed_as_solved(actuator, tmp_path, monkeypatch):
    monkeypatch.setattr(nonlinear_system, "RESPONSE_LIMIT", 0)
    sweep_task.MESHES.clear()
    near = swept_at(actuator, (0.008,))
    rows = run_sweep(near, tmp_path, workers=1, settings=QUICK).rows
    assert rows["status"].str.startswith("failed").all()
    assert rows["inductance_H"].isna().all()


def test_currents_of_both_signs_start_from_the_weakest_and_do_not_change_the_result(actuator):
    alone = swept_at(actuator, currents=(8.0,))
    together = rows_at(actuator, 0.009, QUICK)
    # Both end within a tenth of the iteration's tolerance of 1e-8 of the same minimum.
    for column in ("force_N", "flux_linkage_Wb", "hall_T"):
        assert together[column][3] == pytest.approx(rows_at(alone, 0.009, QUICK)[column][0], rel=1e-7)


def test_reversed_current_and_magnet_give_the_same_force_and_flux_of_opposite_sign():
    def solved(remanence, currents):
        body = [magnet(remanence, 0.0055, 0.003, permeability=1.05)]
        return rows_at(bobbin(distances=(0.006,), currents=currents, mover=body), settings=QUICK)

    plain, reverse = solved(1.2, (-5.0, 5.0)), solved(-1.2, (-5.0, 5.0))
    np.testing.assert_allclose(plain["force_N"], reverse["force_N"][::-1], rtol=1e-7)
    np.testing.assert_allclose(plain["flux_linkage_Wb"], -reverse["flux_linkage_Wb"][::-1], rtol=1e-7)
    np.testing.assert_allclose(plain["inductance_H"], reverse["inductance_H"][::-1], rtol=1e-6)
