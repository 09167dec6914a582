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

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.estimate.consistency import dry_friction
from femfit.estimate.constants import (
    COVARIANCE_BLOCK,
    COVARIANCE_LAGS,
    FORGOTTEN,
    FORGOTTEN_SHARE,
    LEAST_JUDGED,
    NOISE_PIECE,
    NOISE_SAMPLES,
    UNKNOWN,
)
from femfit.estimate.constants import (
    LEAST_BLOCKS_OF_RECORD as LEAST_BLOCKS,
)
from femfit.estimate.filter import Filter
from femfit.estimate.found_noise import FoundNoise, NoiseEstimate, Stretches, variance_factors
from femfit.estimate.noise import motion_rate, operating_distance
from femfit.estimate.prepare import Prepared
from femfit.estimate.process import FilterOutcome, FilterProcess
from femfit.estimate.run_filter import Replayed
from femfit.model.dynamics import currents_by_voltages

NEWTON_STEPS = 30
"""Conventional: it settles in about ten where the noises can be told apart."""

STEP = 0.1
"""Conventional: difference of a logarithm by which slopes and curvatures are taken."""


def find_noise(filter_: Filter, prepared: Prepared, replayed: Replayed) -> FoundNoise | None:
    """Maximise the likelihood of the innovations over acceleration, voltage and the sensors' noises.

    None where the filter runs through no stretch that is long enough to judge.
    """
    process = filter_.process
    windows = _windows(process, prepared, replayed)
    if windows is None:
        return None
    parts = _parts(process)
    names = ["acceleration", "voltage", *(output.name for output in process.outputs)]
    units = ["m/s^1.5", "V", *(output.unit for output in process.outputs)]
    first = _assumed(process, prepared)
    logs, curvature = _newton(process, windows, parts, len(names))
    spread = np.linalg.pinv(curvature)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0)) + np.where(np.diag(curvature) < 1e-3, np.inf, 0.0)
    estimates = []
    for k, name in enumerate(names):
        if name == "voltage" and not prepared.model.circuits:
            continue
        value = first[k] * np.exp(logs[k])
        is_known = bool(deviation[k] < UNKNOWN)
        high = value * np.exp(1.96 * min(float(deviation[k]), 3.0))
        low = value * np.exp(-1.96 * float(deviation[k])) if is_known else 0.0
        estimates.append(
            NoiseEstimate(name, units[k], float(value), float(first[k]), float(low), float(high), is_known)
        )
    model, motion = prepared.model, prepared.model.require_motion()
    rate = motion_rate(model, operating_distance(model))
    force = motion.mass_kg * estimates[0].value * float(np.sqrt(0.5 * rate))
    used = (windows.innovation.shape[0] - windows.forgotten) * windows.innovation.shape[1]
    beside = _by_autocovariance(process, windows, parts, list(zip(names, units, first, strict=True)))
    shares = _shares(process, windows, parts, logs, names)
    friction = dry_friction(prepared, replayed)
    return FoundNoise(tuple(estimates), used, force, shares, beside, friction)


def _by_autocovariance(
    process: FilterProcess, windows: Stretches, parts: list[FloatArray], noises: list[tuple[str, str, float]]
) -> tuple[NoiseEstimate, ...]:
    """The noises of the same pieces once more; none where these are too few for their scatter."""
    steps, pieces, _ = windows.innovation.shape
    if (steps - windows.forgotten - COVARIANCE_LAGS) * pieces < LEAST_BLOCKS * COVARIANCE_BLOCK:
        return ()
    readings = np.array([output.variance for output in process.outputs])
    factors = variance_factors(windows, parts[:2], parts[2], readings)
    if factors is None:
        return ()
    estimates = []
    for (name, unit, assumed), value, deviation in zip(noises, factors.value, factors.deviation, strict=True):
        if not assumed:
            continue
        low, high = value - 1.96 * deviation, value + 1.96 * deviation
        sizes = assumed * np.sqrt([value, max(low, 0.0), high])
        estimates.append(
            NoiseEstimate(name, unit, float(sizes[0]), assumed, float(sizes[1]), float(sizes[2]), bool(low > 0))
        )
    return tuple(estimates)


