"""What a record says in each window, and what the model without any effect says, from every single sample.

The noise of each sensor's sample becomes one of the balances of short windows.

References
----------
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008), section 6 (dither).
J. W. Tukey, Exploratory Data Analysis (Addison-Wesley, 1977), section 2: the median as a measure that few large values
do not move.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import sparse

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.device.mechanics import Mechanics
from femfit.effects.conditions import Nominal
from femfit.effects.friction import REST
from femfit.estimate.constants import DECISIVE, NORMAL_MEDIAN
from femfit.estimate.record import converter_step, white_noise
from femfit.identify.constants import LEAST_REPEATS, LEAST_VARIANCE, METHOD_ACCURACY
from femfit.identify.series.balances import FORCE_BALANCE, EddiesAlong, induced_along, pull_of, voltage_balances
from femfit.identify.series.samples import Samples, between_samples, held_from
from femfit.identify.series.views import View
from femfit.identify.series.weights import Weights, Windows, held_weights, window_weights
from femfit.identify.words import finding
from femfit.model.actuator_model import ActuatorModel


def carried(weights: sparse.csr_array, factor: FloatArray | float) -> sparse.csr_array:
    """Weights of samples that are multiplied by a factor each before they are summed."""
    return sparse.csr_array(weights.multiply(factor))


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """One sensor's samples, with the standard deviation of their white noise (NaN where unknown) and their step."""

    white: float
    step: float
    values: FloatArray


def propagated(
    mean: sparse.csr_array, *sensors: tuple[sparse.csr_array, SensorNoise], further: FloatArray | float = 0.0
) -> FloatArray:
    """Standard deviation of sums of noisy samples of independent sensors, each with weights of shape (n, N).

    White noise adds up in squares. The error of a converter whose input hardly moves over a window, whose means have
    the weights ``mean``, is the same in all samples up to a few jumps; noise of the size of a step makes it white
    (dither), motion over several averages it. To these come errors of the variance ``further``, of shape (n,).
    """
    total = np.zeros(mean.shape[0]) + further
    for weights, sensor in sensors:
        total += sensor.white**2 * np.asarray(weights.power(2).sum(axis=1)).ravel()
        if sensor.step:
            values = np.nan_to_num(sensor.values)
            dither = max((sensor.white / sensor.step) ** 2 - 1.0 / 12.0, 0.0)
            spread = (mean @ values**2 - (mean @ values) ** 2) / sensor.step**2 - dither
            moved = 1.0 + 28.0 * np.maximum(spread, 0.0)  # 28: a ramp over k steps has a spread of k^2 / 28
            same = sensor.step**2 / 12.0 * np.exp(-4.0 * np.pi**2 * dither) / moved
            total += same * _largest_partial_sum(weights) ** 2
    return np.asarray(np.sqrt(total))


def _largest_partial_sum(weights: sparse.csr_array) -> FloatArray:
    """Largest magnitude that the weights of a row add up to on the way: what a jump between two samples changes."""
    result = np.zeros(weights.shape[0])
    for k, (start, stop) in enumerate(pairwise(weights.indptr)):
        if stop > start:
            order = np.argsort(weights.indices[start:stop])
            result[k] = np.abs(np.cumsum(weights.data[start:stop][order])).max()
    return result


def successive_scatter(misfit: FloatArray, follows: IntArray, removed: FloatArray) -> float:
    """Standard deviation from the median difference of successive windows; NaN for fewer than twelve.

    The windows ``follows`` follow the one before them. White noise less its part along patterns that were removed, of
    this orthonormal basis of shape (n, p), differs from one window to the next by a variance of 2 less the squared
    difference of the basis' rows.
    """
    if len(follows) < LEAST_REPEATS:
        return float("nan")
    variance = 2.0 - np.sum((removed[follows] - removed[follows - 1]) ** 2, axis=1)
    free = variance > LEAST_VARIANCE
    scaled = (misfit[follows] - misfit[follows - 1])[free] / np.sqrt(variance[free])
    return float(np.median(np.abs(scaled)) / NORMAL_MEDIAN) if len(scaled) >= LEAST_REPEATS else float("nan")


