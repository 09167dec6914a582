"""Filters of several circuits and of several sensors, and the currents that hold against scipy's least heat."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from femfit.core.errors import DomainError
from femfit.device.electrics import CurrentSensor
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.noise import unstable_pole
from femfit.fit.build import fit_model
from femfit.simulation.allocation import current_ranges, currents_for_force
from femfit.simulation.observers import distance_inverse
from support.bearing import hall_field, table_of, table_with_hall
from support.halves import cut_in_two
from support.parts import with_circuit, with_motion
from support.readings import LASER, SHUNT, predict_sensors, read_by
from support.solenoids import solenoid
from support.steps import exponential_step

SENSORS = (LASER, CurrentSensor(name="shunt", noise=2e-3, circuit="inner"))
TWICE = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0, 0, 1.0]])
"""State of the whole coil -> state of its halves."""


@pytest.fixture(scope="module")
def whole(levitation_model):
    return replace(with_circuit(levitation_model, inductance_H=2e-3), other_sensors=SENSORS, sensor=None)


@pytest.fixture(scope="module")
def halves(whole):
    return cut_in_two(whole)


def as_halves(covariance):
    """A covariance of the whole's states as one of the halves', whose difference is known all but exactly."""
    apart = np.array([0.0, 0.0, 1.0, -1.0])
    return TWICE @ covariance @ TWICE.T + 1e-15 * np.outer(apart, apart)


@pytest.mark.parametrize(("kind", "digits"), [("ekf", 1e-6), ("ukf", 1e-4)])
def test_the_filter_of_the_halves_is_that_of_the_whole(whole, halves, kind, digits):
    """With the same errors of start and process; unscented points of four states lie farther out than of three."""
    one, two = (kalman_filter(model, kind) for model in (whole, halves))
    process = replace(two.process, process_covariance=as_halves(one.process.process_covariance))
    two = replace(two, process=process)
    start = np.array([0.024, 0.0, 0.5])
    first = one.start(start), two.start(TWICE @ start, as_halves(one.process.start_covariance))
    truth, generator = np.array([[0.0245, 0.01, 0.52]]), np.random.default_rng(2)
    for _ in range(40):
        volts = generator.uniform(0.5, 3.0)
        truth = exponential_step(whole, truth, np.array([volts]), whole.sample_time_s)
        readings = predict_sensors(whole, truth)[0] + generator.standard_normal(2) * [2e-5, 2e-3]
        first = one.step(first[0], volts, readings), two.step(first[1], [0.5 * volts, 0.5 * volts], readings)
    deviation = np.sqrt(np.diag(first[0].covariance[0]))
    assert np.abs((first[1].mean[0, :3] - first[0].mean[0]) / deviation).max() < digits
    np.testing.assert_allclose(np.sqrt(np.diag(first[1].covariance[0]))[:3], deviation, rtol=digits)


def test_the_currents_that_hold_are_shared_by_the_halves(whole, halves):
    alone = holding_currents(whole, 0.024)[0]
    assert holding_currents(whole, 0.024).tolist() == [alone]
    np.testing.assert_allclose(holding_currents(halves, 0.024), [alone, alone], rtol=1e-9)
    assert unstable_pole(halves, 0.024) == pytest.approx(unstable_pole(whole, 0.024), rel=1e-9)
    with pytest.raises(DomainError, match="inner"):
        holding_currents(halves, 0.044)


def test_without_a_magnet_the_bias_is_half_of_the_largest_current(halves):
    """Where no current moves the force, at zero current, there is nothing to hold the body by."""
    coefficients = halves.magnetics.coefficients.copy()
    coefficients[:, 1:3] = 0.0
    magnetics = replace(halves.magnetics, coefficients=coefficients)
    box = replace(halves.validity, current_limits_A=np.array([[-1.4, 1.4]] * 2))
    np.testing.assert_allclose(bias_currents(replace(halves, magnetics=magnetics, validity=box), 0.024), [0.7, 0.7])
    np.testing.assert_allclose(bias_currents(halves, 0.024), [0.7, 0.7])  # the middle of 0 to 1.4 A


def test_the_direct_distance_takes_all_currents_from_the_hall_voltage():
    model = fit_model(table_with_hall()).model
    d = np.array([0.3e-3, 0.55e-3, 0.7e-3])
    currents = np.array([[1.5, -2.0], [0.0, 0.3], [-1.0, 1.0]])
    volts = 2.5 + 50.0 * hall_field(d, currents)
    inverse = distance_inverse(model, "hall")
    found = inverse(volts, currents)
    np.testing.assert_allclose(found, d, atol=1e-9)  # the fit's rounding over 3 kV/m
    lost = inverse(np.array([volts[0], np.nan, 9.0]), currents)
    np.testing.assert_allclose(lost, [d[0], np.nan, 0.8e-3], atol=1e-9)


@pytest.mark.parametrize("current", [np.zeros(5), np.zeros((5, 3)), np.array(0.5)])
def test_a_sensors_field_refuses_currents_that_are_not_one_for_each_circuit(current):
    sensor = fit_model(table_with_hall()).model.sensor
    with pytest.raises(DomainError, match=r"shape \(\.\.\., 2\)"):
        sensor.field.field(np.full(5, 0.5e-3), current)


@pytest.fixture(scope="module")
def bearing():
    return fit_model(table_of()).model


def least_heat(model, distance, force, bias, limits):
    """By sequential quadratic programming from nine starts; None where none of them ends with the force."""

    def missing(currents):
        return float(model.magnetics.force(np.array(distance), currents)) - force

    def heat(currents):
        return model.resistances_ohm @ (currents - bias) ** 2

    starts = np.stack(np.meshgrid(*np.linspace(*limits.T, 3).T), axis=-1).reshape(-1, 2)
    constraint = {"type": "eq", "fun": missing}
    ends = [minimize(heat, one, bounds=limits, constraints=[constraint], options={"ftol": 1e-12}).x for one in starts]
    ends = [one for one in ends if abs(missing(one)) < 1e-6 * abs(force)]
    return min(ends, key=heat) if ends else None


@pytest.mark.parametrize(
    ("distance", "mass", "bias", "highest"),
    [
        (0.7e-3, 2.7, 1.0, 2.0),
        (0.7e-3, 2.7, 1.0, 1.42),  # the upper circuit comes to its limit
        (0.5e-3, 2.7, 0.0, 2.0),
        (0.5e-3, 2.7, 1.0, 2.0),  # only far from the bias, against the magnet's field
        (0.3e-3, 0.5, 0.0, 2.0),  # the force is bent so much that whole steps go to and fro
        (0.3e-3, 2.7, 1.0, 2.0),  # none
    ],
)
def test_the_currents_that_hold_heat_least(bearing, distance, mass, bias, highest):
    box = replace(bearing.validity, current_limits_A=np.array([[-2.0, 2.0], [-2.0, highest]]))
    model, bias = with_motion(replace(bearing, validity=box), mass_kg=mass), np.full(2, bias)
    expected = least_heat(model, distance, -9.81 * mass, bias, box.current_limits_A)
    if expected is None:
        with pytest.raises(DomainError):
            holding_currents(model, distance, bias)
        return
    found = holding_currents(model, distance, bias)
    # Heat is flat about its minimum: scipy ends within the root of its tolerance
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert model.magnetics.force(np.array(distance), found) == pytest.approx(-9.81 * mass, rel=1e-8)


def test_the_currents_of_a_loop_heat_least_and_keep_the_drivers_limits(bearing):
    """At several distances at once; the diode's circuit gives no negative current."""
    limits = current_ranges(bearing)
    bias = np.clip(bias_currents(bearing, 0.5e-3), *limits.T)
    distance, force = np.array([0.4e-3, 0.6e-3, 0.6e-3, 0.7e-3]), np.array([30.0, 3.0, -3.0, -20.0])
    found = currents_for_force(bearing, distance, force)
    for one, d, f in zip(found, distance, force, strict=True):
        expected = least_heat(bearing, d, f, bias, limits)
        assert expected is not None
        np.testing.assert_allclose(one, expected, atol=1e-3)


