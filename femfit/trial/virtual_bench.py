"""Campaigns on a virtual bench: meters with correlated noise and 12-bit converters, re-mounts, a warming winding."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from femfit.core.arrays import FloatArray, IntArray
from femfit.core.errors import DomainError
from femfit.trial.hidden import HIDDEN_ERRORS, Conditions, Device, true_readings

LEVELS = (0.5, 1.0, 3.0)
"""Sizes of a hidden error: rms over the table in noise sigmas of the channel that shows it most."""

_BITS = 12
_TRIES, _QUIETEST = 20, 0.2
_COMPLETE = 0.6
"""Part of the campaigns that measure every channel."""

_RECORDED = {"force_N": 1.0, "flux_linkage_Wb": 0.7, "hall_V": 0.75, "voltage_V": 0.5}
"""Part of the other campaigns that measure a channel."""


@dataclass(frozen=True)
class Meter:
    """One channel's meter: noise, its correlation from reading to reading, largest magnitude that it reads."""

    sigma: float
    rho: float
    full_scale: float

    @property
    def step(self) -> float:
        """Bits of the converter."""
        return 2.0 * self.full_scale / 2.0**_BITS


@dataclass(frozen=True, eq=False)
class Campaign:
    """What was measured, and what was hidden; ``over_noise`` is the rms of each hidden error over a channel's noise."""

    rows: pd.DataFrame
    level: float
    hidden: Mapping[str, float]
    over_noise: Mapping[str, Mapping[str, float]]


def measured(values: FloatArray, meter: Meter, run: IntArray, rng: np.random.Generator) -> FloatArray:
    """Readings of a meter: first-order autoregressive noise that starts anew in each run, rounded to steps.

    True values and the number of each reading's run, shape (n,), are in the order of measuring.
    """
    fresh = rng.standard_normal(len(values))
    noise = fresh.copy()
    for k in range(1, len(values)):
        if run[k] == run[k - 1]:
            noise[k] = meter.rho * noise[k - 1] + np.sqrt(1.0 - meter.rho**2) * fresh[k]
    return np.asarray(np.round((values + meter.sigma * noise) / meter.step) * meter.step)


def make_campaign(device: Device, errors: Sequence[str], level: float, rng: np.random.Generator) -> Campaign:
    """Measure a device with hidden errors, each of the same level; noise falls where one cannot be as large."""
    for _ in range(_TRIES):
        dials, at = _settings(device, rng)
        meters = _meters(true_readings(device, at, {}), errors, rng)
        quieter = _quieter(device, at, errors, level, meters)
        if quieter >= _QUIETEST:
            meters = {name: replace(meter, sigma=quieter * meter.sigma) for name, meter in meters.items()}
            hidden = {name: _size(device, at, name, level * float(rng.choice([-1.0, 1.0])), meters) for name in errors}
            return _measure(device, (dials, at), meters, (level, hidden), rng)
    raise DomainError(
        f"{device.actuator.name} must show {' and '.join(errors)} by {level:g} noise sigmas; no campaign did."
    )


def _meters(clean: Mapping[str, FloatArray], errors: Sequence[str], rng: np.random.Generator) -> dict[str, Meter]:
    """A campaign of all or some channels, with those the errors need; noise of 0.1 to 0.6 % of a channel's span."""
    complete = rng.random() < _COMPLETE
    channels = {name for name in clean if rng.random() < _RECORDED[name] or complete}
    for error in errors:
        shown = [name for name in HIDDEN_ERRORS[error].channels if name in clean]
        channels |= set() if set(shown) & channels else {str(rng.choice(shown))}
    return {
        name: Meter(
            sigma=float(np.exp(rng.uniform(np.log(1e-3), np.log(6e-3)))) * float(np.ptp(clean[name])),
            rho=float(rng.uniform(0.0, 0.6)),
            full_scale=1.3 * float(np.abs(clean[name]).max()),
        )
        for name in clean
        if name in channels
    }


