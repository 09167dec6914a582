"""The Hall sensor: converter, noise, drift and faults."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.simulation.sensor import SensorErrors, convert, read_sensor

STEP_S = 0.5e-3


@pytest.fixture
def sensor(levitation_model):
    return levitation_model.sensor


def readings(sensor, errors, steps, runs=1, seed=0, state=(0.025, 0.0, 0.5)):
    random, reading = np.random.default_rng(seed), np.zeros(runs)
    volts = np.tile(sensor.voltage(state[0], state[2]), runs)
    values = []
    for k in range(steps):
        reading = read_sensor(sensor, errors, reading, volts, k * STEP_S, random)
        values.append(reading)
    return np.array(values)


def test_twelve_bits_over_five_volts_are_steps_of_one_and_a_fifth_millivolts(sensor):
    assert sensor.quantisation_step == pytest.approx(1.2207e-3, rel=1e-4)
    volts = np.linspace(0.1, 4.9, 100_001)
    codes = convert(sensor, volts) / sensor.quantisation_step
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)
    error = convert(sensor, volts) - volts
    assert np.abs(error).max() <= 0.5 * sensor.quantisation_step * (1 + 1e-9)
    assert error.std() == pytest.approx(sensor.quantisation_step / np.sqrt(12.0), rel=1e-3)


def test_the_output_is_clipped_to_its_range(sensor):
    top = sensor.output_max_V - sensor.quantisation_step  # the largest code
    np.testing.assert_allclose(convert(sensor, np.array([-1.0, 9.0])), [sensor.output_min_V, top])


def test_no_converter_leaves_the_voltage_alone(sensor):
    free = replace(sensor, adc_bits=0)
    np.testing.assert_array_equal(convert(free, np.array([1.23456789])), [1.23456789])
    assert free.quantisation_step == 0.0


def test_white_noise_has_its_deviation_and_no_correlation(sensor):
    free = replace(sensor, adc_bits=0)
    values = readings(free, SensorErrors(noise_V=3.2e-3), steps=20_000)[:, 0]
    noise = values - free.voltage(np.asarray(0.025), np.asarray(0.5))
    assert noise.std() == pytest.approx(3.2e-3, rel=0.02)  # 1/sqrt(2 * 20000) = 0.5 %
    assert abs(noise.mean()) < 4 * 3.2e-3 / np.sqrt(20_000)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 4 * 3.2e-3**2 / np.sqrt(20_000)


def test_offset_and_ramp_add_volts(sensor):
    free = replace(sensor, adc_bits=0)
    clean = free.voltage(np.asarray(0.025), np.asarray(0.5))
    values = readings(free, SensorErrors(offset_V=0.02, drift_V_per_s=0.1), steps=101)[:, 0]
    np.testing.assert_allclose(values - clean, 0.02 + 0.1 * STEP_S * np.arange(101), atol=1e-12)


def test_a_stuck_sensor_repeats_its_last_reading(sensor):
    values = readings(sensor, SensorErrors(noise_V=3.2e-3, stuck_after_s=10 * STEP_S), steps=30)[:, 0]
    assert len(np.unique(values[:10])) > 3
    np.testing.assert_array_equal(values[10:], values[9])


def test_dropouts_read_the_lower_end_as_often_as_told(sensor):
    values = readings(sensor, SensorErrors(dropout_probability=0.1), steps=200, runs=100)
    assert np.mean(values == sensor.output_min_V) == pytest.approx(0.1, abs=0.01)  # 4.7 sigma of 20000 draws


def test_blocks_of_runs_share_their_noise(sensor):
    errors = SensorErrors(noise_V=3.2e-3, offset_V=np.repeat([0.0, 0.5], 3), blocks=2)
    free = replace(sensor, adc_bits=0)
    values = readings(free, errors, steps=5, runs=6)
    np.testing.assert_allclose(values[:, 3:] - values[:, :3], 0.5, atol=1e-12)
    assert np.ptp(values[:, :3]) > 1e-3
