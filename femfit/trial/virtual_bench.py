"""Campaigns on a virtual bench: meters with correlated noise and 12-bit converters, re-mounts, a warming winding."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pandas as pd
from scipy.linalg import block_diag
from scipy.optimize import brentq
from scipy.signal import lfilter

from femfit.core.errors import DomainError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.trial.field_table import Conditions, Device, HiddenError, dialled_currents, true_readings

Extent = Literal["usual", "three runs", "one channel", "few readings"]
"""How much a campaign measures."""

LEVELS = (0.5, 1.0, 3.0)
"""Sizes of a hidden error: rms over the table in noise sigmas of the channel that shows it most."""

_BITS = 12
_TRIES, _QUIETEST = 20, 0.2
_SMALLEST, _SIZED = 1e-6, 1e-4
_COMPLETE = 0.6
"""Part of the campaigns that measure every channel."""

_MOUNT_M, _MOUNT = 50e-6, 2.5e-3
"""Largest standard deviation of a mount's distance, in m, and over the width of the sweep."""

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

    def covariance(self, order: IntArray) -> FloatArray:
        """Of noise and rounding in readings of a run, by their place in the order of measuring."""
        noise = self.sigma**2 * self.rho ** np.abs(order[:, None] - order)
        return np.asarray(noise + self.step**2 / 12.0 * np.eye(len(order)))


@dataclass(frozen=True, eq=False)
class Campaign:
    """What was measured, and what was hidden."""

    # What nobody may know who diagnoses it
    data = "level", "hidden", "over_noise", "shown", "meters", "mount_m", "runs"

    rows: pd.DataFrame
    level: float
    hidden: Mapping[str, float]
    over_noise: Mapping[str, Mapping[str, float]]  # Rms of each hidden error over a channel's noise
    shown: Mapping[str, float] = field(default_factory=dict)  # By how much each would lower the weighted sum of squares
    meters: Mapping[str, Meter] = field(default_factory=dict)
    mount_m: float = 0.0  # Standard deviation of the mounts' distances
    runs: int = 1


def measured(values: FloatArray, meter: Meter, run: IntArray, rng: np.random.Generator) -> FloatArray:
    """Readings of a meter: first-order autoregressive noise that starts anew in each run, rounded to steps.

    True values and the number of each reading's run, shape (n,), are in the order of measuring.
    """
    noise = rng.standard_normal(len(values))
    for k in np.flatnonzero(np.diff(run) == 0) + 1:
        noise[k] = meter.rho * noise[k - 1] + np.sqrt(1.0 - meter.rho**2) * noise[k]
    return np.asarray(np.round((values + meter.sigma * noise) / meter.step) * meter.step)


def make_campaign(
    device: Device,
    errors: Mapping[str, HiddenError],
    level: float,
    rng: np.random.Generator,
    extent: Extent = "usual",
) -> Campaign:
    """Measure a device with hidden errors, each of the same level; noise falls where one cannot be as large."""
    for _ in range(_TRIES):
        dials, conditions = _settings(device, rng, extent)
        bench = _Bench(device, conditions, errors)
        meters = _meters(bench.read({}), errors, rng, extent)
        # Each error reaches the level within its limit
        limits = [{name: error.limit(device)} for name, error in errors.items()]
        quieter = min([1.0, *(0.9 * max(bench.over_noise(limit, meters).values()) / level for limit in limits)])
        if quieter >= _QUIETEST:
            meters = {name: replace(meter, sigma=quieter * meter.sigma) for name, meter in meters.items()}
            hidden = {name: bench.size(name, level * float(rng.choice([-1.0, 1.0])), meters) for name in errors}
            return _measure(bench, dials, level, meters, hidden, rng)
    raise DomainError(
        f"{device.actuator.name} must show {' and '.join(errors)} by {level:g} noise sigmas; no campaign did."
    )


