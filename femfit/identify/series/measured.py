"""What a record says in each window, and how well, from every single sample.

The noise of each sensor's sample becomes one of the balances of short windows.

References
----------
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008), section 6 (dither).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import sparse

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.friction import REST
from femfit.estimate.constants import DECISIVE
from femfit.estimate.record import converter_step, white_noise
from femfit.identify.constants import LEAST_REPEATS
from femfit.identify.series.constants import METHOD_ACCURACY
from femfit.identify.series.motion import FORCE_BALANCE, Motion, model_readings, voltage_balances
from femfit.identify.series.samples import Samples, between_samples, held_from
from femfit.identify.series.views import View
from femfit.identify.series.weights import Weights, Windows, held_weights, window_weights
from femfit.identify.words import finding
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import MagneticState


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """One sensor's samples, with the standard deviation of their white noise (NaN where unknown) and their step."""

    white: float
    step: float
    values: FloatArray


def propagated(
    mean: sparse.csr_array,
    noise: Mapping[str, SensorNoise],
    weights: Mapping[str, sparse.csr_array],
    variance: FloatArray | float = 0.0,
) -> FloatArray:
    """Standard deviation of sums of noisy samples of independent sensors, each with weights of shape (n, N), by name.

    White noise adds up in squares. The error of a converter whose input hardly moves over a window, whose means have
    the weights ``mean``, is the same in all samples up to a few jumps; noise of the size of a step makes it white
    (dither), motion over several averages it. To these come errors of the variance ``further``, of shape (n,).
    """
    total = np.zeros(mean.shape[0]) + variance
    for name, sensor_weights in weights.items():
        sensor = noise[name]
        total += sensor.white**2 * np.asarray(sensor_weights.power(2).sum(axis=1)).ravel()
        if sensor.step:
            values = np.nan_to_num(sensor.values)
            dither = max((sensor.white / sensor.step) ** 2 - 1.0 / 12.0, 0.0)
            spread = (mean @ values**2 - (mean @ values) ** 2) / sensor.step**2 - dither
            moved = 1.0 + 28.0 * np.maximum(spread, 0.0)  # 28: a ramp over k steps has a spread of k^2 / 28
            same = sensor.step**2 / 12.0 * np.exp(-4.0 * np.pi**2 * dither) / moved
            total += same * _largest_partial_sum(sensor_weights) ** 2
    return np.asarray(np.sqrt(total))


def _largest_partial_sum(weights: sparse.csr_array) -> FloatArray:
    """Largest magnitude that the weights of a row add up to on the way: what a jump between two samples changes."""
    ordered = weights.sorted_indices()
    rows = (ordered.data[start:stop] for start, stop in pairwise(ordered.indptr))
    return np.array([np.abs(np.cumsum(row)).max(initial=0.0) for row in rows])


@dataclass(frozen=True, eq=False)
class Measured:
    """A channel's windows, and the weights of the model's side of its balance, valid where samples are enough.

    ``sigma`` is what the sensors' noise makes of the difference of both sides; NaN where a sensor's noise is unknown.
    """

    name: str
    value: FloatArray
    sigma: FloatArray
    weights: Weights
    findings: tuple[Finding, ...] = ()
    beside: FloatArray | float = 0.0  # What the model's side has beside these weights, whatever the effects


@dataclass(frozen=True, eq=False)
class Recorded:
    """A record's N usable samples beside a model without effects, of which balances and sensors are measured.

    Slopes weigh noise, and are those without eddy currents.
    """

    motion: Motion  # At every sample
    nominal: Nominal
    samples: Samples
    # Of force and flux linkages, with what is in series with the circuits
    slopes: MagneticState
    hall_slopes: tuple[FloatArray, FloatArray]  # Of the Hall voltage in distance, (N,), and currents, (N, n)
    noise: Mapping[str, SensorNoise]

    def weights(self, windows: Windows, rows: BoolArray) -> Weights:
        """Weights over some samples, of shape (N,)."""
        return window_weights(windows, self.samples["time_s"], self.samples["segment"], rows)

    def by_setting(
        self, weights: sparse.csr_array, in_distance: FloatArray, in_currents: FloatArray
    ) -> dict[str, sparse.csr_array]:
        """Weights of each sensor's noise in a sum that changes by slopes (N,) with the distance, (N, n) with currents.

        The distance has none at rest.
        """
        in_distance = np.where(self.samples["free"] | self.samples["touches"], in_distance, 0.0)
        columns = zip(("distance_m", *self.samples.currents), (in_distance, *in_currents.T), strict=True)
        return {name: sparse.csr_array(weights.multiply(slope)) for name, slope in columns}