def _windows(process: FilterProcess, prepared: Prepared, replayed: Replayed) -> Stretches | None:
    # Innovations out of their band are what a wrong noise makes, and do not speak against a stretch
    runs = np.isin(replayed.outcome, (FilterOutcome.RUNNING, FilterOutcome.INNOVATIONS_OUT_OF_BAND))
    runs &= np.isfinite(replayed.mean).all(axis=1) & ~prepared.log.held
    number = np.cumsum(np.diff(runs, prepend=runs[:1]) | np.isin(np.arange(len(runs)), prepared.log.begins))
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
    flat = chosen.ravel()
    order = process.order
    following = np.minimum(flat + 1, len(prepared.time_s) - 1)
    slope = process.state_jacobian(replayed.mean[flat], prepared.log.inputs[following])
    outputs = np.stack(
        [process.output_jacobian(replayed.predicted[flat], output) for output in process.outputs], axis=1
    )
    shift = replayed.mean[flat] - replayed.predicted[flat]
    # Of all sensors against the prediction; the filter takes one after the other, each about what the last improved
    expected = np.stack([output.measure(replayed.predicted[flat]) for output in process.outputs], axis=1)
    innovation = np.where(np.isfinite(replayed.innovation[flat]), prepared.log.readings[flat] - expected, np.nan)
    size = chosen.shape
    return Stretches(
        innovation.reshape(*size, -1),
        slope.reshape(*size, order, order),
        outputs.reshape(*size, -1, order),
        shift.reshape(*size, order),
        forgotten,
    )


def _parts(process: FilterProcess) -> list[FloatArray]:
    """Q of the acceleration, of the voltage, and of what is not searched for."""
    covariance = process.process_covariance
    acceleration, voltage = np.zeros_like(covariance), np.zeros_like(covariance)
    acceleration[:2, :2] = covariance[:2, :2]
    biases = {k for k, name in enumerate(process.names) if "_bias_" in name}
    electrical = [k for k in range(2, process.base) if k not in biases]
    voltage[np.ix_(electrical, electrical)] = covariance[np.ix_(electrical, electrical)]
    return [acceleration, voltage, covariance - acceleration - voltage]


def _assumed(process: FilterProcess, prepared: Prepared) -> FloatArray:
    """Noises as the filter was given them: sqrt of the acceleration's density, the voltage, the sensors."""
    t, covariance, model = process.step_s, process.process_covariance, prepared.model
    circuits = len(model.circuits)
    middle = np.zeros(model.windings.count)
    middle[:circuits] = model.validity.current_limits_A.mean(axis=1)[:circuits]
    distance, end = np.asarray(operating_distance(model)), 2 + circuits
    if model.eddy is None:
        by_current = (model.magnetics.inductance(distance, middle) + model.series_inductances_H) / t
    else:
        by_current = np.asarray(np.linalg.inv(currents_by_voltages(model, distance, middle, t)[:circuits, :circuits]))
    squares = np.diag(by_current @ covariance[2:end, 2:end] @ by_current.T)
    volts = float(np.sqrt(squares.mean())) if circuits else 0.0  # rms over several drivers
    return np.array([np.sqrt(covariance[1, 1] / t), volts, *(output.variance**0.5 for output in process.outputs)])


def _likelihood(process: FilterProcess, windows: Stretches, parts: list[FloatArray], logs: FloatArray) -> FloatArray:
    """Minus the logarithm of the likelihood for each row of logarithms of the noises' factors; shape (rows,)."""
    factor = np.exp(2.0 * logs)
    q = factor[:, 0, None, None] * parts[0] + factor[:, 1, None, None] * parts[1] + parts[2]
    steps, pieces, sensors = windows.innovation.shape
    order = process.order
    error = np.zeros((len(logs), pieces, order))
    first = q * steps
    covariance = np.broadcast_to(first[:, None], (len(logs), pieces, order, order)).copy()
    total = np.zeros(len(logs))
    noise = np.array([output.variance for output in process.outputs])
    for k in range(steps):
        for s in range(sensors):
            slope, reading = windows.outputs[k, :, s], windows.innovation[k, :, s]
            read = np.isfinite(reading)
            cross = np.einsum("bpij,pj->bpi", covariance, slope)
            variance = np.einsum("bpi,pi->bp", cross, slope) + factor[:, 2 + s, None] * noise[s]
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


