"""A record in pieces is the record one sample after the other, and what it shows of filter and log is said."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import FilterError, MissingPartError, TableError, UsageError
from femfit.core.text import amount
from femfit.estimate.find_noise import FoundNoise, NoiseEstimate, find_noise, with_noise
from femfit.estimate.follow import innovations_of
from femfit.model.sensors import reading_of
from femfit.model.validity import ProcessNoise
from support.added_effects import under_effects
from support.one_current import within
from support.replays import STEP_S, TRUE, changed, damped, logs, series
from support.solenoids import solenoid
from support.switching import logged, switched


@pytest.fixture(scope="module")
def log():
    truth, (record,) = logs(4000, 1, seed=5)
    return truth[:, 0], record


@pytest.fixture(scope="module")
def seen(log):
    return ff.observe(damped(), log[1], filter=("ukf", "ekf"), find=False)


def test_each_stretch_of_a_record_begins_anew_and_goes_on_by_the_general_path(log, seen):
    """By the step of many runs, which is another than the one of a single run."""
    rows = log[1].rows[:900].assign(segment=np.repeat([0, 1], [400, 500]))
    one = ff.observe(damped(), replace(log[1], rows=rows), find=False).filters[0]
    distance, current, volts = (rows[name].to_numpy() for name in ("distance_m", "current_A", "voltage_V"))
    for k in range(900):
        if k in {0, 400}:
            state = one.built.start([distance[k], 0.0, current[k]])
        else:
            state = one.built.predict(state, volts[k - 1])
        state = one.built.update(state, [[current[k], distance[k]]])
        deviation = np.sqrt(np.diagonal(state.covariance[0]))
        for found, wanted in ((one.replayed.mean, state.mean), (one.replayed.predicted, state.predicted)):
            assert np.abs((wanted[0] - found[k]) / deviation).max() < 1e-8
    np.testing.assert_allclose(one.replayed.mean[:400], seen.filters[0].replayed.mean[:400], rtol=1e-9, atol=1e-12)


def test_a_true_filter_is_called_inconsistent_in_one_record_of_a_hundred_at_most():
    """0.3 % by the mean square and 0.3 % by the autocorrelation: 12 of 2000, and 25 in one of 2000 such sets."""
    normalised = np.random.default_rng(2).standard_normal((2000, 800))
    judged = [innovations_of("laser", "m", row, np.ones(800)) for row in normalised]
    assert sum(not (each.consistent and each.white) for each in judged) <= 25


def test_a_filter_that_knows_the_noise_is_consistent_and_as_good_as_it_says(seen, log):
    for one in seen.filters:
        assert one.trusted, str(seen)
        error = (one.replayed.mean - log[0])[500:] / one.replayed.deviation[500:]
        np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), 1.0, atol=0.3)  # some 30 independent errors


def test_a_filter_that_is_told_too_little_noise_is_not_and_one_that_is_told_too_much_is_cautious(log):
    bold = ff.observe(damped({**TRUE, "laser": 1e-5}), log[1], find=False).filters[0]
    assert (bold.trusted, bold.cautious) == (False, False)
    (square,) = [one.mean_square for one in bold.innovations if one.sensor == "laser"]
    assert square == pytest.approx(4.0, rel=0.2)  # a quarter of the variance that there is
    noises = {**TRUE, "acceleration": 10.0 * TRUE["acceleration"], "voltage": 0.6}
    one = ff.observe(damped(noises), log[1], find=False).filters[0]
    assert (one.trusted, one.cautious) == (False, True)
    error = (one.replayed.mean - log[0])[500:, 0]
    assert np.sqrt(np.mean(error**2)) < np.median(one.replayed.deviation[500:, 0])
    assert "bound" not in one.sentence


def test_self_sensing_finds_the_distance_from_voltage_and_current(log):
    """The laser checks; the filter claims what it reaches."""
    one = ff.observe(damped(), log[1], sensors=("current",), find=False).filters[0]
    assert one.trusted
    (check,) = [channel for channel in one.beside if not channel.used]
    assert check.column == "distance_m"
    error = (one.replayed.mean - log[0])[:, 0]
    assert error[500:].std() < 2.0 * np.median(one.replayed.deviation[500:, 0])
    assert f"rms; the recorded one lies {amount(check.rms, 'm')} rms from it" in one.sentence
    assert one.claimed_m == pytest.approx(np.sqrt(np.mean(one.replayed.deviation[2000:, 0] ** 2)))
    assert check.rms == pytest.approx(np.hypot(np.sqrt(np.mean(error**2)), TRUE["laser"]), rel=0.05)


def test_clipped_readings_are_said_and_not_believed(log):
    (shunt, laser), record = damped().other_sensors, log[1]
    model = replace(damped(), other_sensors=(replace(shunt, maximum=0.35), laser))
    current = np.minimum(record.rows["current_A"].to_numpy(), 0.35)
    found = ff.observe(model, changed(record, current_A=current), find=False)
    clipped = int((current == 0.35).sum())
    assert clipped > 500
    assert found.filters[0].innovations[0].count == 4000 - clipped
    assert "check first" in str(found).splitlines()[1]


@pytest.mark.parametrize("samples", [2, 5, 7, 12])
def test_a_record_shorter_than_a_rest_is_observed_at_a_stop(samples):
    model = replace(solenoid(), sample_time_s=STEP_S, other_sensors=damped().other_sensors)
    record = series(np.zeros(samples), np.zeros(samples), np.linspace(3.9e-3, 4e-3, samples))
    assert len(ff.observe(model, record, find=False).filters[0].replayed.mean) == samples


def test_a_body_on_a_stop_at_the_end_of_the_domain_has_not_left_it():
    model = solenoid()
    box = within(model.validity, distance_min_m=0.2e-3, distance_max_m=4e-3, low=0.0)
    # A tenth of the true noise, so that the filter claims too much
    loops = [switched([0.0, 0.02, 0.08], [0.0, 12.0, 0.0], 0.12)]
    record = replace(logged(loops), declared_noise={"current_A": 5e-4, "distance_m": 2e-6})
    found = ff.observe(replace(model, validity=box), record, find=False)
    assert "outside-domain" not in {finding.code for finding in found.findings}


def test_a_noise_found_is_written_without_the_rounding_that_the_converter_adds():
    """A shunt of 10 bits over 4 A, whose steps make 1.1 mA of the 4 mA."""
    shunt, laser = damped().other_sensors
    rounded = replace(damped(), other_sensors=(replace(shunt, minimum=-2.0, maximum=2.0, bits=10), laser))
    written = with_noise(rounded, FoundNoise((noise("current", "A", 4e-3, of_sensor=True),), 100, None))
    assert reading_of(written, "current").white == pytest.approx(4e-3)


def noise(name, unit, value, *, of_sensor):
    return NoiseEstimate(name, unit, value, value, 0.9 * value, 1.1 * value, known=True, of_sensor=of_sensor)


def test_a_sensor_that_is_called_as_a_noise_of_the_process_keeps_its_own():
    named = replace(damped(), other_sensors=(replace(damped().other_sensors[0], name="acceleration"),))
    process = noise("acceleration", "m/s^1.5", 0.3, of_sensor=False)
    reading = noise("acceleration", "A", 4e-3, of_sensor=True)
    for estimates in ((process, reading), (reading, process)):
        written = with_noise(named, FoundNoise(estimates, 100, None))
        assert reading_of(written, "acceleration").white == pytest.approx(4e-3)
        assert written.process_noise.acceleration_density == pytest.approx(0.09)
    # What the record does not tell stays
    again = with_noise(written, FoundNoise((noise("voltage", "V", 0.1, of_sensor=False),), 100, None))
    assert again.process_noise == ProcessNoise(written.process_noise.acceleration_density, 0.1)
    assert reading_of(again, "acceleration").white == pytest.approx(4e-3)


@pytest.mark.nightly
def test_a_slow_sensor_whose_readings_the_recorder_repeats_is_the_same_as_one_with_gaps(log):
    shunt, laser = damped().other_sensors
    slow = replace(damped(), other_sensors=(shunt, replace(laser, sample_time_s=5e-4)))
    gaps = every_fifth(log[1])
    held = changed(gaps, distance_m=gaps.rows["distance_m"].ffill())
    one, other = (ff.observe(slow, record, find=False).filters[0] for record in (gaps, held))
    np.testing.assert_array_equal(other.replayed.mean, one.replayed.mean)
    assert any(finding.code == "repeated" for finding in ff.observe(slow, held, find=False).findings)


@pytest.mark.nightly
def test_the_true_noise_lies_in_its_interval_in_most_of_20_records():
    """Of twenty intervals of 95 % sixteen or more hold the truth but for 0.3 % of such sets."""
    held = dict.fromkeys(TRUE, 0)
    for record in logs(4000, 20, seed=11)[1]:
        for estimate in ff.observe(damped(), record).noise.estimates:
            held[estimate.name] += estimate.low <= TRUE[estimate.name] <= estimate.high
    assert min(held.values()) >= 16, held


@pytest.mark.parametrize(
    ("options", "columns", "said"),
    [
        ({"sensors": ("radar",)}, ("voltage_V", "current_A"), "radar"),
        ({"sensors": ("laser",)}, ("voltage_V", "current_A"), "laser"),
        ({}, ("current_A", "distance_m"), "voltage_V"),
    ],
)
def test_what_cannot_be_filtered_is_refused_with_what_is_needed(log, options, columns, said):
    record = replace(log[1], given=("time_s", *columns))
    with pytest.raises((FilterError, TableError, MissingPartError), match=said):
        ff.observe(damped(), record, **options)


@pytest.mark.parametrize("samples", [40, 126, 550])
def test_a_short_record_is_filtered_and_its_noise_is_sought_where_there_is_enough(log, samples):
    """The stroke of a relay at 0.1 ms a sample is 126 samples."""
    short = replace(log[1], rows=log[1].rows[:samples])
    found = ff.observe(damped(), short)
    one = found.filters[0]
    assert one.lost_at_s is None
    if samples < 60:
        assert "no-noise-found" in {each.code for each in found.findings}
        assert (found.noise, one.trusted) == (None, False)  # nothing was judged
    else:
        assert one.innovations[0].count == samples
        assert all(each.low <= TRUE[each.name] <= each.high for each in found.noise.estimates if each.known)


def test_the_noise_is_found_whatever_the_filter_was_given(log):
    wrong = damped({"acceleration": 1e-1, "voltage": 0.05, "current": 6e-3, "laser": 1.3e-5})
    found = ff.observe(wrong, log[1])
    known = {one.name: one.value for one in found.noise.estimates if one.known}
    assert known == pytest.approx({name: TRUE[name] for name in known}, rel=0.4)
    assert len(known) >= 3
    assert ff.observe(with_noise(found.model, found.noise), log[1], find=False).filters[0].trusted


def every_fifth(record):
    """The same record with a laser that is read five times more slowly."""
    slow = np.where(np.arange(len(record.rows)) % 5 == 0, record.rows["distance_m"], np.nan)
    return changed(record, distance_m=slow)


def test_the_noise_of_a_slow_sensor_is_guessed_from_the_readings_that_there_are(log):
    model = damped({**TRUE, "laser": 0.0})
    found = ff.observe(model, every_fifth(log[1]), find=False)
    assert found.filters[0].built.process.outputs[1].variance ** 0.5 == pytest.approx(TRUE["laser"], rel=0.3)


@pytest.mark.parametrize(
    ("name", "parameters", "record", "state"),
    [
        pytest.param("current_gain", {"gain_error": 0.03}, lambda d, v, i: (d, i / 1.03), 2, marks=pytest.mark.nightly),
        ("position_delay", {"delay_s": 2e-3}, lambda d, v, i: (d - 2e-3 * v, i), 0),
    ],
)
def test_a_sensor_with_an_error_is_followed_once_the_model_has_its_effect(log, name, parameters, record, state):
    truth, exact = log
    d, i = record(exact.rows["distance_m"], truth[:, 1], exact.rows["current_A"])
    wrong = changed(exact, distance_m=d, current_A=i)
    models = damped(), under_effects(damped(), (name, parameters))
    seen = [ff.observe(model, wrong, find=False).filters[0] for model in models]
    before, after = (np.sqrt(np.mean((one.replayed.mean[500:, state] - truth[500:, state]) ** 2)) for one in seen)
    assert after < 0.5 * before
    for judged in seen[1].innovations:
        assert judged.mean_square == pytest.approx(1.0, abs=0.1)  # 4000 samples: 0.02


def test_a_filter_that_is_nowhere_near_the_readings_finds_no_noise():
    seen = ff.observe(damped(), logs(600, 1, seed=3)[1][0], find=False).filters[0]
    away = replace(seen.prepared, readings=1e200 * seen.prepared.readings)
    assert find_noise(replace(seen, prepared=away)) is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"filter": "kf"}, "Did you mean ukf.*ekf4"),
        ({"filter": "ukf4", "biases": ("nix",)}, "A bias must be one of"),
        ({"biases": ("laser",)}, "No bias is estimated by ukf"),
    ],
)
def test_a_filter_or_a_bias_that_there_is_not_is_answered_with_those_that_there_are(log, options, words):
    with pytest.raises(UsageError, match=words):
        ff.observe(damped(), log[1], **options)