def recorded(base: ActuatorModel, samples: Samples, nominal: Nominal, declared: Mapping[str, float]) -> Recorded:
    """Place usable samples beside a model, with the noise of every sensor that is not declared."""
    d, currents, new = samples["distance_m"], samples.stacked(samples.currents), np.diff(samples["run"]) != 0.0
    volts = samples.stacked(samples.commands)
    motion = Motion(base, samples["time_s"], np.append(True, new), d, currents, volts, Conditions(nominal))
    slopes, hall_slopes = base.magnetics.slopes(d, currents), (np.zeros_like(d), np.zeros_like(currents))
    if base.circuits:
        slopes = replace(slopes, inductance=slopes.inductance + base.series_inductances_H)
    if base.sensor is not None:
        _, *each = base.sensor.field.derivatives(d, currents)
        hall_slopes = base.sensor.sensitivity_V_per_T * each[0], base.sensor.sensitivity_V_per_T * each[1]
    explained = model_readings(motion, {"force_N", "hall_V"}, ()) | {"distance_m": np.zeros_like(d)}
    noise = {}
    for name, model in (explained | _driven(motion, samples, slopes)).items():
        values = samples["recorded_m"] if name == "distance_m" else samples[name]
        step = converter_step(values)
        white = max(white_noise(values - model, samples["unbroken"]), step / np.sqrt(12.0))
        noise[name] = SensorNoise(float(declared.get(name, white)), step, values)
    return Recorded(motion, nominal, samples, slopes, hall_slopes, noise)


def _driven(motion: Motion, samples: Samples, slopes: MagneticState) -> dict[str, FloatArray]:
    """The currents that commanded voltages and motion give, up to what is smooth; zeros where none is known."""
    currents, ohms = motion.currents_A, motion.base.resistances_ohm
    if not len(ohms) or all(np.isnan(samples[name]).all() for name in samples.commands):
        return {name: np.zeros(len(currents)) for name in samples.currents}
    volts = np.stack([samples[name] for name in samples.commands], axis=1)
    step, moved = (np.diff(x, prepend=x[:1])[:, None] for x in (samples["time_s"], motion.distance_m))
    linked = (np.concatenate([volts[:1], volts[:-1]]) - ohms * currents) * step + slopes.motional_constant * moved
    # The inverse of a force law's inductance, which is none, is none
    driven = np.cumsum((np.linalg.pinv(slopes.inductance) @ np.nan_to_num(linked)[..., None])[..., 0], axis=0)
    return dict(zip(samples.currents, driven.T, strict=True))


def measure_balances(record: Recorded, view: View) -> Iterator[Measured]:
    """Both sides of every balance that the model allows."""
    if record.motion.base.motion is not None:
        yield _force_balance(record, view)
    for k, name in enumerate(voltage_balances(record.motion.base)):
        yield _voltage_balance(record, name, k, view.windows)


def measure_sensors(record: Recorded, windows: Windows) -> Iterator[Measured]:
    """What every sensor of the model read.

    Where the body rests on a stop, that is the recorded distance, which should be where the stop is drawn.
    """
    nominal, samples, slopes = record.nominal, record.samples, record.slopes
    parts = {"force_N": (slopes.force_gradient, slopes.motional_constant, nominal.force_N)}
    if record.motion.base.sensor is not None:
        parts["hall_V"] = (*record.hall_slopes, nominal.hall_swing_V)
    for name, (in_distance, in_currents, scale) in parts.items():
        weights = record.weights(windows, np.isfinite(samples[name]))
        by_sensor = {name: weights.mean, **record.by_setting(weights.mean, in_distance, in_currents)}
        sigma = propagated(weights.mean, record.noise, by_sensor, (METHOD_ACCURACY * scale) ** 2)
        yield Measured(name, weights.mean @ np.nan_to_num(samples[name]), sigma, weights)
    weights = record.weights(windows, np.isfinite(samples["stop_m"]))
    least = (METHOD_ACCURACY * nominal.travel_m) ** 2
    sigma = propagated(weights.mean, record.noise, {"distance_m": weights.mean}, least)
    yield Measured(REST, weights.mean @ samples["recorded_m"], sigma, weights)


