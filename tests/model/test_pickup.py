"""A pickup coil's voltage: the closed form of a share of a winding, the flux that it adds up to, and the file."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from femfit.device.electrics import PositionSensor
from femfit.model.dynamics import state_derivative
from femfit.model.sensors import predict_sensor, sample_weights, sampled_readings
from support.one_current import flat
from tests.support.pickups import SHARE, STEP_S, flux_linkage, searched


@pytest.fixture(scope="module")
def model():
    return searched(noise=1e-3)


def coil(model):
    return model.other_sensors[-1]


def test_the_voltage_is_the_windings_share_of_what_its_resistance_leaves(model):
    """u = share d(L i)/dt = share (U - R i), whatever the body does."""
    states = np.array([[2e-3, 0.1, 0.5], [3e-3, -0.2, 1.0], [1e-3, 0.0, 0.2]])
    volts = np.array([12.0, -3.0, 0.0])
    found = predict_sensor(model, coil(model), states, voltage=volts)
    np.testing.assert_allclose(found, SHARE * (volts - 20.0 * states[:, 2]), rtol=1e-4)  # of the fitted splines


def test_what_the_winding_would_pull_is_the_slope_of_its_flux_linkage(model):
    """One ampere in the pickup coil adds dF = -d(lambda)/dd: a share of what an ampere in the winding adds."""
    d, i = np.array([1e-3, 2e-3, 3.5e-3]), np.array([0.3, 0.8, 1.0])
    _, slope, mutual = coil(model).flux.derivatives(d, i[:, None])
    np.testing.assert_allclose(-slope, SHARE * flat(model.magnetics).state(d, i).motional_constant, rtol=1e-3)
    np.testing.assert_allclose(mutual[:, 0], SHARE * flat(model.magnetics).inductance(d, i), rtol=1e-4)


def test_the_voltage_of_a_motion_adds_up_to_the_change_of_flux_linkage(model):
    def rates(_, x):
        state = x[None, :3]
        volts = np.array([12.0])
        reading = predict_sensor(model, coil(model), state, voltage=volts)
        return np.concatenate([state_derivative(model, state, volts)[0], reading])

    start = np.array([3.5e-3, 0.0, 0.1])
    end = solve_ivp(rates, (0.0, 5e-3), [*start, 0.0], rtol=1e-10, atol=1e-13).y[:, -1]
    change = coil(model).flux.field(end[:1], end[2:3]) - coil(model).flux.field(start[:1], start[2:3])
    assert end[3] == pytest.approx(change[0], rel=1e-8)


def test_readings_add_up_to_the_change_of_flux_linkage_between_samples(model):
    time = STEP_S * np.arange(50)
    states = np.stack([3e-3 - 0.2 * time, np.full(50, -0.2), 0.2 + 30.0 * time], axis=1)
    read = sampled_readings(model, coil(model), states)
    linked = flux_linkage(states[:, 0], states[:, 2])
    assert read[0] == 0.0  # before the first sample nothing moved
    assert STEP_S * read.sum() == pytest.approx(linked[-1] - linked[0], rel=1e-4)


def test_a_reading_that_is_late_by_a_part_of_a_sample_lies_between_two():
    laser = PositionSensor(name="laser", distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m", delay_s=2.25e-4)
    np.testing.assert_allclose(sample_weights(laser, 1e-4), [0.0, 0.0, 0.75, 0.25], atol=1e-9)
    np.testing.assert_allclose(sample_weights(replace(laser, delay_s=3e-4), 1e-4), [0.0, 0.0, 0.0, 1.0])
    assert sample_weights(replace(laser, delay_s=0.0), 1e-4).tolist() == [1.0]


def test_a_late_pickup_coil_reads_the_difference_of_earlier_samples(model):
    late = replace(coil(model), delay_s=STEP_S)
    np.testing.assert_allclose(sample_weights(late, STEP_S) * STEP_S, [0.0, 1.0, -1.0], atol=1e-12)
