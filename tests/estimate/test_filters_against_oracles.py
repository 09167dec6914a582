"""The filters give the numbers of filterpy 2.0.0, which redraws its sigma points too, and those of single precision."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from femfit.estimate.levitation import levitation_process
from support.covariances import initial_covariance

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


@pytest.fixture(params=[False, True], ids=["3-states", "4-states"])
def process(request, levitation_model):
    return levitation_process(levitation_model, hall_bias=request.param)


@pytest.mark.parametrize("alpha", [1.0, 1.5])  # beta - alpha^2 of either sign
def test_ukf_equals_filterpy(process, record, alpha):
    n = process.order
    oracle = UnscentedKalmanFilter(
        dim_x=n,
        dim_z=1,
        dt=process.step_s,
        hx=lambda x: process.outputs[0].measure(x[None]),
        fx=lambda x, _dt, u: process.transition(x[None], np.array([u]))[0],
        points=MerweScaledSigmaPoints(n, alpha=alpha, beta=2.0, kappa=0.0),
    )
    oracle.x, oracle.P = start_of(process)
    oracle.Q, oracle.R = process.process_covariance, np.array([[process.outputs[0].variance]])
    means, covariances = [], []
    for voltage, hall in zip(record.voltage[:, 0], record.hall[:, 0], strict=True):
        oracle.predict(u=voltage)
        oracle.update(np.array([hall]))
        means.append(oracle.x.copy())
        covariances.append(oracle.P.copy())
    assert_same(run_ours(UnscentedFilter(process, alpha=alpha), record, 0), (np.array(means), np.array(covariances)))


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


START = np.array([0.0225, 0.01, 0.3])


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
def three_states(levitation_model):
    return levitation_process(levitation_model)


@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
def test_alpha_one_gives_the_same_estimate_in_single_precision(three_states, record, filter_class):
    exact, sigma = means_in(np.float64, filter_class(three_states), record)
    single, _ = means_in(np.float32, filter_class(three_states), record)
    # float32 resolves the distance to 2 nm, the voltage to 0.2 uV: thousandths of the 6 um and 3.2 mV of noise.
    assert (np.abs(single - exact) / sigma).max() < 0.05


def test_the_papers_alpha_in_difference_form_keeps_the_covariance_but_not_the_digits(three_states, record):
    exact, sigma = means_in(np.float64, UnscentedFilter(three_states, alpha=0.002), record)
    single, _ = means_in(np.float32, UnscentedFilter(three_states, alpha=0.002), record)
    assert (np.abs(single - exact) / sigma).max() > 0.05
