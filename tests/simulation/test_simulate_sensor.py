"""The sensors of a loop read what filters are told; self-sensing in simulation is as good as its bound."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

import femfit as ff
from femfit.core.errors import FilterError, UsageError
from femfit.device.electrics import CurrentSensor
from femfit.model.sensors import sampled_readings, sensor_named
from femfit.simulation.loop import _Watch
from femfit.simulation.plant import SensorBank, SensorErrors, convert, loop_sensors, sensor_noise
from support.parts import with_sensor
from support.readings import LASER, SHUNT
from support.solenoids import STEP_S as PICKUP_STEP_S
from support.solenoids import searched, solenoid

STEP_S = 0.5e-3


def of(model, noise=0.0, names=("hall",)):
    return loop_sensors(model, dict.fromkeys(names, noise), STEP_S)


AT_REST = (0.025, 0.0, 0.5)


def readings(model, errors, steps, runs=1, noise=0.0, names=("hall",)):
    """Of bodies at rest, shape (steps, runs, sensors)."""
    still = np.tile(AT_REST, (runs, 1))
    sensing = SensorBank(model, of(model, noise, names), errors, still, np.random.default_rng(0))
    return np.array([sensing.read(k, k * STEP_S) for k in range(steps)])


@pytest.fixture
def free(levitation_model):
    return with_sensor(levitation_model, adc_bits=0)


def test_a_converter_rounds_within_half_a_step_and_clips_to_its_range(levitation_model, free):
    (one,), (exact,) = of(levitation_model), of(free)
    step, volts = one.reading.step, np.linspace(0.1, 4.9, 100_001)
    assert step == pytest.approx(1.2207e-3, rel=1e-4)
    found = convert(one, volts)
    np.testing.assert_allclose(found / step, np.round(found / step), atol=1e-9)
    assert np.abs(found - volts).max() <= 0.5 * step * (1 + 1e-9)
    assert (found - volts).std() == pytest.approx(step / np.sqrt(12.0), rel=1e-3)
    np.testing.assert_allclose(convert(one, np.array([-1.0, 9.0])), [0.0, 5.0 - step])
    np.testing.assert_array_equal(convert(exact, np.array([1.23456789])), [1.23456789])
    assert exact.reading.step == 0.0


def test_white_noise_has_its_deviation_and_no_correlation(free):
    values = readings(free, SensorErrors(), steps=20_000, noise=3.2e-3)[:, 0, 0]
    noise = values - free.sensor.voltage(np.asarray(0.025), np.asarray(0.5))
    assert noise.std() == pytest.approx(3.2e-3, rel=0.02)  # 1/sqrt(2 * 20000) = 0.5 %
    assert abs(noise.mean()) < 4 * 3.2e-3 / np.sqrt(20_000)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 4 * 3.2e-3**2 / np.sqrt(20_000)


def test_offset_drift_a_stuck_sensor_and_dropouts_read_as_told(free, levitation_model):
    clean = free.sensor.voltage(np.asarray(0.025), np.asarray(0.5))
    values = readings(free, SensorErrors(offset=0.02, drift_per_s=0.1), steps=101)[:, 0, 0]
    np.testing.assert_allclose(values - clean, 0.02 + 0.1 * STEP_S * np.arange(101), atol=1e-12)
    values = readings(levitation_model, SensorErrors(stuck_after_s=10 * STEP_S), steps=30, noise=3.2e-3)[:, 0, 0]
    assert len(np.unique(values[:10])) > 3
    np.testing.assert_array_equal(values[10:], values[9])
    values = readings(levitation_model, SensorErrors(dropout_probability=0.1), steps=200, runs=100)
    # 4.7 sigma of 20000 draws
    assert np.mean(values == levitation_model.sensor.output_min_V) == pytest.approx(0.1, abs=0.01)


@pytest.fixture
def several(levitation_model):
    """Beside the Hall element a laser that is 1.3 samples late and an ammeter that is read at every fourth sample."""
    laser = replace(LASER, noise=1e-6, delay_s=1.3 * STEP_S)
    ammeter = CurrentSensor(name="ammeter", circuit="coil", sample_time_s=4 * STEP_S, noise=1e-3)
    return replace(levitation_model, other_sensors=(laser, ammeter))


def test_a_late_sensor_reads_what_was_there_before(several):
    """Between two samples on a line, d'' t (T - t) / 2 off a parabola."""
    sensors = of(several, names=("laser",))

    def state(time):
        return np.array([[0.02 + 0.1 * time + 5.0 * time**2, 0.1 + 10.0 * time, 0.4]])

    sensing = SensorBank(several, sensors, SensorErrors(), state(0.0), np.random.default_rng(0))
    for k in range(1, 6):
        sensing.see(state(k * STEP_S), k * STEP_S)
        if k >= 2:  # before that the body was at rest
            wanted = state((k - 1.3) * STEP_S)[0, 0] + 0.5 * 10.0 * 0.3 * 0.7 * STEP_S**2
            assert sensing.exact[0, 0] == pytest.approx(wanted, abs=1e-15)


def test_a_body_at_the_end_of_the_domain_is_held_to_rounding_and_time_begins_at_the_first_sample(
    levitation_model, monkeypatch
):
    box, times, see = levitation_model.validity, [], SensorBank.see
    state = np.array([[box.distance_max_m * (1.0 + 1e-12), 0.0, 0.3]])
    watch = _Watch(levitation_model, 1)
    observed = SimpleNamespace(mean=state, diverged=np.zeros(1, dtype=bool))
    assert watch.alive(0.0, state, observed, np.zeros((2, 1), dtype=bool), np.zeros(1)).all()
    monkeypatch.setattr(SensorBank, "see", lambda bank, state, time: (times.append(time), see(bank, state, time))[1])
    ff.close_loop(levitation_model, controller="pid", runs=1, seconds=2 * levitation_model.sample_time_s, rng=1)
    assert min(times) == 0.0
    assert max(times) == pytest.approx(2 * levitation_model.sample_time_s)


def test_a_slow_sensor_is_not_read_between_its_samples_and_a_fault_is_of_the_sensor_that_has_it(several):
    names = ("laser", "ammeter")
    assert [sensor.period for sensor in of(several, names=names)] == [1, 4]
    seen = readings(several, SensorErrors(), 8, names=names)[:, 0]
    assert np.isfinite(seen[:, 1]).tolist() == [True, False, False, False] * 2
    assert np.isfinite(seen[:, 0]).all()
    wrong = readings(several, SensorErrors(faulty="ammeter", offset=0.25), 1, names=names)[0, 0]
    np.testing.assert_allclose(wrong, seen[0] + [0.0, 0.25], rtol=1e-15)


def test_noise_is_given_by_name_or_for_the_first_sensor(several):
    names = ("laser", "ammeter")
    for given, noises in ((None, [1e-6, 1e-3]), (2e-6, [2e-6, 1e-3]), ({"ammeter": 0.0}, [1e-6, 0.0])):
        assert sensor_noise(several, names, given) == dict(zip(names, noises, strict=True))
    with pytest.raises(UsageError, match="hall"):
        sensor_noise(several, names, {"hall": 1.0})


TIME = PICKUP_STEP_S * np.arange(60)
PATH = np.stack([2.5e-3 + 4e-4 * np.sin(200.0 * TIME), 0.08 * np.cos(200.0 * TIME), 0.5 + 5.0 * TIME], axis=1)


def read_by_the_loop(model, name, path=PATH):
    """Readings without noise along a path, one sample after the other."""
    sensors = loop_sensors(model, {name: 0.0}, model.sample_time_s)
    sensing = SensorBank(model, sensors, SensorErrors(), path[:1], np.random.default_rng(0))
    found = [sensing.exact[0, 0]]
    for state in path[1:]:
        sensing.see(state[None], 0.0)
        found.append(sensing.exact[0, 0])
    return np.array(found)


@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
def test_a_pickup_coil_reads_the_mean_voltage_of_a_sample(delay):
    model = searched(noise=1e-3, delay_s=delay * PICKUP_STEP_S)
    wanted = sampled_readings(model, sensor_named(model, "search"), PATH)
    found = read_by_the_loop(model, "search")
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.ptp(wanted))
    assert np.ptp(wanted) > 0.0


@pytest.mark.parametrize("delay", [1.0, 2.5])
def test_a_late_hall_element_reads_the_field_of_an_earlier_part_of_a_sample(levitation_model, delay):
    """Within a sample the loop takes the motion's cubic, a line is d'' T^2 / 8 off it: here up to 16 m/s^2."""
    model = replace(with_sensor(levitation_model, delay_s=delay * PICKUP_STEP_S), sample_time_s=PICKUP_STEP_S)
    places = PATH + np.array([20e-3, 0.0, 0.0])
    prompt = levitation_model.sensor.voltage(places[:, 0], places[:, 2])
    wanted = np.interp(TIME - delay * PICKUP_STEP_S, TIME, prompt)
    slope = np.abs(np.gradient(prompt, places[:, 0])).max()
    found = read_by_the_loop(model, "hall", places)
    np.testing.assert_allclose(found[5:], wanted[5:], atol=1.1 * slope * 16.0 * PICKUP_STEP_S**2 / 8.0)


