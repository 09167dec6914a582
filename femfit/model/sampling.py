"""What the samples of a sensor are made of: the values of a few states at this sample and at earlier ones.

reading_k = sum over j of c_j g(x_(k-j)). For a sensor that is late by a part of a sample, g is interpolated between two
samples. A pickup coil's g is its flux linkage, and its reading the mean voltage over the sample.
"""

from math import floor

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.pickup import PickupSensor
from femfit.model.sensors import AnySensor, predict_sensor, require_no_eddies

WHOLE = 1e-6
"""Numerical: a delay this near to a whole number of samples is one."""

SAMPLES_OF_A_STROKE = 100.0
"""Assumed: samples in which a body goes through its stroke, where a speed must be guessed."""


def sample_weights(sensor: AnySensor, step_s: float) -> FloatArray:
    """c_0, c_1, .. of a sensor that is sampled with a step in s; the last is not zero."""
    delay = sensor.delay_s / step_s
    whole = floor(delay + WHOLE)
    part = max(0.0, delay - whole)
    part = 0.0 if part < WHOLE else part
    weights = np.zeros(whole + 2)
    weights[whole], weights[whole + 1] = 1.0 - part, part
    weights = weights[: whole + 1] if part == 0.0 else weights
    return np.convolve(weights, [1.0 / step_s, -1.0 / step_s]) if isinstance(sensor, PickupSensor) else weights


def sampled_value(
    model: ActuatorModel, sensor: AnySensor, state: FloatArray, time: FloatArray | float = 0.0
) -> FloatArray:
    """The g of the module's head, of shape (...): a flux linkage in Wb, or what the sensor reads without its delay."""
    if isinstance(sensor, PickupSensor):
        require_no_eddies(model, f"what pickup coil {sensor.name!r} reads")
        return sensor.flux.field(state[..., 0], model.currents_of(state))
    return predict_sensor(model, sensor, state, time)


def sampled_readings(model: ActuatorModel, sensor: AnySensor, states: FloatArray) -> FloatArray:
    """Readings without noise along states of shape (samples, n); before the first it was as at the first."""
    values, row = sampled_value(model, sensor, states), np.arange(len(states))
    weights = enumerate(sample_weights(sensor, model.sample_time_s))
    return np.asarray(np.sum([weight * values[np.maximum(row - k, 0)] for k, weight in weights], axis=0))


def readings_span(model: ActuatorModel, sensor: AnySensor) -> float:
    """Width of the readings over the validity domain, in the sensor's unit; of a body at a usual speed in a coil."""
    distance, currents = model.validity.grid(9, 3 if len(model.circuits) > 1 else 9)
    states, n = np.zeros((distance.size, model.order)), len(model.circuits)
    states[:, 0], states[:, 2 : 2 + n] = distance, currents.reshape(distance.size, -1)[:, :n]
    span = float(np.ptp(sampled_value(model, sensor, states)))
    return span / (SAMPLES_OF_A_STROKE * model.sample_time_s) if isinstance(sensor, PickupSensor) else span
