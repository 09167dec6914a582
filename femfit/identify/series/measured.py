"""What a record says in each window, and what the model without any effect says, from every single sample."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.device.circuit import Circuit
from femfit.device.mechanics import Mechanics
from femfit.effects.conditions import Nominal
from femfit.effects.stop_position import REST
from femfit.identify.series.balances import FORCE_BALANCE, VOLTAGE_BALANCE
from femfit.identify.series.constants import EVEN, METHOD_ACCURACY
from femfit.identify.series.noise import SensorNoise, carried, propagated
from femfit.identify.series.samples import Samples
from femfit.identify.series.weights import Windows, held_weights, window_weights
from femfit.model.actuator_model import ActuatorModel
from femfit.records.noise import converter_step, white_noise


@dataclass(frozen=True, eq=False)
class SampleField:
    """Magnetics and Hall voltage at the N samples with derivatives in distance and current; zero where unusable.

    -force_i is the flux linkage's derivative in distance. Flux linkage and inductance are those of the circuit, with
    what is in series outside of the field.
    """

    force: FloatArray
    force_d: FloatArray
    force_i: FloatArray
    flux: FloatArray
    inductance: FloatArray
    hall: FloatArray
    hall_d: FloatArray
    hall_i: FloatArray


def sample_field(base: ActuatorModel, samples: Samples) -> SampleField:
    """Evaluate a model at the samples of a record."""
    here = samples.usable
    d, i = samples.columns["distance_m"][here], samples.columns["current_A"][here]

    def everywhere(values: FloatArray) -> FloatArray:
        result = np.zeros(len(here))
        result[here] = values
        return result

    d_w, dd_w, di_w, i_w, ii_w = base.magnetics.coenergy_derivatives(d, i, ((1, 0), (2, 0), (1, 1), (0, 1), (0, 2)))
    if base.circuit is not None:
        i_w, ii_w = i_w + base.circuit.inductance_H * i, ii_w + base.circuit.inductance_H
    hall = [np.zeros_like(d)] * 3
    if base.sensor is not None:
        hall = [base.sensor.sensitivity_V_per_T * part for part in base.sensor.field.derivatives(d, i)]
        hall[0] = hall[0] + base.sensor.quiescent_V
    return SampleField(*(everywhere(values) for values in (-d_w, -dd_w, -di_w, i_w, ii_w, *hall)))


def sensor_noise(
    base: ActuatorModel, samples: Samples, field: SampleField, declared: Mapping[str, float]
) -> dict[str, SensorNoise]:
    """Noise of every sensor: as declared, else from neighbouring samples beside what the model says of them.

    For the current the driving voltage says it; no noise is smaller than the converter's step over sqrt(12).
    """
    known = np.where(samples.usable, 0.0, np.nan)
    explained = {
        "distance_m": known,
        "current_A": known + _driven(base, samples, field),
        "hall_V": known + field.hall,
        "force_N": known + field.force,
    }
    result = {}
    for name, model in explained.items():
        values = samples.columns[name]
        step = converter_step(values)
        seen = max(white_noise(values - model, samples.segment), step / np.sqrt(12.0))
        result[name] = SensorNoise(float(declared.get(name, seen)), step, values)
    return result


def _driven(base: ActuatorModel, samples: Samples, field: SampleField) -> FloatArray:
    """The current that commanded voltage and motion give, up to what is smooth; zeros without circuit or voltage."""
    volts, distance = samples.columns["voltage_V"], samples.columns["distance_m"]
    if base.circuit is None or not np.isfinite(volts).any():
        return np.zeros_like(volts)
    step = np.diff(samples.time, prepend=samples.time[:1])
    inductance = np.where(field.inductance > 0.0, field.inductance, np.inf)
    held = np.append(volts[:1], volts[:-1])
    motional = field.force_i * np.diff(distance, prepend=distance[:1])
    drop = base.circuit.resistance_ohm * samples.columns["current_A"]
    change = np.where(samples.usable, ((held - drop) * step + motional) / inductance, 0.0)
    return np.cumsum(np.nan_to_num(change))


Noise = Mapping[str, SensorNoise]


@dataclass(frozen=True, eq=False)
class MeasuredChannel:
    """A channel's n windows: both sides of its balance, the model's without effects, and whether samples are enough.

    ``sigma`` is what the sensors' noise makes of their difference; NaN where a sensor's noise is not known.
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
            MeasuredChannel(
                name, measured, weights.mean @ model, np.hypot(sigma, METHOD_ACCURACY * scale), weights.valid
            )
        )
    return [channel for channel in (*result, _rest(nominal, samples, noise, windows)) if channel.valid.any()]


def _rest(nominal: Nominal, samples: Samples, noise: Noise, windows: Windows) -> MeasuredChannel:
    """The recorded distance while the body rests on a stop, and where that is drawn."""
    at_rest = samples.usable & np.isfinite(samples.stop_m)
    weights = window_weights(windows, samples.time, samples.segment, at_rest)
    sigma = propagated(weights.mean, (weights.mean, noise["distance_m"]))
    return MeasuredChannel(
        REST,
        weights.mean @ np.nan_to_num(samples.columns["distance_m"]),
        weights.mean @ np.nan_to_num(samples.stop_m),
        np.hypot(sigma, METHOD_ACCURACY * nominal.travel_m),
        weights.valid,
    )


def _force_balance(
    motion: Mechanics, nominal: Nominal, samples: Samples, field: SampleField, noise: Noise, windows: Windows
) -> MeasuredChannel:
    state = window_weights(windows, samples.time, samples.segment, samples.usable & samples.free)
    distance = np.nan_to_num(samples.columns["distance_m"])
    stiffness = field.force_d - motion.static_gradient(distance)
    sigma = propagated(
        state.mean,
        (motion.mass_kg * state.curvature + carried(state.mean, stiffness), noise["distance_m"]),
        (carried(state.mean, field.force_i), noise["current_A"]),
    )
    friction = motion.friction(state.slope @ distance, nominal.sample_time_s)
    further = state.mean @ (motion.beside_weight(distance) + np.zeros_like(distance)) + friction
    measured = motion.mass_kg * (motion.gravity_m_s2 - state.curvature @ distance) + further
    return MeasuredChannel(
        FORCE_BALANCE,
        measured,
        state.mean @ field.force,
        np.hypot(sigma, METHOD_ACCURACY * nominal.force_N),
        state.valid,
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
        np.hypot(sigma, METHOD_ACCURACY * nominal.voltage_V),
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
    uneven = inside.any() and float(np.quantile(step[inside], 0.9)) > EVEN * usual
    result[here[:-1]] = inside & (uneven | (step < EVEN * usual))
    return np.asarray(result & np.isfinite(samples.columns["voltage_V"]))
