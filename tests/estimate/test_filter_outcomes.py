"""A filter that breaks down is named, run by run, and one run alone is one of many."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import FilterError, MissingPartError
from femfit.estimate.filter import Filter
from femfit.estimate.kalman_filter import ExtendedFilter, UnscentedFilter, kalman_filter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.process import FilterOutcome, FilterProcess, Output
from femfit.model.json_file import write_model
from support.covariances import initial_covariance

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


def test_the_single_step_is_taken(levitation_model, record, monkeypatch):
    filter_ = kalman_filter(levitation_model)
    monkeypatch.setattr(Filter, "predict", None)  # the general path would need it
    state = filter_.start([0.022, 0.0, 0.32])
    for voltage, hall in zip(record.voltage[:9, 0], record.hall[:9, 0], strict=True):
        state = filter_.step(state, voltage, np.array([hall]))
    assert np.isfinite(state.mean).all()


@pytest.mark.parametrize(
    ("hall", "outcome"), [(np.nan, FilterOutcome.RUNNING), (np.inf, FilterOutcome.NOT_FINITE), (50.0, None)]
)
def test_what_goes_wrong_is_named_as_by_the_general_path(levitation_model, hall, outcome):
    filter_ = kalman_filter(levitation_model)
    state = filter_.start([0.022, 0.0, 0.32])
    named = filter_.step(state, 0.86, hall).outcomes()
    assert named == filter_.update(filter_.predict(state, 0.86), hall).outcomes()
    assert outcome is None or named == (outcome,)


def test_innovations_out_of_their_band_are_named_in_one_run_too(levitation_model):
    process = levitation_process(levitation_model)
    process = replace(process, outputs=(replace(process.outputs[0], variance=(1e-4) ** 2),))
    filter_ = UnscentedFilter(process, divergence_steps=20)
    state = filter_.start(np.array([0.022, 0.0, 0.32]), initial_covariance(1e-5, 1e-3, 1e-3))
    clean, generator = state.mean, np.random.default_rng(4)
    volts = float(process.outputs[0].measure(clean)[0])
    for _ in range(30):
        held = replace(state, mean=clean)  # the body is held by its controller: only the innovations tell
        state = filter_.step(held, 0.86, volts + 0.03 * generator.choice([-1.0, 1.0]))
    assert state.outcomes() == (FilterOutcome.INNOVATIONS_OUT_OF_BAND,)


def test_a_filter_starts_without_a_covariance_and_reads_its_model_from_a_file(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    filter_ = kalman_filter(tmp_path / "model.json", "ekf")
    state = filter_.start([0.022, 0.0, 0.32])
    assert state.mean.tolist() == [[0.022, 0.0, 0.32, 0.0]]
    assert np.sqrt(state.covariance[0, 0, 0]) == pytest.approx(1e-3)
    with pytest.raises(FilterError, match="ukf, ekf"):
        kalman_filter(levitation_model, "kf")


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_step_reads_the_outputs_that_stand_in_the_place_of_its_own(levitation_model, kind):
    built = kalman_filter(levitation_model, kind)
    (output,) = built.process.outputs
    off = replace(output, measure=lambda states: output.measure(states) + 0.5)
    changed = replace(built, process=replace(built.process, outputs=(off,)))
    state = changed.start([0.022, 0.0, 0.4])
    stepped, updated = changed.step(state, 1.1, 2.7), changed.update(changed.predict(state, 1.1), 2.7)
    np.testing.assert_array_equal(stepped.innovation, updated.innovation)
    assert abs(stepped.innovation[0] - built.step(state, 1.1, 2.7).innovation[0]) > 0.4


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_reading_without_measure_is_named_in_one_run_as_in_many(levitation_model, kind):
    built = kalman_filter(levitation_model, kind)
    for runs in (1, 2):
        state = built.step(built.start([0.022, 0.0, 0.4], runs=runs), 1.1, 1e160)
        assert state.outcomes()[0] is FilterOutcome.LEFT_MODEL
