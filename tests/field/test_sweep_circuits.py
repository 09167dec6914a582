"""Sweeps of actuators without a circuit and with several: columns, journal, reading back."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.device.parts import Coil
from femfit.field import sweep_task
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import STEEL, device, linear, magnet, rectangle
from support.field import QUICK


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