RUNS = 100


@pytest.fixture(scope="module")
def model():
    return replace(solenoid(), sample_time_s=1e-4, other_sensors=(replace(SHUNT, noise=4e-3),))


@pytest.fixture(scope="module")
def found(model):
    return ff.sense(model, runs=RUNS)


def test_the_filter_knows_nothing_before_the_command_and_is_near_the_bound_in_the_middle_of_the_stroke(found):
    assert found.rms_m[found.time_s < 0.02].min() > 0.3e-3  # of 1 mm, half of which the stop cuts off
    middle = (found.distance_m > 0.8e-3) & (found.distance_m < 3e-3)
    error, *said = (np.sqrt(np.mean(one[middle] ** 2)) for one in (found.rms_m, found.bound_m, found.claimed_m))
    # An error of the distance lasts through a run: as many independent ones as runs; 0.1 % of such sets are outside
    low, high = np.sqrt(chi2.ppf([1e-3, 1.0 - 1e-3], RUNS) / RUNS)
    assert all(low < error / one < high for one in said)


def test_a_test_voltage_lets_the_filter_see_at_rest(model, found):
    tested = ff.sense(model, test_voltage_V=4.0, runs=40)
    rest = (tested.time_s > 0.015) & (tested.time_s < 0.02)
    assert np.sqrt(np.mean(tested.rms_m[rest] ** 2)) < 0.5 * np.sqrt(np.mean(found.rms_m[rest] ** 2))


@pytest.mark.parametrize(
    ("error", "words", "options"),
    [
        (UsageError, "voltage_V", {"drive": ff.Profile("voltage", [0.0, 0.1], [12.0, 0.0]), "voltage_V": 3.0}),
        (FilterError, "sampling rate", {"test_voltage_V": 1.0, "test_frequency_Hz": 6e3}),
    ],
)
def test_two_commands_and_a_frequency_beyond_half_of_the_sampling_rate_are_refused(model, error, words, options):
    with pytest.raises(error, match=words):
        ff.sense(model, **options)


def test_the_current_is_read_by_the_sensor_of_that_kind_whatever_its_name(model):
    shunt = replace(model.other_sensors[0], name="shunt")
    assert ff.sense(replace(model, other_sensors=(shunt,)), runs=1).sensors == ("shunt",)


def test_what_a_filter_remembers_of_a_late_sensor_begins_where_the_body_was(model):
    laser = replace(LASER, noise=1e-5, delay_s=0.5e-4)
    found = ff.sense(replace(model, other_sensors=(laser,)), sensors=("laser",), runs=RUNS)
    # Half of the reading is what was remembered; a first estimate off by 1 mm must not make it more wrong
    assert found.rms_m[0] < found.claimed_m[0] < 1e-3
