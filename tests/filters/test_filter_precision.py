"""What single precision does to the paper's alpha, and that alpha = 1 in difference form survives it."""

import numpy as np
import pytest

from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import initial_covariance

START = np.array([0.0225, 0.01, 0.3])


def printed_form_lasts(process, record, alpha, dtype) -> int:
    """Steps until (20), (23) and (24) as printed lose the covariance, in a given precision."""
    n = 3
    lam = dtype(alpha**2 * n - n)
    wm = np.full(2 * n + 1, 0.5 / (n + lam), dtype)
    wc = wm.copy()
    wm[0] = lam / (n + lam)
    wc[0] = wm[0] + dtype(3.0 - alpha**2)
    mean, covariance = START.astype(dtype), initial_covariance().astype(dtype)
    noise, variance = process.process_covariance.astype(dtype), dtype(process.outputs[0].variance)
    for k, (voltage, hall) in enumerate(zip(record.voltage[:, 0], record.hall[:, 0], strict=True)):
        try:
            root = np.linalg.cholesky((n + lam) * covariance)
        except np.linalg.LinAlgError:
            return k
        points = np.vstack([mean, mean + root.T, mean - root.T])
        points = process.transition(points, np.full(2 * n + 1, voltage)).astype(dtype)
        mean = wm @ points
        covariance = (wc * (points - mean).T) @ (points - mean) + noise
        outputs = process.outputs[0].measure(points).astype(dtype)
        expected = wm @ outputs
        spread = wc @ (outputs - expected) ** 2 + variance
        gain = ((wc * (outputs - expected)) @ (points - mean)) / spread
        mean = mean + gain * (dtype(hall) - expected)
        covariance = covariance - spread * np.outer(gain, gain)
        covariance = dtype(0.5) * (covariance + covariance.T)
    return len(record.hall)


def means_in(dtype, filter_, record):
    state = filter_.start(START.astype(dtype), initial_covariance())
    means = []
    for voltage, hall in zip(record.voltage[:, 0], record.hall[:, 0], strict=True):
        state = filter_.step(state, voltage, hall)
        means.append(state.mean[0])
    assert state.mean.dtype == dtype
    assert state.covariance.dtype == dtype
    assert not state.diverged.any()
    return np.array(means, dtype=np.float64), np.sqrt(np.diag(state.covariance[0]))


@pytest.fixture(scope="module")
def process(levitation_model):
    return levitation_process(levitation_model)


def test_the_printed_form_loses_its_covariance_in_single_precision_only(process, record):
    assert printed_form_lasts(process, record, 0.002, np.float64) == len(record.hall)
    assert printed_form_lasts(process, record, 0.002, np.float32) < len(record.hall)
    assert printed_form_lasts(process, record, 1.0, np.float32) == len(record.hall)


@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
def test_alpha_one_gives_the_same_estimate_in_single_precision(process, record, filter_class):
    exact, sigma = means_in(np.float64, filter_class(process), record)
    single, _ = means_in(np.float32, filter_class(process), record)
    # float32 resolves the distance to 2 nm, the voltage to 0.2 uV: thousandths of the 6 um and 3.2 mV of noise.
    assert (np.abs(single - exact) / sigma).max() < 0.05


def test_the_papers_alpha_in_difference_form_keeps_the_covariance_but_not_the_digits(process, record):
    exact, sigma = means_in(np.float64, UnscentedFilter(process, alpha=0.002), record)
    single, _ = means_in(np.float32, UnscentedFilter(process, alpha=0.002), record)
    assert (np.abs(single - exact) / sigma).max() > 0.05
