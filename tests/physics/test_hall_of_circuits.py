"""A Hall element between the magnets of a bearing reads the field of both currents, as a direct solution gives it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.device.electrics import HallElement, PickupCoil
from femfit.device.load import read_actuator, sweep_manifest_entry
from femfit.field.layout import layout_of
from femfit.field.problem import LinearActuator
from femfit.field.tolerance import SolverSettings
from femfit.fit.build import fit_model
from femfit.tables.sweep_table import SweepTable
from support.actuators import GEOMETRY, linear, millimetres, swept_at

DISTANCES = tuple(np.linspace(0.3e-3, 0.7e-3, 6).tolist())
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [-1.0, 1.0]])


def drawn(distances):
    """The bearing with an element beside the disk, half way between the magnets, and a winding on the upper one."""
    found = swept_at(linear(read_actuator(GEOMETRY / "bearing.toml")), distances)
    element = HallElement(0.044, 0.0055, sensitivity_V_per_T=50.0, noise_V=2e-3, delay_s=1e-4)
    search = PickupCoil(name="search", vertices_m=millimetres(19, 31, 12, 13), turns=20.0, noise=1e-3)
    return replace(found, sensors=(element, search))


def solved(actuator, distance, currents):
    settings = SolverSettings(order=3, corner_fraction=0.3)  # of both sides alike
    return LinearActuator(actuator, (distance,), layout_of(actuator, settings), settings, estimate=False).rows(
        distance, currents
    )


@pytest.mark.nightly
def test_field_and_flux_linkage_between_the_sweeps_points_are_those_of_a_direct_solution():
    actuator, frames = drawn(DISTANCES), []
    for d in DISTANCES:
        rows = pd.DataFrame(solved(actuator, d, POINTS))
        names = {f"current_{circuit.name}_A": POINTS[:, k] for k, circuit in enumerate(actuator.circuits)}
        frames.append(rows.assign(distance_m=d, status="ok", **names))
    table = SweepTable(pd.concat(frames, ignore_index=True), {"actuator": sweep_manifest_entry(actuator)})
    fit = fit_model(table)
    assert not [note for note in fit.notes if "not in the model" in note]
    model, distance = fit.model, 0.45e-3
    currents = np.array([[0.7, -0.4], [-0.3, 0.9]])
    direct = solved(drawn((distance,)), distance, currents)
    at = np.full(2, distance)
    span = np.ptp(direct["hall_T"])
    np.testing.assert_allclose(model.sensor.field.field(at, currents), direct["hall_T"], atol=3e-3 * span)
    (search,) = (one for one in model.other_sensors if one.name == "search")
    np.testing.assert_allclose(search.flux.field(at, currents), direct["pickup_search_Wb"], rtol=2e-3)
    assert model.sensor.delay_s == 1e-4
    _, _, slopes = model.sensor.field.derivatives(np.array([0.5e-3]), np.array([[0.0, 0.0]]))
    assert np.all(np.abs(slopes) > 0.5 * np.abs(slopes).max())
