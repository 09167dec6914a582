"""What a record says in each window, and what the model without any effect says, from every single sample."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.effects.conditions import Nominal
from femfit.identify.series.balances import FORCE_BALANCE, VOLTAGE_BALANCE
from femfit.identify.series.field import SampleField
from femfit.identify.series.noise import SensorNoise, carried, propagated
from femfit.identify.series.samples import Samples
from femfit.identify.series.weights import Windows, held_weights, window_weights
from femfit.model.actuator_model import ActuatorModel, Circuit, Motion

Noise = Mapping[str, SensorNoise]

_METHOD = 3e-5
"""Accuracy of the balances themselves, over the largest force, voltage and swing of the Hall output: a held command's
kinks of the current in a window of 36 samples."""

_EVEN = 1.5
"""A step of the clock longer than this many times the usual one hides commands of the driver."""


@dataclass(frozen=True, eq=False)
class MeasuredChannel:
    """A channel's windows, each of n.

    Parameters
    ----------
    measured, predicted : array, shape (n,)
        Left and right side of the balance; the model's without effects.
    sigma : array, shape (n,)
        What the sensors' noise makes of their difference; NaN where a sensor's noise is not known.
    valid : array of bool, shape (n,)
        Windows with samples enough.
    """

    name: str
    measured: FloatArray
    predicted: FloatArray
    sigma: FloatArray
    valid: BoolArray


def measure_balances(
    base: ActuatorModel, nominal: Nominal, samples: Samples, field: SampleField, noise: Noise, windows: Windows
) -> list[MeasuredChannel]:
    """Both sides of every balance that record and model allow."""
    result = []
    if base.motion is not None:
        result.append(_force_balance(base.motion, nominal, samples, field, noise, windows))
    if base.circuit is not None and np.isfinite(samples.columns["voltage_V"]).any():
        result.append(_voltage_balance(base.circuit, nominal, samples, field, noise, windows))
    return [channel for channel in result if channel.valid.any()]


def measure_sensors(
    base: ActuatorModel, nominal: Nominal, samples: Samples, field: SampleField, noise: Noise, windows: Windows
) -> list[MeasuredChannel]:
    """What every sensor read that the record and the model have, and what it should have read."""
    sensors = [("force_N", field.force, field.force_d, field.force_i, nominal.force_N)]
    if base.sensor is not None:
        sensors.append(("hall_V", field.hall, field.hall_d, field.hall_i, nominal.hall_swing_V))
    result = []
    for name, model, along_distance, along_current, scale in sensors:
        values = samples.columns[name]
        if not np.isfinite(values).any():
            continue
        weights = window_weights(windows, samples.time, samples.segment, samples.usable & np.isfinite(values))
        sigma = propagated(
            weights.mean,
            (weights.mean, noise[name]),
            (carried(weights.mean, along_distance), noise["distance_m"]),
            (carried(weights.mean, along_current), noise["current_A"]),
        )
        measured = weights.mean @ np.nan_to_num(values)
        result.append(
            MeasuredChannel(name, measured, weights.mean @ model, np.hypot(sigma, _METHOD * scale), weights.valid)
        )
    return [channel for channel in result if channel.valid.any()]


def _force_balance(
    motion: Motion, nominal: Nominal, samples: Samples, field: SampleField, noise: Noise, windows: Windows
) -> MeasuredChannel:
    state = window_weights(windows, samples.time, samples.segment, samples.usable)
    distance = np.nan_to_num(samples.columns["distance_m"])
    sigma = propagated(
        state.mean,
        (motion.mass_kg * state.curvature + carried(state.mean, field.force_d), noise["distance_m"]),
        (carried(state.mean, field.force_i), noise["current_A"]),
    )
    measured = motion.mass_kg * (motion.gravity_m_s2 - state.curvature @ distance)
    return MeasuredChannel(
        FORCE_BALANCE, measured, state.mean @ field.force, np.hypot(sigma, _METHOD * nominal.force_N), state.valid
    )


def _voltage_balance(
    circuit: Circuit, nominal: Nominal, samples: Samples, field: SampleField, noise: Noise, windows: Windows
) -> MeasuredChannel:
    volts, current = samples.columns["voltage_V"], np.nan_to_num(samples.columns["current_A"])
    driven, mean, slope, valid = held_weights(windows, samples.time, samples.segment, samples.usable, _held(samples))
    sigma = propagated(
        mean,
        (circuit.resistance_ohm * mean + carried(slope, field.inductance), noise["current_A"]),
        (carried(slope, field.force_i), noise["distance_m"]),
    )
    here, inside = np.flatnonzero(samples.usable), field.inductance > 0.0
    # Between samples the current settles towards the held command, by which a trapezoid over it is h^2 i'' / 12 short
    step = np.median(np.diff(samples.time[here])) if len(here) > 1 else 0.0
    settling = (
        (circuit.resistance_ohm * step) ** 2 / 12.0 / np.median(field.inductance[inside]) if inside.any() else 0.0
    )
    predicted = circuit.resistance_ohm * (mean @ current) + slope @ (field.flux + settling * current)
    return MeasuredChannel(
        VOLTAGE_BALANCE,
        driven @ np.nan_to_num(volts),
        predicted,
        np.hypot(sigma, _METHOD * nominal.voltage_V),
        valid,
    )


def _held(samples: Samples) -> BoolArray:
    """Whether the command is known from each usable sample to the next one."""
    here = np.flatnonzero(samples.usable)
    result = np.zeros(len(samples.time), dtype=bool)
    if len(here) < 2:
        return result
    step = np.diff(samples.time[here])
    inside = np.diff(samples.segment[here]) == 0
    usual = np.median(step[inside]) if inside.any() else 0.0
    uneven = inside.any() and float(np.quantile(step[inside], 0.9)) > _EVEN * usual
    result[here[:-1]] = inside & (uneven | (step < _EVEN * usual))
    return np.asarray(result & np.isfinite(samples.columns["voltage_V"]))