@dataclass(frozen=True, eq=False)
class SampleField:
    """Magnetics and Hall voltage at the N samples with derivatives in distance and n currents; zero where unusable.

    What is in series with the circuits counts, and so do eddy currents of the drawing, but for the derivatives, which
    weigh noise. -force_i is the flux linkages' derivative in distance.
    """

    force: FloatArray
    force_d: FloatArray
    force_i: FloatArray  # (N, n)
    flux: FloatArray  # (N, n)
    inductance: FloatArray  # (N, n, n)
    hall: FloatArray
    hall_d: FloatArray
    hall_i: FloatArray  # (N, n)


def sample_field(base: ActuatorModel, samples: Samples) -> SampleField:
    """Evaluate a model at the samples of a record."""
    here = samples.usable
    d, each = samples.columns["distance_m"][here], samples.current[here].reshape(int(here.sum()), -1)
    acting = each

    def everywhere(values: FloatArray) -> FloatArray:
        result = np.zeros((len(here), *values.shape[1:]))
        result[here] = values
        return result

    slopes = base.magnetics.slopes(d, each)
    series = base.series_inductances_H if base.circuits else np.zeros((each.shape[1],) * 2)
    flux, pull, seen_T = base.magnetics.flux_linkage(d, each), np.zeros_like(d), np.zeros_like(d)
    if base.eddy is not None:
        first = np.diff(samples.run[here], prepend=np.nan) != 0.0
        along = EddiesAlong.at(base.eddy, d)
        induced = induced_along(along, samples.time[here], first, flux, slopes.inductance)
        acting = along.acting(each, induced)
        flux = base.magnetics.flux_linkage(d, acting)
        pull, seen_T = pull_of(along, flux, induced), (along.forms.hall * induced).sum(axis=1)
    flux = flux + each @ series
    hall = [np.zeros_like(d), np.zeros_like(d), np.zeros_like(each)]
    if base.sensor is not None:
        hall = [base.sensor.sensitivity_V_per_T * derivative for derivative in base.sensor.field.derivatives(d, acting)]
        hall[0] = hall[0] + base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * seen_T
    force, inductance = base.magnetics.force(d, acting) + pull, slopes.inductance + series
    parts = force, slopes.force_gradient, slopes.motional_constant, flux, inductance, *hall
    return SampleField(*(everywhere(values) for values in parts))


def sensor_noise(
    base: ActuatorModel, samples: Samples, field: SampleField, declared: Mapping[str, float]
) -> dict[str, SensorNoise]:
    """Noise of every sensor: as declared, else from neighbouring samples beside what the model says of them.

    For the current the driving voltage says it; no noise is smaller than the converter's step over sqrt(12).
    """
    driven = dict(zip(samples.currents, _driven(base, samples, field).T, strict=True))
    explained = {"distance_m": np.zeros_like(field.force), **driven, "hall_V": field.hall, "force_N": field.force}
    result = {}
    for name, model in explained.items():
        values = samples.recorded_m if name == "distance_m" else samples.columns[name]
        step, misfit = converter_step(values), np.where(samples.usable, values - model, np.nan)
        white = max(white_noise(misfit, samples.segment), step / np.sqrt(12.0))
        result[name] = SensorNoise(float(declared.get(name, white)), step, values)
    return result


def _driven(base: ActuatorModel, samples: Samples, field: SampleField) -> FloatArray:
    """The currents (N, n) that commanded voltages and motion give, up to what is smooth; zeros where none is known."""
    result = np.zeros((len(samples.time), len(samples.currents)))
    if not base.circuits or all(np.isnan(samples.columns[name]).all() for name in samples.commands):
        return result
    volts = np.stack([samples.columns[name] for name in samples.commands], axis=1)
    here, current = samples.usable, samples.current.reshape(result.shape)
    step = np.diff(samples.time, prepend=samples.time[:1])[:, None]
    held = np.concatenate([volts[:1], volts[:-1]])
    moved = np.diff(samples.columns["distance_m"], prepend=samples.columns["distance_m"][:1])[:, None]
    linked = (held - base.resistances_ohm * current) * step + field.force_i * moved
    # The inverse of a force law's inductance, which is none, is none
    result[here] = (np.linalg.pinv(field.inductance[here]) @ np.nan_to_num(linked[here])[..., None])[..., 0]
    return np.cumsum(result, axis=0)