@dataclass(frozen=True, eq=False)
class _Bench:
    """A device at the settings of a campaign, with the errors that it may have."""

    device: Device
    conditions: Conditions
    errors: Mapping[str, HiddenError]

    def read(self, hidden: Mapping[str, float], shift: FloatArray | float = 0.0) -> dict[str, FloatArray]:
        """What the sensors read without noise, the body ``shift`` from its dial."""
        moved = replace(self.conditions, distance=self.conditions.distance + shift)
        return true_readings(self.device, moved, hidden, self.errors)

    def over_noise(self, hidden: Mapping[str, float], meters: Mapping[str, Meter]) -> dict[str, float]:
        """Rms of what errors change, over the noise of each channel."""
        with_it, without = self.read(hidden), self.read({})
        return {
            name: float(np.sqrt(np.mean((with_it[name] - without[name]) ** 2))) / meter.sigma
            for name, meter in meters.items()
        }

    def size(self, name: str, level: float, meters: Mapping[str, Meter]) -> float:
        """The size at which an error stands out by a level, whose sign it has; its limit where it never does."""

        def missing(logarithm: float) -> float:
            size = float(np.copysign(np.exp(logarithm), level))
            return float(np.log(max(*self.over_noise({name: size}, meters).values(), 1e-9) / abs(level)))

        most = float(np.log(self.errors[name].limit(self.device)))
        if missing(most) > 0.0:
            most = brentq(missing, most + np.log(_SMALLEST), most, rtol=_SIZED)
        return float(np.copysign(np.exp(most), level))


def _meters(
    clean: Mapping[str, FloatArray], errors: Mapping[str, HiddenError], rng: np.random.Generator, extent: Extent
) -> dict[str, Meter]:
    """A campaign of all or some channels, with those the errors need; noise of 0.1 to 0.6 % of a channel's span."""
    complete = rng.random() < _COMPLETE
    channels = {name for name in clean if rng.random() < _RECORDED[name] or complete}
    shown = [[name for name in error.channels if name in clean] for error in errors.values()]
    if extent == "one channel":
        channels = {str(rng.choice([name for names in shown for name in names] or ["force_N", "flux_linkage_Wb"]))}
    for names in shown:
        if not channels.intersection(names):
            channels.add(str(rng.choice(names)))
    return {
        name: Meter(
            sigma=float(np.exp(rng.uniform(np.log(1e-3), np.log(6e-3)))) * float(np.ptp(values)),
            rho=float(rng.uniform(0.0, 0.6)),
            full_scale=1.3 * float(np.abs(values).max()),
        )
        for name, values in clean.items()
        if name in channels
    }


def _measure(
    bench: _Bench,
    rows: pd.DataFrame,
    level: float,
    meters: Mapping[str, Meter],
    hidden: Mapping[str, float],
    rng: np.random.Generator,
) -> Campaign:
    axes, run = bench.device.actuator.sweep.distances_m, bench.conditions.run
    mount_m, runs = float(rng.uniform(0.0, min(_MOUNT_M, _MOUNT * (axes[-1] - axes[0])))), int(run.max()) + 1
    for name, size in hidden.items():
        if "distance_offset" in (bench.errors[name].names or (name,)):
            # a zero error within the re-mounts is one of them, and nobody could know it
            mount_m = min(mount_m, abs(size) * np.sqrt(runs) / 4.0)
    real = bench.read(hidden, rng.normal(0.0, mount_m, runs)[run])
    for name, meter in meters.items():
        rows[name] = measured(real[name], meter, run, rng)
        rows.loc[rng.random(len(rows)) < 0.005, name] = np.nan
    written = rng.random(len(rows)) >= rng.uniform(0.0, 0.05)
    read = {name: np.asarray(written & rows[name].notna()) for name in meters}
    step = 1e-4 * (axes[-1] - axes[0])
    ahead, back, everything = bench.read(hidden, step), bench.read(hidden, -step), bench.read(hidden)
    slope = {name: (ahead[name] - back[name]) / (2.0 * step) for name in meters}
    shown = {}
    for name in hidden:
        without = bench.read({beside: size for beside, size in hidden.items() if beside != name})
        change = {channel: everything[channel] - without[channel] for channel in meters}
        shown[name] = expected_fall(change, slope, read, meters, run, mount_m)
    over_noise = {name: bench.over_noise({name: size}, meters) for name, size in hidden.items()}
    return Campaign(rows[written].reset_index(drop=True), level, hidden, over_noise, shown, meters, mount_m, runs)


