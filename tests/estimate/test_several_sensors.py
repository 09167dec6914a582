"""A filter that reads several sensors is the one with a vector of measurements, whatever samples are missing."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor
from femfit.estimate.kalman_filter import kalman_filter
from support.readings import LASER, predict_sensors
from support.solenoids import solenoid
from support.steps import exponential_step

SHUNT = CurrentSensor(name="current", noise=2e-3, circuit="coil")
CELL, MEMS = ForceSensor(name="cell", noise=0.02), AccelerationSensor(name="mems", noise=0.5)
NOISE = {"current": 2e-3, "laser": 2e-5, "cell": 0.02, "mems": 0.5}


@pytest.fixture(scope="module")
def model():
    """A body on a spring that nothing stops, with the four sensors."""
    free = replace(solenoid().motion, near_stop=None, far_stop=None)
    return replace(solenoid(free), sample_time_s=1e-4, other_sensors=(SHUNT, LASER, CELL, MEMS))


def a_record(model, names, steps=300, seed=3, bias=0.0):
    """Truth (steps, 3), voltages (steps,) and readings (steps, sensors) of a coil that is fed with a square wave."""
    generator = np.random.default_rng(seed)
    volts = 4.0 + 3.0 * np.sign(np.sin(np.arange(steps) / 17.0))
    truth = np.empty((steps, 3))
    state = np.array([[3.5e-3, 0.0, 0.1]])
    for k, volt in enumerate(volts):
        state = exponential_step(model, state, np.array([volt]), model.sample_time_s)  # as the filters move
        truth[k] = state[0]
    noise = generator.standard_normal((steps, len(names))) * [NOISE[name] for name in names]
    return truth, volts, predict_sensors(model, truth, names) + noise + bias


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_one_after_the_other_is_all_at_once_for_linear_sensors(model, kind):
    """Against the matrix form of the update; the sensors read current and distance, which are linear."""
    filter_ = kalman_filter(model, kind, sensors=("laser", "current"))
    state = filter_.predict(filter_.start([3.5e-3, 0.0, 0.1]), 5.0)
    readings = np.array([3.6e-3, 0.12])
    H, R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.diag([2e-5**2, 2e-3**2])
    P, S = state.covariance[0], H @ state.covariance[0] @ H.T + R
    gain = P @ H.T @ np.linalg.inv(S)
    innovation = readings - H @ state.mean[0]
    updated = filter_.update(state, readings)
    np.testing.assert_allclose(updated.mean[0], state.mean[0] + gain @ innovation, rtol=1e-9)
    scale = np.outer(np.sqrt(np.diag(P)), np.sqrt(np.diag(P)))
    np.testing.assert_allclose(updated.covariance[0] / scale, (P - gain @ S @ gain.T) / scale, atol=1e-9)
    squared = innovation @ np.linalg.inv(S) @ innovation
    np.testing.assert_allclose(updated.normalised_innovation_squared, squared, rtol=1e-6)


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_sensor_whose_samples_are_all_missing_is_as_good_as_none(model, kind):
    both = kalman_filter(model, kind, sensors=("laser", "current"))
    one = kalman_filter(model, kind, sensors=("current",))
    truth, volts, readings = a_record(model, ("laser", "current"), 50)
    readings[:, 0] = np.nan
    left, right = both.start(truth[0], runs=2), one.start(truth[0], runs=2)
    for volt, reading in zip(volts, readings, strict=True):
        left, right = both.step(left, volt, reading), one.step(right, volt, reading[1])
    np.testing.assert_allclose(left.mean, right.mean, rtol=1e-12)
    np.testing.assert_allclose(left.normalised_innovation_squared, right.normalised_innovation_squared, rtol=1e-9)


@pytest.mark.parametrize("kind", ["ukf", pytest.param("ekf", marks=pytest.mark.nightly)])
def test_the_bias_of_a_sensor_is_found_beside_another_that_has_none(model, kind):
    """The current tells the distance, however weakly; the laser is 0.3 mm off."""
    names = ("current", "laser")
    filter_ = kalman_filter(model, kind, sensors=names, biases=("laser",), first_deviation_m=1e-3)
    assert filter_.process.names[-1] == "laser_bias_m"
    truth, volts, readings = a_record(model, names, 3000, bias=np.array([0.0, 3e-4]))
    first = filter_.process.start_covariance.copy()
    first[-1, -1] = 5e-4**2
    state = filter_.start([3.5e-3, 0.0, 0.1, 0.0], first)
    for volt, reading in zip(volts, readings, strict=True):
        state = filter_.step(state, volt, reading)
    error = state.mean[0] - [*truth[-1], 3e-4]
    deviations = np.sqrt(np.diagonal(state.covariance[0]))
    assert deviations[3] < 1e-4  # of half a millimetre at first
    assert (np.abs(error) < 4.0 * deviations).all()


def test_the_jacobian_at_a_stop_is_that_of_differences():
    model = replace(solenoid(), sample_time_s=1e-4, other_sensors=(SHUNT,))
    process = kalman_filter(model, "ekf").process
    states, volts = np.array([[4e-3, 0.01, 0.1], [0.2e-3, -0.01, 0.5], [2e-3, 0.1, 0.2]]), np.zeros(3)
    steps = np.array([[-1e-9, 1e-9, 1e-9], [1e-6] * 3, [1e-6] * 3])  # into the travel
    for k, step in enumerate(steps):
        moved = process.transition(states + step[:, None] * np.eye(3)[k], volts)
        slope = (moved - process.transition(states, volts)) / step[:, None]
        np.testing.assert_allclose(process.state_jacobian(states, volts)[:, :, k], slope, rtol=1e-3, atol=1e-4)
