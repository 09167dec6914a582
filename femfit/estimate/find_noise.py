"""Process and measurement noise from a record: the noises for which its innovations are most likely.

A filter that ran with noises of its own leaves e = H eps + n with eps+ = F (eps - K e) + w: its prediction's error is a
linear process with a known input, and a second Kalman filter over e gives the likelihood of any other Q and R. The
Jacobians are those along the first filter's estimate. The logarithms of the noises are found by Newton's method on
differences, and their intervals follow from the curvature.

References
----------
R. K. Mehra, On the identification of variances and adaptive Kalman filtering, IEEE Trans. Automatic Control 15 (1970)
175 (innovations of a suboptimal filter).
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4 (likelihood of the innovations).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from femfit.core.numerics import NORMAL_95, FloatArray
from femfit.estimate.constants import LEAST_JUDGED, NOISE_SAMPLES
from femfit.estimate.filter_state import FilterOutcome
from femfit.estimate.follow import OneFilter
from femfit.estimate.noise import motion_rate, operating_distance
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import HALL, reading_of, sensors_of
from femfit.model.validity import ProcessNoise

NOISE_PIECE, FORGOTTEN = 500, 100
"""Conventional: samples of a piece in the search for the noise, and those at its begin that do not count."""

FORGOTTEN_SHARE = 1.0 / 6.0
"""Conventional: of a record that is shorter than that, the part that does not count."""

UNKNOWN = 2.0
"""Conventional: a noise whose logarithm is uncertain by more than this is said to be at most its upper limit."""


@dataclass(frozen=True)
class NoiseEstimate:
    """A standard deviation or density from a record."""

    name: str  # acceleration or voltage of the process, or a sensor's name, which may be the same
    unit: str
    value: float
    assumed: float  # What the filter was given
    low: float  # 95 % interval
    high: float
    known: bool  # False where the record only says that it is no larger than ``high``
    of_sensor: bool

    @property
    def tells(self) -> bool:
        """Whether the record says more than that the noise may be larger than the filter was given."""
        return self.known or self.high < self.assumed


@dataclass(frozen=True, eq=False)
class FoundNoise:
    """All noises of a record."""

    data = "estimates", "samples"

    estimates: tuple[NoiseEstimate, ...]
    samples: int
    force_N: float | None  # Force error that the acceleration noise amounts to


def with_noise(model: ActuatorModel, noise: FoundNoise) -> ActuatorModel:
    """The model with the noises that a record showed; what the record could not tell stays."""
    estimates = [estimate for estimate in noise.estimates if estimate.known]
    process = {estimate.name: estimate.value for estimate in estimates if not estimate.of_sensor}
    sensors = {estimate.name: estimate.value for estimate in estimates if estimate.of_sensor}

    def changed(quiet: ActuatorModel) -> ActuatorModel:
        white = {  # what is left of the noise beside the converter's rounding
            name: float(np.sqrt(max(sensors[name] ** 2 - reading_of(quiet, name).rounding ** 2, 0.0)))
            for name in sensors.keys() & sensors_of(quiet)
        }
        hall = quiet.sensor and replace(quiet.sensor, noise_V=white.get(HALL, quiet.sensor.noise_V))
        quieter = tuple(replace(each, noise=white.get(each.name, each.noise)) for each in quiet.other_sensors)
        recorded = quiet.process_noise or ProcessNoise()
        if "acceleration" in process:
            recorded = replace(recorded, acceleration_density=process["acceleration"] ** 2)
        recorded = replace(recorded, voltage_V=process.get("voltage", recorded.voltage_V))
        return replace(quiet, other_sensors=quieter, sensor=hall, process_noise=recorded)

    held = changed(model)
    return held if model.base is None else replace(held, base=changed(model.base))


NEWTON_STEPS = 30
"""Conventional: it settles in about ten where the noises can be told apart."""

STEP = 0.1
"""Conventional: difference of a logarithm by which slopes and curvatures are taken."""


class Stretches(NamedTuple):
    """Pieces of a record side by side, as a filter saw them: (steps, pieces, ...)."""

    innovation: FloatArray  # Reading less prediction; (steps, pieces, sensors)
    slope: FloatArray  # F from each sample to the next; (steps, pieces, n, n)
    outputs: FloatArray  # H; (steps, pieces, sensors, n)
    shift: FloatArray  # K e; (steps, pieces, n)
    forgotten: int  # Steps at the begin of a piece that do not count


class Source(NamedTuple):
    """A noise as the filter was given it."""

    name: str  # As of a :class:`NoiseEstimate`
    unit: str
    assumed: float  # Standard deviation or density
    motion: FloatArray  # Its part of Q; (n, n)
    readings: FloatArray  # And of the sensors' variances; (sensors,)
    of_sensor: bool


def find_noise(run: OneFilter) -> FoundNoise | None:
    """Maximise the likelihood of the innovations over acceleration, voltage and the sensors' noises.

    None where the filter runs through no stretch that is long enough to judge, or nowhere near the readings.
    """
    windows, sources = _windows(run), _sources(run)
    likeliest = None if windows is None else _newton(windows, sources, run.built.process.process_covariance)
    if windows is None or likeliest is None:
        return None
    logs, curvature = likeliest
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(curvature)), 0.0))
    deviation = np.where(np.diag(curvature) < 1e-3, np.inf, deviation)
    estimates = []
    for source, log, uncertain in zip(sources, logs, deviation.tolist(), strict=True):
        value, known = float(source.assumed * np.exp(log)), uncertain < UNKNOWN
        low = value * float(np.exp(-NORMAL_95 * uncertain)) if known else 0.0
        high = value * float(np.exp(NORMAL_95 * min(uncertain, 3.0)))
        estimates.append(
            NoiseEstimate(source.name, source.unit, value, source.assumed, low, high, known, source.of_sensor)
        )
    model, (steps, pieces, _) = run.prepared.model, windows.innovation.shape
    rate = motion_rate(model, operating_distance(model))
    force = model.require_motion().mass_kg * estimates[0].value * float(np.sqrt(0.5 * rate))
    return FoundNoise(tuple(estimates), (steps - windows.forgotten) * pieces, force)


def _windows(run: OneFilter) -> Stretches | None:
    process, prepared, replayed = run.built.process, run.prepared, run.replayed
    # Innovations out of their band are what a wrong noise makes, and do not speak against a stretch
    runs = np.isin(replayed.outcome, (FilterOutcome.RUNNING, FilterOutcome.INNOVATIONS_OUT_OF_BAND))
    runs &= np.isfinite(replayed.mean).all(axis=1) & ~prepared.held
    number = np.cumsum(np.diff(runs, prepend=runs[:1]) | np.isin(np.arange(len(runs)), prepared.begins))
    stretches = [np.flatnonzero((number == k) & runs) for k in np.unique(number[runs])]
    longest = max(map(len, stretches), default=0)
    if longest < LEAST_JUDGED:
        return None
    forgotten = min(FORGOTTEN, int(FORGOTTEN_SHARE * longest))
    piece = min(NOISE_PIECE, longest - forgotten)
    healthy = [
        np.arange(start, start + piece)
        for rows in stretches
        for start in range(rows[0] + forgotten, rows[-1] - piece + 2, piece - forgotten)
    ]
    chosen = np.stack(healthy[: max(1, NOISE_SAMPLES // piece)], axis=1)
    flat, names = chosen.ravel(), prepared.names
    mean, predicted = replayed.mean[flat], replayed.predicted[flat]
    slope = process.with_slopes(mean, prepared.inputs[np.minimum(flat + 1, len(runs) - 1)])[1]
    # Of all sensors against the prediction; the filter takes one after the other, each about what the last improved
    expected = np.stack([process.measure(name, predicted) for name in names], axis=1)
    outputs = np.stack([process.gradient(name, predicted) for name in names], axis=1)
    innovation = np.where(np.isfinite(replayed.innovation[flat]), prepared.readings[flat] - expected, np.nan)
    parts = (innovation, slope, outputs, mean - predicted)
    innovation, slope, outputs, shift = (values.reshape(*chosen.shape, *values.shape[1:]) for values in parts)
    return Stretches(innovation, slope, outputs, shift, forgotten)


def _sources(run: OneFilter) -> list[Source]:
    """Acceleration, voltage and the sensors' noises as the filter was given them."""
    process, density = run.built.process, float(np.sqrt(run.noise.acceleration_density))
    electrical = np.array(["_bias_" not in name for name in process.names]) & (np.arange(process.order) < process.base)
    electrical[:2] = False
    motion, silent = np.zeros((3, process.order, process.order)), np.zeros(len(process.outputs))
    motion[0, :2, :2] = process.process_covariance[:2, :2]
    motion[1] = np.where(np.outer(electrical, electrical), process.process_covariance, 0.0)
    sources = [Source("acceleration", "m/s^1.5", density, motion[0], silent, of_sensor=False)]
    if process.inputs:
        volts = float(np.sqrt(np.mean(np.square(run.noise.voltage_V))))  # rms over several drivers
        sources.append(Source("voltage", "V", volts, motion[1], silent, of_sensor=False))
    for output, place in zip(process.outputs, np.eye(len(silent)), strict=True):
        deviation = output.variance**0.5
        sources.append(Source(output.name, output.unit, deviation, motion[2], place * output.variance, of_sensor=True))
    return sources