def expected_fall(
    change: Mapping[str, FloatArray],
    slope: Mapping[str, FloatArray],
    read: Mapping[str, BoolArray],
    meters: Mapping[str, Meter],
    run: IntArray,
    mount_m: float,
) -> float:
    """How plainly readings show an error: the fall of the weighted sum of squares by it, delta' C^-1 delta, on average.

    Parameters
    ----------
    change, slope, read : mapping of str to array, shape (n,)
        By channel: change by the error, slope over the distance, and whether there is a reading; in the order of
        measuring.
    meters : mapping of str to Meter
        C holds their noise, which follows itself within a run, and rounding.
    run : array, shape (n,)
        Number of each reading's run; all readings of a run share one error of its mount.
    mount_m : float
        Standard deviation of that error.
    """
    fall = 0.0
    for number in np.unique(run):
        rows = {name: np.flatnonzero((run == number) & read[name]) for name in meters}
        moved, delta = (np.concatenate([values[name][rows[name]] for name in meters]) for values in (slope, change))
        noise = block_diag(*(meter.covariance(rows[name]) for name, meter in meters.items()))
        fall += float(delta @ np.linalg.solve(noise + mount_m**2 * np.outer(moved, moved), delta))
    return fall


def _settings(device: Device, rng: np.random.Generator, extent: Extent) -> tuple[pd.DataFrame, Conditions]:
    """Two to five runs over distances and currents, and the temperatures that they lead to."""
    axes, saturates, few = device.actuator.sweep, device.actuator.saturates, extent == "few readings"
    runs, step_s = int(rng.integers(2, 6)), float(rng.uniform(2.0, 12.0))
    other_way = axes.currents_A[0] < 0.0 or (rng.random() < 0.5 and not saturates)
    runs = int(rng.integers(1, 4)) if few else 3 if extent == "three runs" else runs
    steps = int(rng.integers(5, 12) if not few else 3)
    largest = device.largest_current
    cycle = np.linspace(-largest if other_way else 0.0, largest, steps)
    if saturates:
        dialled = np.array(dialled_currents(device.actuator))
        cycle = dialled[np.unique(np.round(np.linspace(0, len(dialled) - 1, steps)).astype(int))]
    branch = np.ones(len(cycle))
    if rng.random() < 0.5:  # falling currents too
        cycle, branch = np.concatenate([cycle, cycle[::-1]]), np.concatenate([branch, -branch])
    low, high = axes.distances_m[0], axes.distances_m[-1]
    margin, count = 0.02 * (high - low), int(rng.integers(8, 25) if not few else rng.integers(2, 5))
    ends = low + margin, high - margin
    denser = np.geomspace(*ends, count) if low > 0.0 else np.linspace(*ends, count)
    distance = np.round(0.5 * (np.linspace(*ends, count) + denser), 6)
    each = count * len(cycle)
    run, number = np.repeat(np.arange(runs), each), np.arange(runs * each, dtype=np.float64)
    current = np.tile(cycle, count * runs)
    ambient = (rng.uniform(18.0, 25.0) + rng.normal(0.0, 2.0, runs))[run]
    rise = rng.uniform(10.0, 40.0) * (current / largest) ** 2
    warm = _follow(rise, step_s / rng.uniform(300.0, 900.0), each)
    magnet = ambient + rng.uniform(0.3, 0.7) * _follow(warm, step_s / rng.uniform(600.0, 2000.0), each)
    dials = pd.DataFrame(
        {
            "run": run + 1,
            "order": number.astype(int) + 1,
            "current_A": np.round(current, 6),
            "distance_m": np.tile(np.repeat(distance, len(cycle)), runs),
            "branch": np.tile(branch, count * runs).astype(int),
            "coil_temperature_C": np.round(ambient + warm + rng.normal(0.0, 0.05, len(run)), 1),
            "magnet_temperature_C": np.round(magnet + rng.normal(0.0, 0.05, len(run)), 1),
        }
    )
    time_s, campaign_s = step_s * (number % each), step_s * number
    return dials, Conditions(dials["distance_m"].to_numpy(), current, time_s, ambient + warm, magnet, run, campaign_s)


def _follow(goal: FloatArray, rate: float, each: int) -> FloatArray:
    """A first-order lag, from zero in each run of ``each`` readings; rate is the step over the time constant."""
    keep = np.exp(-rate)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], goal.reshape(-1, each), axis=1).ravel())
