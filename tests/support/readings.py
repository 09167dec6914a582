"""Sensors that many tests read, readings of several of a model at once, and what a filter knows before any."""

from dataclasses import replace

import numpy as np

from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor
from femfit.model.sensors import predict_sensor, sensor_named, sensors_of
from support.parts import free
from support.solenoids import solenoid

LASER = PositionSensor(name="laser", noise=2e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
LASER_10_V = PositionSensor(
    name="laser", distances_m=(0.0, 0.1), readings=(0.0, 10.0), noise=2e-3, minimum=0.0, maximum=10.0, bits=14
)
"""The same noise of 20 um as a voltage through a converter."""

SHUNT = CurrentSensor(name="current", noise=2e-3, circuit="coil")


def read_by(*sensors):
    """A solenoid without stops that sensors read every 0.1 ms."""
    return replace(free(solenoid()), sample_time_s=1e-4, other_sensors=sensors)


EVERY_SENSOR = (
    CurrentSensor(name="shunt", noise=1e-3, minimum=-2.0, maximum=2.0, bits=8, circuit="coil", gain=0.99),
    PositionSensor(name="laser", noise=1e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m", delay_s=1e-3),
    PositionSensor(name="gate", distances_m=(1e-3, 2e-3, 4e-3), readings=(5.0, 3.0, 1.0)),
    AccelerationSensor(name="mems"),
    ForceSensor(name="cell"),
    AccelerationSensor(name="proper", reads_gravity=True),
)
"""Of each kind that is no field's; no two of the first five have one column."""


def hall_voltage(model, states, time=0.0):
    """Output of the Hall element in V without noise and rounding."""
    return predict_sensor(model, model.require_sensor(), states, time)


def predict_sensors(model, state, names=None):
    """Without noise, clipping and rounding, of shape (..., sensors); of all sensors where none is named."""
    chosen = tuple(sensors_of(model)) if names is None else names
    return np.stack([predict_sensor(model, sensor_named(model, name), state) for name in chosen], axis=-1)


def initial_covariance(distance_m=1e-3, velocity_m_s=0.05, current_A=0.1, biases=()):
    """From standard deviations; those of biases after them."""
    return np.diag(np.square([distance_m, velocity_m_s, current_A, *biases]))