@np.errstate(over="ignore", invalid="ignore")
def _likelihood(windows: Stretches, sources: Sequence[Source], q: FloatArray, logs: FloatArray) -> FloatArray:
    """Minus the logarithm of the likelihood for each row of logarithms of the noises' factors; shape (rows,)."""
    factor, motion = np.exp(2.0 * logs), np.stack([source.motion for source in sources])
    q = q - motion.sum(axis=0) + np.tensordot(factor, motion, 1)
    readings = np.stack([source.readings for source in sources])
    noise, r = readings.sum(axis=0), factor @ readings
    steps, pieces, sensors = windows.innovation.shape
    error = np.zeros((len(logs), pieces, q.shape[-1]))
    covariance = np.repeat((q * steps)[:, None], pieces, axis=1)
    total = np.zeros(len(logs))
    for k in range(steps):
        for s in range(sensors):
            slope, reading = windows.outputs[k, :, s], windows.innovation[k, :, s]
            read = np.isfinite(reading)
            cross = np.einsum("bpij,pj->bpi", covariance, slope)
            variance = np.einsum("bpi,pi->bp", cross, slope) + r[:, s, None]
            residual = np.where(read, reading, 0.0) - np.einsum("bpi,pi->bp", error, slope)
            if k >= windows.forgotten:
                total += 0.5 * np.where(read, residual**2 / variance + np.log(variance / noise[s]), 0.0).sum(axis=1)
            gain = np.where(read[:, None], cross / variance[..., None], 0.0)
            error = error + gain * residual[..., None]
            covariance = covariance - gain[..., :, None] * cross[..., None, :]
        f = windows.slope[k]
        error = np.einsum("pij,bpj->bpi", f, error - windows.shift[k])
        covariance = f @ covariance @ f.swapaxes(1, 2) + q[:, None]
    return total


