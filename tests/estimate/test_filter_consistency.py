"""Errors and innovations are as large as the filter says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from femfit.estimate.holding import holding_current
from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import FilterNoise, consistency_band, process_covariance
from support.covariances import initial_covariance
from support.steps import runge_kutta_step


def errors_are_as_large_as_said(state, truth):
    """The mean of e^T P^-1 e over the runs lies in the 99.9 % band of chi-square with three degrees of freedom."""
    error = state.mean - truth
    squares = np.einsum("ri,ri->r", error, np.linalg.solve(state.covariance, error[:, :, None])[:, :, 0])
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(error))
    return low < squares.sum() < high


@pytest.mark.parametrize("make", [UnscentedFilter, ExtendedFilter])
@pytest.mark.parametrize("decay", [0.15, 0.25, 0.43, 1.0, 1.9])
def test_errors_and_innovations_lie_in_their_bands_while_the_current_of_a_coil_is_switched(
    levitation_model, make, decay
):
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
    assert errors_are_as_large_as_said(state, truth)


@pytest.mark.parametrize("samples", [60, 200, 4000])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_the_band_is_that_of_chi_square(samples, confidence):
    band = consistency_band(samples, confidence)
    tail = 0.5 - 0.5 * confidence
    expected = chi2.ppf([tail, 1.0 - tail], samples) / samples
    # Wilson and Hilferty's own error.
    np.testing.assert_allclose([band.lower, band.upper], expected, rtol=1e-3)
    assert not band.contains(float("nan"))
