"""The filters give the numbers of filterpy 2.0.0 and, where that differs, of a plain transcription of the paper."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import initial_covariance

# In units of the standard deviation. Different orders of summation give up to 5e-12 over this record; an approximation
# of any kind, or the other choice of sigma points, shows above 1e-4.
AGREEMENT = 1e-10


def start_of(process):
    bias = process.order == 4
    mean = np.array([0.0225, 0.01, 0.3, 0.005][: process.order])
    return mean, initial_covariance(biases=(0.01,) if bias else ())


def run_ours(filter_, record, run):
    state = filter_.start(*start_of(filter_.process))
    means, covariances = [], []
    for voltage, hall in zip(record.voltage[:, run], record.hall[:, run], strict=True):
        state = filter_.step(state, voltage, hall)
        means.append(state.mean[0])
        covariances.append(state.covariance[0])
    assert not state.diverged.any()
    return np.array(means), np.array(covariances)


def assert_same(ours, theirs):
    (mean, covariance), (other_mean, other_covariance) = ours, theirs
    sigma = np.sqrt(np.diagonal(other_covariance, axis1=1, axis2=2))
    assert np.abs((mean - other_mean) / sigma).max() < AGREEMENT
    scale = sigma[:, :, None] * sigma[:, None, :]
    assert np.abs((covariance - other_covariance) / scale).max() < AGREEMENT


def paper_filter(process, record, run, alpha, redraw=True, beta=2.0, kappa=0.0):
    """Eqs. (19) to (31) as printed, one run, weights not rearranged."""
    n = process.order
    lam = alpha**2 * (n + kappa) - n
    wm = np.full(2 * n + 1, 0.5 / (n + lam))
    wc = wm.copy()
    wm[0] = lam / (n + lam)
    wc[0] = wm[0] + 1.0 - alpha**2 + beta

    def draw(mean, covariance):
        root = np.linalg.cholesky((n + lam) * covariance)
        return np.vstack([mean, mean + root.T, mean - root.T])

    mean, covariance = start_of(process)
    means, covariances = [], []
    for voltage, hall in zip(record.voltage[:, run], record.hall[:, run], strict=True):
        points = process.transition(draw(mean, covariance), np.full(2 * n + 1, voltage))
        mean = wm @ points
        covariance = (wc * (points - mean).T) @ (points - mean) + process.process_covariance
        if redraw:
            points = draw(mean, covariance)
        outputs = process.outputs[0].measure(points)
        expected = wm @ outputs
        variance = wc @ (outputs - expected) ** 2 + process.outputs[0].variance
        cross = (wc * (outputs - expected)) @ (points - mean)
        gain = cross / variance
        mean = mean + gain * (hall - expected)
        covariance = covariance - variance * np.outer(gain, gain)
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


@pytest.fixture(params=[False, True], ids=["3-states", "4-states"])
def process(request, levitation_model):
    return levitation_process(levitation_model, hall_bias=request.param)


def test_ukf_equals_filterpy(process, record):
    n = process.order
    oracle = UnscentedKalmanFilter(
        dim_x=n,
        dim_z=1,
        dt=process.step_s,
        hx=lambda x: process.outputs[0].measure(x[None]),
        fx=lambda x, _dt, u: process.transition(x[None], np.array([u]))[0],
        points=MerweScaledSigmaPoints(n, alpha=1.0, beta=2.0, kappa=0.0),
    )
    oracle.x, oracle.P = start_of(process)
    oracle.Q, oracle.R = process.process_covariance, np.array([[process.outputs[0].variance]])
    means, covariances = [], []
    for voltage, hall in zip(record.voltage[:, 0], record.hall[:, 0], strict=True):
        oracle.predict(u=voltage)
        oracle.update(np.array([hall]))
        means.append(oracle.x.copy())
        covariances.append(oracle.P.copy())
    assert_same(run_ours(UnscentedFilter(process), record, 0), (np.array(means), np.array(covariances)))


@pytest.mark.parametrize("alpha", [1.0, 1.5])  # beta - alpha^2 of either sign
def test_ukf_equals_the_papers_equations(process, record, alpha):
    ours = run_ours(UnscentedFilter(process, alpha=alpha), record, 1)
    assert_same(ours, paper_filter(process, record, 1, alpha))


def test_redrawing_sigma_points_changes_the_estimate_measurably(process, record):
    redrawn = run_ours(UnscentedFilter(process), record, 0)
    reused = paper_filter(process, record, 0, 1.0, redraw=False)
    sigma = np.sqrt(redrawn[1][:, 0, 0])
    # Larger than the agreement asked of the oracles by far, so that mixing the two up cannot pass.
    assert np.abs((redrawn[0][:, 0] - reused[0][:, 0]) / sigma).max() > 1e3 * AGREEMENT


def test_ekf_equals_filterpy(process, record):
    oracle = ExtendedKalmanFilter(dim_x=process.order, dim_z=1)
    oracle.x, oracle.P = start_of(process)
    oracle.Q, oracle.R = process.process_covariance, np.array([[process.outputs[0].variance]])
    means, covariances = [], []
    for voltage, hall in zip(record.voltage[:, 2], record.hall[:, 2], strict=True):
        inputs = np.array([voltage])
        oracle.F = process.state_jacobian(oracle.x[None], inputs)[0]
        moved = process.transition(oracle.x[None], inputs)[0]
        oracle.predict()
        oracle.x = moved
        oracle.update(
            np.array([hall]),
            HJacobian=lambda x: process.output_jacobian(x[None], process.outputs[0]),
            Hx=lambda x: process.outputs[0].measure(x[None]),
        )
        means.append(oracle.x.copy())
        covariances.append(oracle.P.copy())
    assert_same(run_ours(ExtendedFilter(process), record, 2), (np.array(means), np.array(covariances)))


@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
def test_a_batch_gives_each_run_the_numbers_of_that_run_alone(process, record, filter_class):
    filter_ = filter_class(process)
    state = filter_.start(*start_of(process), runs=record.hall.shape[1])
    for voltage, hall in zip(record.voltage, record.hall, strict=True):
        state = filter_.step(state, voltage, hall)
    for run in range(state.runs):
        alone, _ = run_ours(filter_, record, run)
        # Summation order may differ with the batch's size; nothing else.
        np.testing.assert_allclose(state.mean[run], alone[-1], rtol=1e-11, atol=1e-13)