def _force_balance(record: Recorded, view: View) -> Measured:
    """Of windows whose friction is known: dry friction of a body that stands or turns is any force up to its size.

    Its size is what is drawn and what the misfit surely goes by with the direction of the motion.
    """
    body, slopes, distance = record.motion.base.require_motion(), record.slopes, record.motion.distance_m
    weights = record.weights(view.windows, record.samples["free"])
    stiffness = slopes.force_gradient - body.static_gradient(distance)
    by_sensor = record.by_setting(weights.mean, stiffness, slopes.motional_constant)
    by_sensor["distance_m"] = by_sensor["distance_m"] + body.mass_kg * weights.curvature
    sigma = propagated(weights.mean, record.noise, by_sensor, (METHOD_ACCURACY * record.nominal.force_N) ** 2)
    velocity = weights.slope @ distance
    load = weights.mean @ (body.beside_weight(distance) + np.zeros_like(distance)) + body.friction(velocity)
    measured = body.mass_kg * (body.gravity_m_s2 - weights.curvature @ distance) + load
    along = np.sign(velocity)[:, None] * np.reshape(view.motion.conditions.velocity_m_s, (len(velocity), -1))
    slides = along.min(axis=1) > DECISIVE * propagated(weights.mean, record.noise, {"distance_m": weights.slope}, 0.0)
    sliding, dry = weights.valid & slides, body.coulomb_N
    way, misfit = np.sign(velocity[sliding]), (measured - weights.mean @ record.motion.under(()).force)[sliding]
    if len(way) >= LEAST_REPEATS and abs(way.sum()) < len(way):  # it slides both ways
        fitted, spread = np.polyfit(way, misfit, 1, cov=True)
        dry += max(0.0, float(fitted[0] - DECISIVE * np.sqrt(spread[0, 0])))
    valid = weights.valid & (slides | (dry <= sigma))
    unsure = int((weights.valid & ~valid).sum())
    findings = (finding("stands", force=dry, windows=unsure, size=float(unsure)),) if unsure else ()
    return Measured(FORCE_BALANCE, measured, sigma, replace(weights, valid=valid), findings)


def _voltage_balance(record: Recorded, name: str, k: int, windows: Windows) -> Measured:
    """Of the circuit with the place k."""
    base, samples, slopes, currents = record.motion.base, record.samples, record.slopes, record.motion.currents_A
    circuit, held = base.circuits[k], held_from(samples, k)
    driven, weights = held_weights(windows, samples["time_s"], samples["segment"], held)
    by_sensor = record.by_setting(weights.slope, slopes.motional_constant[:, k], slopes.inductance[:, k])
    by_sensor[samples.currents[k]] = by_sensor[samples.currents[k]] + circuit.resistance_ohm * weights.mean
    resistive, step = circuit.resistance_ohm * currents[:, k], np.diff(samples["time_s"])
    linked = record.motion.under(()).state.flux_linkage[:, k] + circuit.inductance_H * currents[:, k]
    induced = np.divide(np.diff(linked), step, out=np.zeros_like(step), where=step > 0.0)
    taken = np.append(0.5 * (resistive[1:] + resistive[:-1]) + induced, 0.0)
    volts, variance = between_samples(samples, k, held, record.nominal.sample_time_s, taken)
    least = (METHOD_ACCURACY * record.nominal.voltage_V) ** 2
    sigma = propagated(weights.mean, record.noise, by_sensor, driven.power(2) @ variance + least)
    # Between samples currents settle towards the held commands, i'' = -L^-1 R i', by which a trapezoid over them is
    # h^2 i'' / 12 short
    usual = np.median(step) if len(step) else 0.0
    rate = np.linalg.pinv(np.median(slopes.inductance, axis=0))[k] * base.resistances_ohm
    settling = circuit.resistance_ohm * usual**2 / 12.0 * (currents @ rate)
    return Measured(name, driven @ volts, sigma, weights, beside=weights.slope @ settling)
