"""The bound is the closed form where there is one, filters reach it and none is below it."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import FilterError
from femfit.device.electrics import CurrentSensor
from femfit.estimate.error_bound import bound_along, error_bound
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.noise import FilterNoise
from femfit.model.dynamics import exponential_step
from support.readings import LASER, predict_sensors
from support.solenoids import solenoid

SHUNT = CurrentSensor(name="current", noise=2e-3, circuit="coil")


@pytest.fixture(scope="module")
def model():
    free = replace(solenoid().motion, near_stop=None, far_stop=None)
    return replace(solenoid(free), sample_time_s=1e-4, other_sensors=(SHUNT, LASER))


def test_without_current_the_coil_s_current_says_nothing_of_the_distance(model):
    """L(d) i and F(d, i) have no slope in the distance at i = 0: self-sensing is blind at rest without excitation."""
    bound = error_bound(model, sensors=("current",), distances_m=(2e-3,), currents_A=(0.0, 1.0))
    assert bound.observed[:, 0].tolist() == [False, True]
    assert error_bound(model, distances_m=(2e-3,), currents_A=(0.0,)).observed[0, 0]  # the laser needs none


def test_the_bound_of_a_constant_distance_falls_with_the_root_of_the_readings(model):
    """n readings of a body that hardly moves and has no noise of its own: sigma / sqrt(n)."""
    still = replace(model, motion=replace(model.motion, mass_kg=1e9, springs=()))
    noise = FilterNoise(acceleration_density=1e-30, voltage_V=1e-6, hall_V=1.0)
    process = kalman_filter(still, sensors=("laser",), noise=noise).process
    process = replace(process, start_covariance=np.diag([1.0, 1e-9, 1e-9]) ** 2)
    states = np.tile([2e-3, 0.0, 0.0], (100, 1))
    found = bound_along(process, states, np.zeros(100))[:, 0, 0]
    np.testing.assert_allclose(np.sqrt(found), 2e-5 / np.sqrt(np.arange(1, 101)), rtol=1e-6)


def test_a_filter_reaches_the_bound_and_does_not_beat_it(model):
    """200 runs of one motion with its process noise; the mean square error scatters by 10 % (chi-square of 200)."""
    names, steps, runs = ("current", "laser"), 150, 200
    generator = np.random.default_rng(1)
    filter_ = kalman_filter(model, "ekf", sensors=names)
    process = filter_.process
    first = np.diag([1e-4, 0.01, 0.01])
    process = replace(process, start_covariance=first**2)
    filter_ = replace(filter_, process=process)
    factor = np.linalg.cholesky(process.process_covariance)
    volts = 4.0 + 3.0 * np.sign(np.sin(np.arange(steps) / 17.0))
    nominal = np.array([[3.5e-3, 0.0, 0.1]])
    truth = nominal + generator.standard_normal((runs, 3)) @ first
    state = filter_.start(nominal[0], runs=runs)
    states = [nominal[0]]
    for volt in volts[1:]:
        nominal = exponential_step(model, nominal, np.full(1, volt), model.sample_time_s)
        states.append(nominal[0])
        truth = exponential_step(model, truth, np.full(runs, volt), model.sample_time_s)
        truth = truth + generator.standard_normal((runs, 3)) @ factor.T
        readings = predict_sensors(model, truth, names) + generator.standard_normal((runs, 2)) * [2e-3, 2e-5]
        state = filter_.step(state, volt, readings)
    bound = bound_along(replace(process, start_covariance=first**2), np.array(states), volts)[-1]
    ratio = np.mean((state.mean - truth) ** 2, axis=0) / np.diag(bound)
    np.testing.assert_allclose(ratio, 1.0, atol=0.4)  # four deviations of a mean of 200 squares


def test_a_trajectory_of_other_length_than_its_inputs_is_refused(model):
    with pytest.raises(FilterError, match=r"3 .* 2"):
        bound_along(kalman_filter(model).process, np.zeros((3, 3)), np.zeros(2))
