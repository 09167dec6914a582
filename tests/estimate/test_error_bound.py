"""The bound is the closed form where there is one, filters reach it and none is below it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from femfit.device.electrics import CurrentSensor
from femfit.estimate.error_bound import bound_along, error_bound
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.noise import FilterNoise
from support.readings import LASER
from support.solenoids import REACH_H_M, SHIFT_M, inductance, solenoid

SHUNT = CurrentSensor(name="current", noise=2e-3, circuit="coil")
FREE = replace(solenoid().motion, near_stop=None, far_stop=None)


@pytest.fixture(scope="module")
def model():
    return replace(solenoid(FREE), sample_time_s=1e-4, other_sensors=(SHUNT, LASER))


def test_without_current_the_coil_s_current_says_nothing_of_the_distance(model):
    """L(d) i and F(d, i) have no slope in the distance at i = 0: self-sensing is blind at rest without excitation."""
    bound = error_bound(model, sensors=("current",), distances_m=(2e-3,), currents_A=(0.0, 1.0))
    assert bound.observed[:, 0].tolist() == [False, True]
    assert error_bound(model, distances_m=(2e-3,), currents_A=(0.0,)).observed[0, 0]  # the laser needs none


SIGMA_A, STEP_S = 4e-3, 2e-5


SILENT = FilterNoise(acceleration_density=1e-24, voltage_V=1e-9, hall_V=1.0)


@pytest.fixture(scope="module")
def sampled():
    shunt = CurrentSensor(name="current", noise=SIGMA_A, circuit="coil")
    return replace(solenoid(FREE), sample_time_s=STEP_S, other_sensors=(shunt,))


def moved(start, volts):
    """Distance, velocity and current at every sample, from m d'' and U = R i + (L i)' as they stand in a textbook."""

    def rates(_, x, u):
        slope = -REACH_H_M / (x[0] + SHIFT_M) ** 2
        force = -0.5 * slope * x[2] ** 2
        push = 0.1 - 200.0 * (x[0] - 4e-3)
        return [x[1], (push - force) / 0.025, (u - 20.0 * x[2] - slope * x[1] * x[2]) / inductance(x[0])]

    states = [np.asarray(start, float)]
    for u in volts[1:]:
        found = solve_ivp(rates, (0.0, STEP_S), states[-1], args=(u,), rtol=1e-10, atol=1e-14)
        states.append(found.y[:, -1])
    return np.array(states)


def test_the_bound_of_a_stroke_is_the_fisher_information_of_simulated_currents(sampled):
    """d z / d(start) and d(end) / d(start) by differences of whole simulations, with no Jacobian of femfit's."""
    volts = np.full(250, 12.0)
    start, spread = np.array([3.5e-3, 0.0, 0.3]), np.array([1e-3, 0.05, 0.1])
    nominal = moved(start, volts)
    steps = 1e-4 * spread
    slopes = np.stack([(moved(start + h, volts) - moved(start - h, volts)) / (2.0 * k)
                       for k, h in zip(steps, np.diag(steps), strict=True)], axis=-1)  # fmt: skip
    information = np.diag(spread**-2.0) + np.einsum("ka,kb->ab", slopes[:, 2], slopes[:, 2]) / SIGMA_A**2
    end = slopes[-1]
    wanted = np.sqrt(np.diag(end @ np.linalg.inv(information) @ end.T))
    process = kalman_filter(sampled, sensors=("current",), noise=SILENT).process
    found = np.sqrt(np.diag(bound_along(process, nominal, volts)[-1]))
    np.testing.assert_allclose(found, wanted, rtol=0.04)  # h R / L = 0.03 of Euler's step


def test_with_a_test_voltage_the_bound_at_rest_is_that_of_an_inductance_that_is_measured(sampled):
    """A body too heavy to move: di/dd of an R-L circuit in closed form, summed over the readings."""
    heavy = replace(sampled, motion=replace(sampled.motion, mass_kg=1e9, springs=()))
    process = kalman_filter(heavy, sensors=("current",), noise=SILENT).process
    process = replace(process, start_covariance=np.diag([1e-3, 1e-12, 1e-12]) ** 2)
    volts = 3.0 * np.where(np.arange(400) % 40 < 20, 1.0, -1.0)

    def current(distance):
        decay, found = np.exp(-20.0 * STEP_S / inductance(distance)), [0.0]
        for u in volts[1:]:
            found.append(u / 20.0 + (found[-1] - u / 20.0) * decay)
        return np.array(found)

    at, h = 2e-3, 1e-7
    slope = (current(at + h) - current(at - h)) / (2.0 * h)
    states = np.stack([np.full(400, at), np.zeros(400), current(at)], axis=1)
    wanted = (1e6 + np.sum(slope**2) / SIGMA_A**2) ** -0.5
    found = np.sqrt(bound_along(process, states, volts)[-1, 0, 0])
    assert found == pytest.approx(wanted, rel=0.04)  # h R / L = 0.03 of Euler's step
