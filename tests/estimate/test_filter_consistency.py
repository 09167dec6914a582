"""On a linear process the UKF is the Kalman filter; on any, errors are as large as the filter says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from femfit.estimate.direct import hall_inverse
from femfit.estimate.holding import holding_current
from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import FilterNoise, consistency_band, process_covariance
from femfit.estimate.process import FilterProcess, Output
from support.covariances import initial_covariance
from support.steps import runge_kutta_step

FILTERS = [
    UnscentedFilter,
    lambda process: UnscentedFilter(process, alpha=0.1),
    ExtendedFilter,
]
NAMES = ["ukf", "ukf-alpha-0.1", "ekf"]

A = np.array([[1.0, 0.1, 0.0], [-0.2, 0.9, 0.3], [0.0, 0.0, 0.7]])
B = np.array([0.0, 0.0, 0.5])
C = np.array([1.0, 0.0, 0.2])
Q = np.array([[2e-4, 1e-5, 0.0], [1e-5, 3e-4, 0.0], [0.0, 0.0, 1e-3]])
R = 0.04


def linear_process():
    """No Jacobians given: the EKF takes its central differences."""
    return FilterProcess(
        names=("x", "v", "i"),
        step_s=0.1,
        transition=lambda x, u: x @ A.T + u[:, None] * B,
        outputs=(Output("z", "V", lambda x: x @ C, R),),
        process_covariance=Q,
    )


def linear_record(steps, runs, rng):
    noise = np.linalg.cholesky(Q)
    x = rng.normal(size=(runs, 3))
    truth, inputs, outputs = np.empty((steps, runs, 3)), rng.normal(size=(steps, runs)), np.empty((steps, runs))
    for k in range(steps):
        x = x @ A.T + inputs[k][:, None] * B + rng.normal(size=(runs, 3)) @ noise.T
        truth[k], outputs[k] = x, x @ C + np.sqrt(R) * rng.normal(size=runs)
    return truth, inputs, outputs


def errors_are_as_large_as_said(state, truth):
    """The mean of e^T P^-1 e over the runs lies in the 99 % band of chi-square with three degrees of freedom."""
    error = state.mean - truth
    squares = np.einsum("ri,ri->r", error, np.linalg.solve(state.covariance, error[:, :, None])[:, :, 0])
    low, high = chi2.ppf([0.005, 0.995], 3 * len(error))
    return low < squares.sum() < high


@pytest.mark.parametrize("make", FILTERS, ids=NAMES)
def test_every_filter_is_the_kalman_filter_on_a_linear_process(make):
    filter_ = make(linear_process())
    _, inputs, outputs = linear_record(60, 1, np.random.default_rng(1))
    mean, covariance = np.zeros(3), np.eye(3)
    state = filter_.start(mean, covariance)
    for u, z in zip(inputs[:, 0], outputs[:, 0], strict=True):
        mean, covariance = A @ mean + B * u, A @ covariance @ A.T + Q
        variance = C @ covariance @ C + R
        gain = covariance @ C / variance
        mean = mean + gain * (z - C @ mean)
        covariance = covariance - variance * np.outer(gain, gain)
        state = filter_.step(state, u, z)
        # Rounding; alpha = 0.1 divides differences by 0.01, central differences are good to 1e-10.
        np.testing.assert_allclose(state.mean[0], mean, atol=1e-8)
        np.testing.assert_allclose(state.covariance[0], covariance, atol=1e-8)


@pytest.mark.parametrize("make", [UnscentedFilter, ExtendedFilter])
def test_errors_and_innovations_lie_in_their_bands_on_the_levitating_magnet(
    levitation_model, make, stabilised, as_the_plant_moves
):
    noise = FilterNoise(acceleration_density=2e-4, voltage_V=0.02, hall_V=levitation_model.sensor.noise_V)
    sigmas = np.linalg.cholesky(process_covariance(levitation_model, noise, 0.022))
    runs, steps = 40, 200
    record = stabilised(levitation_model, steps, runs, np.random.default_rng(3), sigmas)
    filter_ = make(as_the_plant_moves(levitation_process(levitation_model, noise=noise)))
    start = np.array([0.022, 0.0, record.truth[0, :, 2].mean()])
    state = filter_.start(start, initial_covariance(3e-4, 0.01, 0.01), runs)
    nis = np.empty((steps, runs))
    for k in range(steps):
        state = filter_.step(state, record.voltage[k], record.hall[k])
        nis[k] = state.normalised_innovation_squared
    assert not state.diverged.any()
    assert errors_are_as_large_as_said(state, record.truth[-1])
    settled = nis[50:]  # the record starts at rest, not with the prior's velocity and current
    assert consistency_band(settled.size, 0.99).contains(settled.mean())


@pytest.mark.parametrize("make", [UnscentedFilter, ExtendedFilter])
@pytest.mark.parametrize("decay", [0.15, 0.25, 0.43, 1.0, 1.9])
def test_innovations_lie_in_their_band_while_the_current_of_a_fast_coil_is_switched(levitation_model, make, decay):
    """The rig's coil and faster ones, by R t/L."""
    ohms = decay * float(levitation_model.inductance(0.022, 0.3)) / levitation_model.sample_time_s
    fast = replace(levitation_model.circuit, resistance_ohm=ohms)
    model = replace(levitation_model, circuits=(fast,))
    noise = FilterNoise(acceleration_density=2e-4, voltage_V=0.01, hall_V=0.003)
    sigmas = np.linalg.cholesky(process_covariance(model, noise, 0.022))
    runs, steps, random = 40, 40, np.random.default_rng(4)
    filter_ = make(levitation_process(model, noise=noise))
    rest = np.array([0.022, 0.0, holding_current(model, 0.022)])
    truth = rest + random.normal(size=(runs, 3)) * (1e-4, 1e-3, 1e-3)
    state = filter_.start(np.tile(rest, (runs, 1)), initial_covariance(1e-4, 1e-3, 1e-3))
    nis = np.empty((steps, runs))
    for k in range(steps):
        volts = np.full(runs, fast.resistance_ohm * rest[2] + (2.0 if k // 5 % 2 else -2.0))
        truth = runge_kutta_step(model, truth, volts, model.sample_time_s, 4)
        truth = truth + random.normal(size=(runs, 3)) @ sigmas.T
        read = model.sensor.voltage(truth[:, 0], truth[:, 2]) + noise.hall_V * random.normal(size=runs)
        state = filter_.step(state, volts, read)
        nis[k] = state.normalised_innovation_squared
    assert consistency_band(nis.size, 0.99).contains(nis.mean())


@pytest.mark.parametrize("samples", [60, 200, 4000])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_the_band_is_that_of_chi_square(samples, confidence):
    band = consistency_band(samples, confidence)
    tail = 0.5 - 0.5 * confidence
    expected = chi2.ppf([tail, 1.0 - tail], samples) / samples
    # Wilson and Hilferty's own error.
    np.testing.assert_allclose([band.lower, band.upper], expected, rtol=1e-3)
    assert not band.contains(float("nan"))


def test_compensating_the_coil_by_the_resting_current_costs_what_the_hall_voltage_filter_keeps(
    levitation_model, stabilised, as_the_plant_moves
):
    """The paper's (14) and (15) remove the coil's field as if i = u / R; while the body moves it is not."""
    record = stabilised(levitation_model, 400, 3, np.random.default_rng(6))
    inverse = hall_inverse(levitation_model)
    through_volts = as_the_plant_moves(levitation_process(levitation_model))
    rest = np.array([[0.022, 0.0, 0.32]])
    (hall,) = through_volts.outputs
    slope = through_volts.output_jacobian(rest, hall)[0, 0]
    inverted = replace(hall, measure=lambda x: x[:, 0], variance=hall.variance / slope**2)
    of_distance = replace(through_volts, outputs=(inverted,))

    def error_rms(process, values):
        filter_ = UnscentedFilter(process)
        state = filter_.start(np.array([0.022, 0.0, 0.32]), initial_covariance(), 3)
        errors = []
        for voltage, value, truth in zip(record.voltage, values, record.truth, strict=True):
            state = filter_.step(state, voltage, value)
            errors.append(state.mean[:, 0] - truth[:, 0])
        return np.sqrt(np.mean(np.square(errors[100:])))

    resting = inverse.distance(record.hall, (record.voltage / levitation_model.circuit.resistance_ohm)[..., None])[0]
    known = inverse.distance(record.hall, record.truth[..., 2:3])[0]
    through_field = error_rms(through_volts, record.hall)
    # With the true current both measurements carry the same information, R being constant in V or in m.
    assert error_rms(of_distance, known) == pytest.approx(through_field, rel=0.1)
    assert error_rms(of_distance, resting) > 3.0 * through_field


def test_the_ukf_beats_the_ekf_while_it_acquires_and_only_then(levitation_model, stabilised, as_the_plant_moves):
    """A first belief 6 mm off: the Hall slope there says little of the slope here; both settle to the same error."""
    record = stabilised(levitation_model, 500, 20, np.random.default_rng(5))
    process = as_the_plant_moves(levitation_process(levitation_model))
    errors = {}
    for filter_class in (UnscentedFilter, ExtendedFilter):
        filter_ = filter_class(process)
        state = filter_.start(np.array([0.028, 0.0, 0.32]), initial_covariance(6e-3, 0.05, 0.1), 20)
        history = []
        for voltage, hall, truth in zip(record.voltage, record.hall, record.truth, strict=True):
            state = filter_.step(state, voltage, hall)
            history.append(np.abs(state.mean[:, 0] - truth[:, 0]))
        assert not state.diverged.any()
        errors[filter_class] = np.median(history, axis=1)
    ukf, ekf = errors[UnscentedFilter], errors[ExtendedFilter]
    assert ekf[9] > 3.0 * ukf[9]
    # Medians of 20 runs over 100 samples, correlated over some 60 samples: about 5 %, the same noise in both.
    assert ekf[-100:].mean() == pytest.approx(ukf[-100:].mean(), rel=0.05)