def _measure(
    device: Device,
    planned: tuple[pd.DataFrame, Conditions],
    meters: Mapping[str, Meter],
    truth: tuple[float, Mapping[str, float]],
    rng: np.random.Generator,
) -> Campaign:
    (rows, at), (level, hidden) = planned, truth
    mount_m, runs = float(rng.uniform(0.0, 50e-6)), int(rows["run"].max())
    if "distance_offset" in hidden:  # a zero error within the re-mounts is one of them, and nobody could know it
        mount_m = min(mount_m, abs(hidden["distance_offset"]) * np.sqrt(runs) / 4.0)
    shift = rng.normal(0.0, mount_m, runs)[rows["run"] - 1]
    real = true_readings(device, replace(at, distance=at.distance + shift), hidden)
    for name, meter in meters.items():
        rows[name] = measured(real[name], meter, rows["run"].to_numpy(), rng)
        rows.loc[rng.random(len(rows)) < 0.005, name] = np.nan
    kept = rows[rng.random(len(rows)) >= rng.uniform(0.0, 0.05)].reset_index(drop=True)
    over_noise = {name: _over_noise(device, at, {name: size}, meters) for name, size in hidden.items()}
    return Campaign(kept, level, hidden, over_noise)


def _settings(device: Device, rng: np.random.Generator) -> tuple[pd.DataFrame, Conditions]:
    """Two to five runs over distances and currents, and the temperatures that they lead to."""
    axes = device.actuator.sweep
    runs, step_s = int(rng.integers(2, 6)), float(rng.uniform(2.0, 12.0))
    largest = max(map(abs, axes.currents_A))
    lowest = -largest if axes.currents_A[0] < 0.0 or rng.random() < 0.5 else 0.0
    cycle = np.linspace(lowest, largest, int(rng.integers(5, 12)))
    branch = np.ones(len(cycle))
    if rng.random() < 0.5:  # falling currents too
        cycle, branch = np.concatenate([cycle, cycle[::-1]]), np.concatenate([branch, -branch])
    low, high = axes.distances_m[0], axes.distances_m[-1]
    margin, count = 0.02 * (high - low), int(rng.integers(8, 25))
    ends = low + margin, high - margin
    distance = np.round(0.5 * (np.linspace(*ends, count) + np.geomspace(*ends, count)), 6)
    each = count * len(cycle)
    run = np.repeat(np.arange(runs), each)
    time = step_s * np.tile(np.arange(each), runs).astype(np.float64)
    current = np.tile(cycle, count * runs)
    ambient = (rng.uniform(18.0, 25.0) + rng.normal(0.0, 2.0, runs))[run]
    rise = rng.uniform(10.0, 40.0) * (current / largest) ** 2
    warm = _follow(rise, step_s / rng.uniform(300.0, 900.0), each)
    magnet = ambient + rng.uniform(0.3, 0.7) * _follow(warm, step_s / rng.uniform(600.0, 2000.0), each)
    dials = pd.DataFrame(
        {
            "run": run + 1,
            "order": np.arange(len(run)) + 1,
            "current_A": np.round(current, 6),
            "distance_m": np.tile(np.repeat(distance, len(cycle)), runs),
            "branch": np.tile(branch, count * runs).astype(int),
            "coil_temperature_C": np.round(ambient + warm + rng.normal(0.0, 0.05, len(run)), 1),
            "magnet_temperature_C": np.round(magnet + rng.normal(0.0, 0.05, len(run)), 1),
        }
    )
    return dials, Conditions(dials["distance_m"].to_numpy(), current, time, ambient + warm, magnet)


def _follow(goal: FloatArray, rate: float, each: int) -> FloatArray:
    """A first-order lag, from zero in each run of ``each`` readings; rate is the step over the time constant."""
    keep = np.exp(-rate)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], goal.reshape(-1, each), axis=1).ravel())


def _quieter(device: Device, at: Conditions, errors: Sequence[str], level: float, meters: Mapping[str, Meter]) -> float:
    """The factor on all noise, 1 at most, at which each error reaches the level within its limit."""
    limits = [{name: HIDDEN_ERRORS[name].limit(device)} for name in errors]
    most = [max(_over_noise(device, at, limit, meters).values()) for limit in limits]
    return min([1.0, *(0.9 * one / level for one in most)])


def _size(device: Device, at: Conditions, name: str, level: float, meters: Mapping[str, Meter]) -> float:
    """The size at which an error stands out by a level, whose sign it has; it grows in proportion, or nearly."""
    limit = HIDDEN_ERRORS[name].limit(device)
    size = float(np.copysign(0.1 * limit, level))
    for _ in range(8):
        size *= abs(level) / max(_over_noise(device, at, {name: size}, meters).values())
        size = float(np.clip(size, -limit, limit))
    return size


def _over_noise(
    device: Device, at: Conditions, hidden: Mapping[str, float], meters: Mapping[str, Meter]
) -> dict[str, float]:
    with_it, without = true_readings(device, at, hidden), true_readings(device, at, {})
    return {
        name: float(np.sqrt(np.mean((with_it[name] - without[name]) ** 2))) / meter.sigma
        for name, meter in meters.items()
    }
