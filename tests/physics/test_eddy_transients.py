"""Eddy currents in time: a step of voltage against time steps of the field, and a magnet that a tube brakes."""

import numpy as np
import pytest

from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from support import falling_magnet as fall
from support.eddy_transient import mesh_for, pot_step


def test_without_a_winding_there_is_braking_and_nothing_else():
    actuator = fall.drawing()
    found, _ = EddyProbe(actuator, mesh_for(actuator, 0.0, 10.0), 0.0, ORDER).transfers(np.array([10.0]))
    assert found.flux_linkage.shape == (1, 0, 0)
    assert found.force.shape == (1, 1, 0)


@pytest.mark.nightly
def test_a_step_of_voltage_on_a_solid_pot_is_that_of_the_field():
    steps, current, flux = pot_step()
    assert steps < 0.001  # what halving the time steps changes
    assert max(current, flux) < 0.01  # as asked for


@pytest.mark.nightly
def test_a_magnet_falls_through_a_tube_as_fast_as_its_weight_is_braked():
    model, late = fall.fallen()
    distances = np.linspace(-8.9e-3, 8.9e-3, 200)
    braking = (model.eddy.forms(distances, 1)[0].flux_linkage ** 2).sum(axis=-1)
    exact = fall.braking_of_cylinder(fall.RADIUS)
    assert np.abs(braking / exact - 1.0).max() < 0.005  # as asked for, between the sweep's distances too
    weight = fall.MASS * fall.GRAVITY
    assert fall.speed() == pytest.approx(weight / exact, rel=0.002)
    heat = sum(late[name] ** 2 for name in model.eddy_names)  # each of 1 ohm
    mean = np.trapezoid(heat, late["time_s"]) / np.ptp(late["time_s"])
    assert mean == pytest.approx(weight * fall.speed(), rel=0.002)
