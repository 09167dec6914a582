"""A filter that breaks down is named, run by run, and never repaired in silence."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import FilterError, MissingPartError
from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import initial_covariance
from femfit.estimate.process import FilterOutcome, FilterProcess, Output

ALL = [UnscentedFilter, ExtendedFilter]
START = np.array([0.022, 0.0, 0.32])


@pytest.fixture(scope="module")
def process(levitation_model):
    return levitation_process(levitation_model)


def plain_process(transition=lambda x, _u: x, covariance=None):
    return FilterProcess(
        names=("x", "v"),
        step_s=1.0,
        transition=transition,
        outputs=(Output("x", "m", lambda x: x[:, 0], 1.0),),
        process_covariance=1e-6 * np.eye(2) if covariance is None else covariance,
    )


@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
def test_a_covariance_that_is_lost_is_named_and_its_run_becomes_nan(filter_class):
    # A process covariance with a negative eigenvalue takes the covariance below zero after a few steps.
    filter_ = filter_class(plain_process(covariance=np.diag([1e-6, -0.3])))
    state = filter_.start(np.zeros(2), np.diag([1.0, 1.0]), runs=2)
    for _ in range(5):
        state = filter_.step(state, 0.0, 0.0)
    assert state.outcomes() == (FilterOutcome.COVARIANCE_LOST,) * 2
    assert np.isnan(state.mean).all()


@pytest.mark.parametrize("filter_class", ALL)
@pytest.mark.parametrize("bad", [np.inf, -np.inf])
def test_a_reading_that_is_infinite_ends_its_own_run_only(process, filter_class, bad):
    filter_ = filter_class(process)
    state = filter_.start(START, initial_covariance(), runs=3)
    hall = float(process.outputs[0].measure(START[None])[0])
    state = filter_.step(state, 0.86, np.array([hall, bad, hall]))
    state = filter_.step(state, 0.86, hall)
    assert state.outcomes() == (FilterOutcome.RUNNING, FilterOutcome.NOT_FINITE, FilterOutcome.RUNNING)
    assert np.isnan(state.mean[1]).all()
    assert np.isfinite(state.mean[[0, 2]]).all()


@pytest.mark.parametrize("filter_class", ALL)
def test_an_overflowing_process_is_named(filter_class):
    filter_ = filter_class(plain_process(transition=lambda x, _u: np.exp(1e4 * (1.0 + x))))
    state = filter_.predict(filter_.start(np.zeros(2), np.eye(2)), 0.0)
    assert state.outcomes() == (FilterOutcome.NOT_FINITE,)


@pytest.mark.parametrize("filter_class", ALL)
def test_an_estimate_far_outside_of_the_model_is_named(process, filter_class):
    filter_ = filter_class(process)
    far = np.array([[0.022, 0.0, 0.32], [0.2, 0.0, 0.3], [0.022, 0.0, 9.0]])
    state = filter_.predict(filter_.start(far, initial_covariance()), 0.86)
    assert state.outcomes() == (FilterOutcome.RUNNING, FilterOutcome.LEFT_MODEL, FilterOutcome.LEFT_MODEL)


@pytest.mark.parametrize("filter_class", ALL)
def test_a_jumping_sensor_takes_the_innovations_out_of_their_band_within_the_window(levitation_model, filter_class):
    """The filter is told of 0.1 mV; the sensor jumps by +-10 mV from sample to sample."""
    rng = np.random.default_rng(4)
    process = levitation_process(levitation_model)
    process = replace(process, outputs=(replace(process.outputs[0], variance=(1e-4) ** 2),))
    filter_ = filter_class(process, divergence_steps=50)
    state = filter_.start(START, initial_covariance(1e-5, 1e-3, 1e-3), runs=2)
    clean = float(process.outputs[0].measure(START[None])[0])
    named_at = None
    for k in range(60):
        # The mean is held, as the magnet is by its controller: only the innovations tell.
        held = replace(filter_.predict(state, 0.86), mean=np.tile(START, (2, 1)))
        state = filter_.update(held, np.array([clean + 0.01 * rng.choice([-1.0, 1.0]), clean]))
        if named_at is None and state.diverged[0]:
            named_at = k
    assert state.outcomes() == (FilterOutcome.INNOVATIONS_OUT_OF_BAND, FilterOutcome.RUNNING)
    # The fraction 1 - (1 - 1/50)^k passes one half at the 35th innovation out of the band.
    assert named_at == 34
    assert np.isfinite(state.mean[0]).all()


def test_the_first_outcome_stays(process):
    filter_ = UnscentedFilter(process)
    state = filter_.start(np.array([0.2, 0.0, 0.3]), initial_covariance())
    state = filter_.predict(state, 0.86)
    state = filter_.update(state, np.nan)
    assert state.outcomes() == (FilterOutcome.LEFT_MODEL,)


@pytest.mark.parametrize(
    ("mean", "covariance", "message"),
    [
        (np.zeros(2), np.eye(3), r"shapes \(3,\) and \(3, 3\).*instead received \(2,\)"),
        (START, np.diag([1.0, 1.0, 0.0]), "positive definite"),
        (np.array([np.nan, 0.0, 0.0]), np.eye(3), "finite"),
    ],
)
def test_a_bad_start_is_refused(process, mean, covariance, message):
    with pytest.raises(FilterError, match=message):
        UnscentedFilter(process).start(mean, covariance)


def test_sigma_points_without_spread_are_refused(process):
    with pytest.raises(FilterError, match="alpha > 0"):
        UnscentedFilter(process, alpha=0.0)


@pytest.mark.parametrize(("part", "absent"), [("circuits", ()), ("motion", None), ("sensor", None)])
def test_a_model_without_a_part_makes_no_process(levitation_model, part, absent):
    with pytest.raises(MissingPartError, match=part.rstrip("s")):
        levitation_process(replace(levitation_model, **{part: absent}))


def test_states_are_never_changed_in_place(process, record):
    filter_ = UnscentedFilter(process)
    state = filter_.start(START, initial_covariance())
    before = state.mean.copy(), state.covariance.copy()
    filter_.step(state, record.voltage[0, 0], record.hall[0, 0])
    np.testing.assert_array_equal(state.mean, before[0])
    np.testing.assert_array_equal(state.covariance, before[1])