def _newton(windows: Stretches, sources: Sequence[Source], q: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """The most likely logarithms, and the curvature there; None where a likelihood is beyond all numbers."""
    count = len(sources)
    logs, unit = np.zeros(count), STEP * np.eye(count)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    curvature = np.zeros((count, count))
    for _ in range(NEWTON_STEPS):
        probes = np.concatenate([[logs], logs + unit, logs - unit, *([logs + unit[a] + unit[b]] for a, b in pairs)])
        values = _likelihood(windows, sources, q, probes)
        if not np.isfinite(values).all():
            return None
        here, up, down, both = np.split(values, [1, 1 + count, 1 + 2 * count])
        slope = (up - down) / (2.0 * STEP)
        curvature[range(count), range(count)] = (up - 2.0 * here + down) / STEP**2
        for (a, b), value in zip(pairs, both, strict=True):
            curvature[a, b] = curvature[b, a] = (value - up[a] - up[b] + here[0]) / STEP**2
        sizes, axes = np.linalg.eigh(curvature)
        step = -axes @ ((axes.T @ slope) / np.maximum(np.abs(sizes), 1.0))
        step *= min(1.0, 1.5 / max(float(np.abs(step).max()), 1e-12))
        tries = logs + np.array([1.0, 0.5, 0.25, 0.1, 0.0])[:, None] * step
        best = int(np.argmin(_likelihood(windows, sources, q, tries)))
        logs = np.clip(tries[best], -12.0, 12.0)
        if np.abs(step).max() < 1e-3 or best == len(tries) - 1:
            break
    return logs, curvature