@dataclass(frozen=True, eq=False)
class MeasuredChannel:
    """A channel's n windows: both sides of its balance, the model's without effects, and whether samples are enough.

    ``sigma`` is what the sensors' noise makes of their difference; NaN where a sensor's noise is not known. The model's
    side is linear in a part of its :class:`SampleField`.
    """

    name: str
    measured: FloatArray
    sigma: FloatArray
    valid: BoolArray
    weights: sparse.csr_array  # Of the part, shape (n, N)
    part: Literal["force", "flux", "hall"]
    circuit: int | None = None  # Place of the circuit, of a flux linkage
    fixed: FloatArray | float = 0.0  # What depends on no field
    findings: tuple[Finding, ...] = ()

    def predict(self, field: SampleField) -> FloatArray:
        """The model's side in each window."""
        values: FloatArray = getattr(field, self.part)
        return np.asarray(self.fixed + self.weights @ (values if self.circuit is None else values[:, self.circuit]))


@dataclass(frozen=True, eq=False)
class Recorded:
    """A record beside a model without effects, of which the balances and sensors of windows are measured."""

    base: ActuatorModel
    nominal: Nominal
    samples: Samples
    field: SampleField
    noise: Mapping[str, SensorNoise]

    def weights(self, windows: Windows, rows: BoolArray) -> Weights:
        """Weights over the usable samples among some rows, of shape (N,)."""
        return window_weights(windows, self.samples.time, self.samples.segment, self.samples.usable & rows)

    def of_distance(self, weights: sparse.csr_array, slope: FloatArray) -> tuple[sparse.csr_array, SensorNoise]:
        """What the noise of the distance makes of a sum that changes by a slope (N,) with it: nothing at rest."""
        return carried(weights, np.where(self.samples.rests, 0.0, slope)), self.noise["distance_m"]

    def of_currents(self, weights: sparse.csr_array, slope: FloatArray) -> list[tuple[sparse.csr_array, SensorNoise]]:
        """What each ammeter's noise makes of a weighted sum that changes by slopes (N, n) with the currents."""
        currents = zip(self.samples.currents, slope.T, strict=True)
        return [(carried(weights, along), self.noise[name]) for name, along in currents]


def measure_balances(record: Recorded, view: View) -> Iterator[MeasuredChannel]:
    """Both sides of every balance that the model allows."""
    if record.base.motion is not None:
        yield _force_balance(record, record.base.motion, view)
    for k, name in enumerate(voltage_balances(record.base)):
        yield _voltage_balance(record, name, k, view.windows)


def measure_sensors(record: Recorded, windows: Windows) -> Iterator[MeasuredChannel]:
    """What every sensor of the model read, and what it should have read.

    Where the body rests on a stop, the recorded distance should be where that is drawn.
    """
    nominal, samples, field, noise = record.nominal, record.samples, record.field, record.noise
    parts: list[tuple[str, Literal["force", "hall"], FloatArray, FloatArray, float]]
    parts = [("force_N", "force", field.force_d, field.force_i, nominal.force_N)]
    if record.base.sensor is not None:
        parts.append(("hall_V", "hall", field.hall_d, field.hall_i, nominal.hall_swing_V))
    for name, kind, along_distance, along_current, scale in parts:
        values, least = samples.columns[name], (METHOD_ACCURACY * scale) ** 2
        weights = record.weights(windows, np.isfinite(values))
        of_distance = record.of_distance(weights.mean, along_distance)
        sensors = (weights.mean, noise[name]), of_distance, *record.of_currents(weights.mean, along_current)
        sigma, measured = propagated(weights.mean, *sensors, further=least), weights.mean @ np.nan_to_num(values)
        yield MeasuredChannel(name, measured, sigma, weights.valid, weights.mean, kind)
    weights = record.weights(windows, np.isfinite(samples.stop_m))
    measured, least = weights.mean @ np.nan_to_num(samples.recorded_m), METHOD_ACCURACY * nominal.travel_m
    sigma = propagated(weights.mean, (weights.mean, noise["distance_m"]), further=least**2)
    stop, none = weights.mean @ np.nan_to_num(samples.stop_m), sparse.csr_array(weights.mean.shape)
    yield MeasuredChannel(REST, measured, sigma, weights.valid, none, "force", fixed=stop)