@pytest.fixture(scope="module")
def model():
    return read_by(SHUNT, LASER)


def a_record(model, steps):
    """Truth (steps, 3), voltages (steps,) and readings (steps, 2) of a coil that is fed with a square wave."""
    volts = 4.0 + 3.0 * np.sign(np.sin(np.arange(steps) / 17.0))
    states = [np.array([[3.5e-3, 0.0, 0.1]])]
    for volt in volts:
        states.append(exponential_step(model, states[-1], np.array([volt]), model.sample_time_s))  # as the filters move
    truth = np.concatenate(states[1:])
    noise = np.random.default_rng(3).standard_normal((steps, 2)) * [SHUNT.noise, LASER.noise]
    return truth, volts, predict_sensors(model, truth) + noise


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
    truth, volts, readings = a_record(model, 50)
    left, right = both.start(truth[0], runs=2), one.start(truth[0], runs=2)
    for volt, reading in zip(volts, readings[:, 0], strict=True):
        left, right = both.step(left, volt, [np.nan, reading]), one.step(right, volt, reading)
    np.testing.assert_allclose(left.mean, right.mean, rtol=1e-12)
    np.testing.assert_allclose(left.normalised_innovation_squared, right.normalised_innovation_squared, rtol=1e-9)


def test_the_bias_of_a_sensor_is_found_beside_another_that_has_none(model):
    """The current tells the distance, however weakly; the laser is 0.3 mm off."""
    filter_ = kalman_filter(model, sensors=("current", "laser"), biases=("laser",), first_deviation_m=1e-3)
    assert filter_.process.names[-1] == "laser_bias_m"
    truth, volts, readings = a_record(model, 3000)
    first = filter_.process.start_covariance.copy()
    first[-1, -1] = 5e-4**2
    state = filter_.start([3.5e-3, 0.0, 0.1, 0.0], first)
    for volt, reading in zip(volts, readings + np.array([0.0, 3e-4]), strict=True):
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
        np.testing.assert_allclose(process.with_slopes(states, volts)[1][:, :, k], slope, rtol=1e-3, atol=1e-4)
