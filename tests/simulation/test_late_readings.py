"""Late sensors and pickup coils of a simulated loop read what filters are told that they read."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.model.sensors import sampled_readings, sensor_named
from femfit.simulation.sensor import History, loop_sensors, true_readings
from tests.support.pickups import STEP_S, searched

TIME = STEP_S * np.arange(60)
PATH = np.stack([2.5e-3 + 4e-4 * np.sin(200.0 * TIME), 0.08 * np.cos(200.0 * TIME), 0.5 + 5.0 * TIME], axis=1)


def read_by_the_loop(model, name, path=PATH):
    """Readings without noise along a path, one sample after the other."""
    sensors = loop_sensors(model, (name,), {name: 0.0}, model.sample_time_s)
    history = History(sensors, path[:1], model.sample_time_s)
    found = [true_readings(model, sensors, history)[0, 0]]
    for state in path[1:]:
        history.add(state[None])
        found.append(true_readings(model, sensors, history)[0, 0])
    return np.array(found)


@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
def test_a_pickup_coil_reads_the_mean_voltage_of_a_sample(delay):
    model = searched(noise=1e-3, delay_s=delay * STEP_S)
    wanted = sampled_readings(model, sensor_named(model, "search"), PATH)
    found = read_by_the_loop(model, "search")
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.ptp(wanted))
    assert np.ptp(wanted) > 0.0


@pytest.mark.parametrize("delay", [1.0, 2.5])
def test_a_late_hall_element_reads_an_earlier_field(levitation_model, delay):
    model = replace(levitation_model, sample_time_s=STEP_S)
    model = replace(model, sensor=replace(model.sensor, delay_s=delay * STEP_S))
    places = PATH + np.array([20e-3, 0.0, 0.0])
    found, wanted = read_by_the_loop(model, "hall", places), sampled_readings(model, model.sensor, places)
    prompt = model.sensor.voltage(places[:, 0], places[:, 2])
    np.testing.assert_allclose(wanted[5:], np.interp(TIME[5:] - delay * STEP_S, TIME, prompt), rtol=1e-9)
    # Within a sample the loop takes the motion's cubic, the filter a line: d'' T^2 / 8 apart, with d'' up to 16 m/s^2
    slope = np.abs(model.sensor.field.derivatives(places[:, 0], places[:, 2])[1]).max()
    curved = 1.1 * model.sensor.sensitivity_V_per_T * slope * 16.0 * STEP_S**2 / 8.0
    np.testing.assert_allclose(found, wanted, atol=1e-9 if delay == 1.0 else curved)
