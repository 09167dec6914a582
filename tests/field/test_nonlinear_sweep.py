"""Sweeps of saturating actuators as runs: columns, points that do not converge, resumption, workers."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.numerics import MU_0
from femfit.device.parts import NonlinearMaterial
from femfit.field import newton as current_path
from femfit.field import sweep_task
from femfit.field.nonlinear_system import NonlinearSystem
from femfit.field.point_rows import NO_CONVERGENCE, UNSOLVED
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import failed_points, summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import magnet, swept_at
from support.field import QUICK
from support.saturating import bobbin, rows_at

CURRENTS = (-2.0, 0.0, 2.0, 8.0)


@pytest.fixture(scope="module")
def actuator():
    body = [magnet(1.2, 0.0055, 0.003, permeability=1.05)]
    return bobbin(distances=(0.008, 0.009, 0.01, 0.011), currents=CURRENTS, mover=body)


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
    assert "at 8 mm" in line
    assert rows.loc[2.0, "newton_iterations"] == 2
    assert np.isnan(rows.loc[2.0, ["force_N", "flux_linkage_Wb", "hall_T"]].astype(float)).all()
    good = rows.drop(index=2.0)
    assert (good["status"] == "ok").all()
    assert np.isfinite(good["force_N"]).all()
    assert summarise(table)["failed"] == 1
    assert len(read_sweep_table(tmp_path).valid_rows()) == 3
    sweep_task.MESHES.clear()
    monkeypatch.setattr(sweep_task, "solve_task", lambda task: pytest.fail(f"{task.distance} solved again"))
    again = run_sweep(few, tmp_path, workers=1, settings=QUICK)  # its journal is read, missing fields and all
    pd.testing.assert_frame_equal(again.rows, table.rows, check_exact=True)


def kinked():
    """A curve within the limits of materials that Newton's iteration does not get over."""
    steps = [(0.1, 0.1 / (1.5e6 * MU_0)), (0.002, 0.002 / (1.001 * MU_0))] * 16
    b, h = np.cumsum([(0.0, 0.0), *steps], axis=0).T
    return NonlinearMaterial("kinked", tuple(b), tuple(h))


@pytest.mark.parametrize(
    ("currents", "solve", "message"),
    [
        ((0.0, 8.0), None, f"1 point {NO_CONVERGENCE}; at 5 mm with 8 A. Check the B-H curve"),
        ((0.0, 2.0), lambda _, load: 1e-9 * load, f"1 point {UNSOLVED}; at 5 mm with 2 A. Look there"),  # nowhere
    ],
)
def test_points_that_fail_are_named_with_what_their_equations_show_as_the_cause(
    currents, solve, message, tmp_path, monkeypatch
):
    monkeypatch.setattr(NonlinearSystem, "solve", solve or NonlinearSystem.solve)
    sweep_task.MESHES.clear()
    table = run_sweep(bobbin(kinked(), currents=currents), tmp_path, workers=1, settings=SolverSettings(order=3))
    sweep_task.MESHES.clear()
    (line,) = failed_points(table)
    assert line.startswith(message)


def test_currents_of_both_signs_start_from_the_weakest_and_do_not_change_the_result(actuator):
    alone = swept_at(actuator, currents=(8.0,))
    together = rows_at(actuator, 0.009, QUICK)
    # Both end within a tenth of the iteration's tolerance of 1e-8 of the same minimum.
    for column in ("force_N", "flux_linkage_Wb", "hall_T"):
        assert together[column][3] == pytest.approx(rows_at(alone, 0.009, QUICK)[column][0], rel=1e-7)