def _force_balance(record: Recorded, motion: Mechanics, view: View) -> MeasuredChannel:
    """Of windows whose friction is known: dry friction of a body that stands or turns is any force up to its size.

    Its size is what is drawn and what the misfit surely goes by with the direction of the motion.
    """
    samples, field, nominal = record.samples, record.field, record.nominal
    state = record.weights(view.windows, samples.free)
    distance = np.nan_to_num(samples.columns["distance_m"])
    stiffness = field.force_d - motion.static_gradient(distance)
    of_distance = motion.mass_kg * state.curvature + carried(state.mean, stiffness), record.noise["distance_m"]
    sensors = of_distance, *record.of_currents(state.mean, field.force_i)
    sigma = propagated(state.mean, *sensors, further=(METHOD_ACCURACY * nominal.force_N) ** 2)
    velocity = state.slope @ distance
    load = state.mean @ (motion.beside_weight(distance) + np.zeros_like(distance)) + motion.friction(velocity)
    measured = motion.mass_kg * (motion.gravity_m_s2 - state.curvature @ distance) + load
    along = np.sign(velocity)[:, None] * np.reshape(view.motion.at.velocity_m_s, (len(velocity), -1))
    slides = along.min(axis=1) > DECISIVE * propagated(state.mean, (state.slope, record.noise["distance_m"]))
    sliding, dry = state.valid & slides, motion.coulomb_N
    way, misfit = np.sign(velocity[sliding]), (measured - state.mean @ field.force)[sliding]
    if len(way) >= LEAST_REPEATS and abs(way.sum()) < len(way):  # it slides both ways
        fitted, spread = np.polyfit(way, misfit, 1, cov=True)
        dry += max(0.0, float(fitted[0] - DECISIVE * np.sqrt(spread[0, 0])))
    valid = state.valid & (slides | (dry <= sigma))
    unsure = int((state.valid & ~valid).sum())
    told = (finding("stands", force=dry, windows=unsure, size=float(unsure)),) if unsure else ()
    return MeasuredChannel(FORCE_BALANCE, measured, sigma, valid, state.mean, "force", findings=told)


def _voltage_balance(record: Recorded, name: str, k: int, windows: Windows) -> MeasuredChannel:
    """Of the circuit with the place k."""
    base, nominal, samples, field = record.base, record.nominal, record.samples, record.field
    ohms, held = base.circuits[k].resistance_ohm, held_from(samples, k)
    each = samples.current.reshape(len(held), -1)
    driven, mean, slope, valid = held_weights(windows, samples.time, samples.segment, samples.usable, held)
    of_currents = record.of_currents(slope, field.inductance[:, k])
    of_currents[k] = (ohms * mean + of_currents[k][0], of_currents[k][1])
    here, taken = np.flatnonzero(samples.usable), np.zeros(len(held))
    resistive, step = ohms * each[here, k], np.diff(samples.time[here])
    induced = np.divide(np.diff(field.flux[here, k]), step, out=np.zeros_like(step), where=step > 0.0)
    taken[here[:-1]] = 0.5 * (resistive[1:] + resistive[:-1]) + induced
    volts, variance = between_samples(samples, k, held, nominal.sample_time_s, taken)
    of_distance = record.of_distance(slope, field.force_i[:, k])
    further = driven.power(2) @ variance + (METHOD_ACCURACY * nominal.voltage_V) ** 2
    sigma = propagated(mean, *of_currents, of_distance, further=further)
    # Between samples currents settle towards the held commands, i'' = -L^-1 R i', by which a trapezoid over them is
    # h^2 i'' / 12 short
    usual = np.median(step) if len(step) else 0.0
    rate = np.linalg.pinv(np.median(field.inductance[here], axis=0))[k] * base.resistances_ohm
    settling = ohms * usual**2 / 12.0 * (each @ rate)
    fixed = ohms * (mean @ each[:, k]) + slope @ settling
    return MeasuredChannel(name, driven @ volts, sigma, valid, slope, "flux", k, fixed)
