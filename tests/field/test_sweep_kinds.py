"""Sweeps without a circuit, with several and of iron that saturates: columns, points that fail, reading back."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.numerics import MU_0
from femfit.device.parts import Coil, NonlinearMaterial
from femfit.field import newton as current_path
from femfit.field import sweep_task
from femfit.field.nonlinear_system import NonlinearSystem
from femfit.field.point_rows import NO_CONVERGENCE, UNSOLVED
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import failed_points, summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import STEEL, device, linear, magnet, rectangle, swept_at
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


@pytest.fixture(scope="module", params=["linear", "saturating"])
def swept(request, tmp_path_factory):
    """A steel body between two coils, one of which it passes."""
    coils = [
        Coil(rectangle(0.012, 0.016, -0.006, 0.0), 200.0, 1.0, name="lower"),
        Coil(rectangle(0.012, 0.016, 0.014, 0.02), 200.0, 1.0, name="upper"),
    ]
    body = replace(magnet(0.0, 0.008, 0.006, name="body"), material=STEEL)
    currents, distances = ((0.0, 1.0), (-1.0, 0.0, 2.0)), (-0.002, 0.0, 0.003)
    actuator = device("two", coils=coils, moving=[body], currents=currents, distances=distances)
    actuator = linear(actuator) if request.param == "linear" else actuator
    directory = tmp_path_factory.mktemp(request.param)
    sweep_task.MESHES.clear()
    return actuator, directory, run_sweep(actuator, directory, workers=1, settings=QUICK)


def test_all_combinations_of_two_circuits_currents_are_swept_and_read_back(swept):
    _, directory, table = swept
    rows = table.rows
    assert (rows["status"] == "ok").all()
    assert len(rows) == 2 * 3 * 3
    assert not rows.duplicated(["current_lower_A", "current_upper_A", "distance_m"]).any()
    assert rows["distance_m"].min() == -0.002
    needed = {"flux_linkage_lower_Wb", "flux_linkage_upper_Wb", "inductance_lower_H", "inductance_upper_H"}
    assert needed | {"inductance_lower_upper_H", "coenergy_J", "force_error_N"} <= set(rows)
    assert not {"current_A", "flux_linkage_Wb", "inductance_H"} & set(rows)
    pd.testing.assert_frame_equal(read_sweep_table(directory).rows, table.rows)
    summary = summarise(table)
    assert summary["failed"] == 0
    assert summary["force_min_N"] < 0.0 < summary["force_max_N"]


def test_two_circuits_flux_linkages_are_affine_in_their_inductances(swept):
    actuator, _, table = swept
    if any(region.material == STEEL for region in actuator.moving.regions):
        pytest.skip("a property of linear devices")
    for _, rows in table.rows.groupby("distance_m"):
        mutual = rows["inductance_lower_upper_H"] * rows["current_upper_A"]
        np.testing.assert_allclose(
            rows["flux_linkage_lower_Wb"], rows["inductance_lower_H"] * rows["current_lower_A"] + mutual, rtol=1e-9
        )


@pytest.mark.parametrize("tolerance", [None, 1e-2])
def test_a_pair_of_magnets_is_swept_without_a_current(tmp_path, tolerance):
    pair = device(
        "pair",
        fixed=[magnet(1.3, 0.02, 0.04, z_min=-0.04, name="lower")],
        moving=[magnet(1.3, 0.02, 0.04)],
        distances=(0.01, 0.02),
    )
    sweep_task.MESHES.clear()
    table = run_sweep(pair, tmp_path, workers=1, settings=SolverSettings(tolerance=tolerance))
    assert table.rows["current_A"].eq(0.0).all()
    assert not {"flux_linkage_Wb", "inductance_H", "hall_T"} & set(table.rows)
    assert table.rows["force_N"][0] == pytest.approx(265.537, rel=2e-4 if tolerance is None else tolerance)
    assert len(read_sweep_table(tmp_path).valid_rows()) == 2
