"""A filter that breaks down is named, run by run, one alone as of many, and what none can take is refused."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import FilterError, MissingPartError
from femfit.estimate.error_bound import bound_along
from femfit.estimate.filter import Filter
from femfit.estimate.filter_state import FilterOutcome
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import ExtendedFilter, UnscentedFilter
from femfit.model.json_file import write_model
from support.compiling import compile_at_once, needs_compiler
from support.one_current import within
from support.readings import LASER, SHUNT, initial_covariance, read_by
from support.solenoids import solenoid

ALL = [UnscentedFilter, ExtendedFilter]
START = np.array([0.022, 0.0, 0.32])


@pytest.fixture(scope="module")
def process(levitation_model):
    return kalman_filter(levitation_model, hall_bias=False).process


@pytest.mark.parametrize("filter_class", ALL)
def test_a_covariance_that_is_lost_is_named_and_its_run_becomes_nan(process, filter_class):
    # A process covariance with a negative eigenvalue takes the covariance below zero after a few steps.
    filter_ = filter_class(replace(process, process_covariance=np.diag([1e-12, -0.3, 1e-6])))
    state = filter_.start(START, initial_covariance(), runs=2)
    for _ in range(5):
        state = filter_.step(state, 0.86, process.measure("hall", START[None])[0])
    assert state.outcome.tolist() == [FilterOutcome.COVARIANCE_LOST] * 2
    assert np.isnan(state.mean).all()


@pytest.mark.parametrize("filter_class", ALL)
def test_a_reading_that_is_infinite_ends_its_own_run_only(process, filter_class):
    filter_ = filter_class(process)
    state = filter_.start(START, initial_covariance(), runs=3)
    hall = float(process.measure("hall", START[None])[0])
    state = filter_.step(state, 0.86, np.array([hall, np.inf, hall]))
    state = filter_.step(state, 0.86, hall)
    assert state.outcome.tolist() == [FilterOutcome.RUNNING, FilterOutcome.NOT_FINITE, FilterOutcome.RUNNING]
    assert np.isnan(state.mean[1]).all()
    assert np.isfinite(state.mean[[0, 2]]).all()


OF_READING = {np.nan: FilterOutcome.RUNNING, np.inf: FilterOutcome.NOT_FINITE, 1e160: FilterOutcome.LEFT_MODEL}


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
@pytest.mark.parametrize("hall", [*OF_READING, 50.0])
def test_what_goes_wrong_is_named_alike_in_one_run_in_many_and_by_the_general_path(levitation_model, kind, hall):
    filter_ = kalman_filter(levitation_model, kind)
    alone, two = (filter_.start(START, runs=runs) for runs in (1, 2))
    ways = (
        filter_.step(alone, 0.86, hall),
        filter_.step(two, 0.86, hall),
        filter_.update(filter_.predict(alone, 0.86), hall),
    )
    (named,) = {outcome for state in ways for outcome in state.outcome}
    assert named == OF_READING.get(hall, named)


@pytest.mark.parametrize("filter_class", ALL)
def test_a_jumping_sensor_takes_the_innovations_out_of_their_band_within_the_window(process, filter_class):
    """The filter is told of 0.1 mV; the sensor jumps by +-10 mV from sample to sample."""
    rng, diverged = np.random.default_rng(4), []
    process = replace(process, outputs=(replace(process.outputs[0], variance=(1e-4) ** 2),))
    filter_ = filter_class(process, divergence_steps=50)
    state = filter_.start(START, initial_covariance(1e-5, 1e-3, 1e-3), runs=2)
    clean = float(process.measure("hall", START[None])[0])
    for _ in range(60):
        # The mean is held, as the magnet is by its controller: only the innovations tell.
        held = replace(filter_.predict(state, 0.86), mean=np.tile(START, (2, 1)))
        state = filter_.update(held, np.array([clean + 0.01 * rng.choice([-1.0, 1.0]), clean]))
        diverged.append(state.diverged[0])
    assert state.outcome.tolist() == [FilterOutcome.INNOVATIONS_OUT_OF_BAND, FilterOutcome.RUNNING]
    # The fraction 1 - (1 - 1/50)^k passes one half at the 35th innovation out of the band.
    assert diverged.index(True) == 34
    assert np.isfinite(state.mean[0]).all()


def test_a_process_knows_readings_of_sensors_that_its_filter_does_not_take(levitation_model):
    model = replace(levitation_model, other_sensors=(LASER,))
    process, state = kalman_filter(model).process, np.array([[0.022, 0.0, 0.4, 0.01]])
    read = kalman_filter(model, sensors=("hall", LASER.name)).process
    np.testing.assert_allclose(process.measure(LASER.name, state), read.measure(LASER.name, state))
    with pytest.raises(MissingPartError, match="a sensor named 'nothing'"):
        process.measure("nothing", state)


def test_states_are_never_changed_in_place_and_the_first_outcome_stays(process):
    filter_ = UnscentedFilter(process)
    state = filter_.start(START, initial_covariance())
    before = deepcopy(state)
    filter_.step(state, 0.86, 2.9)
    np.testing.assert_equal(vars(state), vars(before))
    far = np.array([START, [0.2, 0.0, 0.3], [0.022, 0.0, 9.0]])
    state = filter_.predict(filter_.start(far, initial_covariance()), 0.86)
    state = filter_.update(state, np.nan)
    assert state.outcome.tolist() == [FilterOutcome.RUNNING, FilterOutcome.LEFT_MODEL, FilterOutcome.LEFT_MODEL]
    after, slopes = process.with_slopes(np.zeros((0, process.order)), np.zeros(0))  # of no body at all
    assert (after.shape, slopes.shape) == ((0, process.order), (0, process.order, process.order))


@needs_compiler
@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_the_single_step_is_compiled_to_the_same_numbers(levitation_model, kind, monkeypatch, tmp_path):
    start = kalman_filter(levitation_model, kind).start(START)
    wanted = kalman_filter(levitation_model, kind).step(start, 0.86, 2.9)
    libraries = compile_at_once(monkeypatch, tmp_path)
    monkeypatch.setattr(Filter, "predict", None)  # the general path would need it
    found = kalman_filter(levitation_model, kind).step(start, 0.86, 2.9)
    assert libraries
    assert all(libraries)
    np.testing.assert_array_equal(found.mean, wanted.mean)
    np.testing.assert_array_equal(found.covariance, wanted.covariance)


def test_a_filter_starts_without_a_covariance_and_reads_its_model_from_a_file(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    filter_ = kalman_filter(tmp_path / "model.json", "ekf")
    state = filter_.start(START)
    assert state.mean.tolist() == [[0.022, 0.0, 0.32, 0.0]]
    assert np.sqrt(state.covariance[0, 0, 0]) == pytest.approx(1e-3)
    short = replace(solenoid(), validity=within(solenoid().validity, distance_min_m=2e-4, distance_max_m=5e-4))
    first = kalman_filter(replace(short, other_sensors=(SHUNT,))).process.start_covariance
    assert np.sqrt(first[0, 0]) == pytest.approx(3e-4 / 12.0**0.5)  # of a body anywhere on its way


def stepped(readings, **options):
    """A filter of a solenoid with an ammeter and a laser is asked for one step."""

    def ask(_):
        built = kalman_filter(read_by(SHUNT, LASER), sensors=("laser", "current"))
        built.step(built.start([3e-3, 0.0, 0.0], **options), 0.0, readings)

    return ask


def of_sensors(*given, **options):
    return lambda _: kalman_filter(read_by(*given or (SHUNT, LASER)), **options)


def started(mean, covariance):
    return lambda rig: kalman_filter(rig, hall_bias=False).start(mean, covariance)


REFUSALS = {
    "start of another order": (started(np.zeros(2), np.eye(3)), r"shapes \(3,\) and \(3, 3\).*instead received \(2,\)"),
    "start without spread": (started(START, np.diag([1.0, 1.0, 0.0])), "positive definite"),
    "start that is no number": (started(np.array([np.nan, 0.0, 0.0]), np.eye(3)), "finite"),
    "no circuit": (lambda rig: kalman_filter(replace(rig, circuits=())), "circuit"),
    "no motion": (lambda rig: kalman_filter(replace(rig, motion=None)), "motion"),
    "no sensor": (lambda rig: kalman_filter(replace(rig, sensor=None)), "sensor"),
    "no such filter": (lambda rig: kalman_filter(rig, "kf"), "ukf, ekf"),
    "no such sensor": (of_sensors(sensors=("radar",)), "radar"),
    "a name in place of names": (of_sensors(sensors="laser"), "sequence"),
    "bias of what is not read": (of_sensors(sensors=("laser",), biases=("current",)), "cannot be estimated"),
    "sensor without noise": (of_sensors(replace(SHUNT, noise=0.0)), "noise"),
    "delay beyond what is remembered": (of_sensors(replace(LASER, delay_s=0.2)), "remembers"),
    "reading of one sensor of two": (stepped(3e-3), "2 readings"),
    "readings of runs in place of sensors": (stepped(np.zeros(3), runs=3), "2 readings"),
    "path longer than its inputs": (
        lambda rig: bound_along(kalman_filter(rig).process, np.zeros((3, 4)), np.zeros(2)), r"3 .* 2",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSALS)
def test_what_cannot_be_filtered_is_refused_with_what_is_needed(levitation_model, name):
    ask, message = REFUSALS[name]
    with pytest.raises((FilterError, MissingPartError), match=message):
        ask(levitation_model)
