"""Readings of several sensors of a model at once."""

import numpy as np

from femfit.model.sensors import predict_sensor, sensor_named, sensors_of


def predict_sensors(model, state, names=None):
    """Without noise, clipping and rounding, of shape (..., sensors); of all sensors where none is named."""
    chosen = tuple(sensors_of(model)) if names is None else names
    return np.stack([predict_sensor(model, sensor_named(model, name), state) for name in chosen], axis=-1)