def _newton(
    process: FilterProcess, windows: Stretches, parts: list[FloatArray], count: int
) -> tuple[FloatArray, FloatArray]:
    """The most likely logarithms, and the curvature there."""
    logs, unit = np.zeros(count), STEP * np.eye(count)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    curvature = np.zeros((count, count))
    for _ in range(NEWTON_STEPS):
        probes = np.concatenate([[logs], logs + unit, logs - unit, *([logs + unit[a] + unit[b]] for a, b in pairs)])
        values = _likelihood(process, windows, parts, probes)
        here, up, down, both = np.split(values, [1, 1 + count, 1 + 2 * count])
        slope = (up - down) / (2.0 * STEP)
        curvature[range(count), range(count)] = (up - 2.0 * here + down) / STEP**2
        for (a, b), value in zip(pairs, both, strict=True):
            curvature[a, b] = curvature[b, a] = (value - up[a] - up[b] + here[0]) / STEP**2
        sizes, axes = np.linalg.eigh(curvature)
        step = -axes @ ((axes.T @ slope) / np.maximum(np.abs(sizes), 1.0))
        step *= min(1.0, 1.5 / max(float(np.abs(step).max()), 1e-12))
        tries = logs + np.array([1.0, 0.5, 0.25, 0.1, 0.0])[:, None] * step
        best = int(np.argmin(_likelihood(process, windows, parts, tries)))
        logs = np.clip(tries[best], -12.0, 12.0)
        if np.abs(step).max() < 1e-3 or best == len(tries) - 1:
            break
    return logs, curvature


def _shares(
    process: FilterProcess, windows: Stretches, parts: list[FloatArray], logs: FloatArray, names: list[str]
) -> dict[str, dict[str, float]]:
    """What the innovations come from in the steady state: each noise alone through the filter found."""
    factor = np.exp(2.0 * logs)
    slope, outputs = np.median(windows.slope, axis=(0, 1)), np.median(windows.outputs, axis=(0, 1))
    q = factor[0] * parts[0] + factor[1] * parts[1] + parts[2]
    r = factor[2:] * [output.variance for output in process.outputs]
    covariance = process.require_start_covariance()
    causes = [factor[0] * parts[0], factor[1] * parts[1], *(np.zeros_like(q) for _ in r), parts[2]]
    by_cause = [np.zeros_like(q) for _ in causes]
    for _ in range(2 * NOISE_PIECE):
        innovation = outputs @ covariance @ outputs.T + np.diag(r)
        gain = np.linalg.solve(innovation, outputs @ covariance).T
        closed = slope - slope @ gain @ outputs
        covariance = closed @ covariance @ slope.T + q
        covariance = 0.5 * (covariance + covariance.T)
        by_cause = [
            closed @ variance_of_cause @ closed.T + cause
            for variance_of_cause, cause in zip(by_cause, causes, strict=True)
        ]
        for s, variance in enumerate(r):
            column = slope @ gain[:, s]
            by_cause[2 + s] = by_cause[2 + s] + variance * np.outer(column, column)
    words = ["unknown force", "unknown voltage", *(f"noise of {name}" for name in names[2:]), "drift of the bias"]
    shares_of = {}
    for k, name in enumerate(names[2:]):
        shares = [float(outputs[k] @ variance_of_cause @ outputs[k]) for variance_of_cause in by_cause]
        shares[2 + k] += float(r[k])
        shares_of[name] = {word: share / sum(shares) for word, share in zip(words, shares, strict=True)}
    return shares_of
