"""What may be wrong with a recorded time series: its clock, its sensors, its units. Found and said, never repaired."""

import numpy as np
import pandas as pd

from femfit.core.arrays import BoolArray, FloatArray, IntArray

_PAUSE = 5.0
"""A step of the clock longer than this many times the usual longest (95 %) one is a gap."""

_SENSORS = ("current_A", "distance_m", "hall_V", "force_N")
"""Channels that noise moves: voltages may be held and temperatures rest."""

_LEAST_STUCK, _MUCH_LONGER = 50, 20
"""Samples of one and the same reading, and how much longer than the channel's usual ones that must be."""

_LEAST_CLIPPED, _PILED = 20, 5
"""Samples at the end of a range, and how many times those of the next hundredth of the range that must be."""

_LARGEST = {
    "time_s": (0.5, "step", "milliseconds"),
    "distance_m": (1.0, "median", "millimetres"),
    "current_A": (100.0, "median", "milliamperes"),
    "hall_V": (100.0, "median", "millivolts"),
    "voltage_V": (1000.0, "median", "millivolts"),
    "force_N": (1e4, "median", "millinewtons"),
    "coil_temperature_C": (250.0, "median", "kelvins"),
    "magnet_temperature_C": (250.0, "median", "kelvins"),
}
"""Above this the number is more likely in the unit named last."""


def check_clock(rows: pd.DataFrame) -> tuple[IntArray, list[str]]:
    """Find where a clock jumps back, stands still or pauses.

    Parameters
    ----------
    rows : DataFrame
        ``run`` and ``time_s``, run by run.

    Returns
    -------
    tuple of array of int, shape (n,), and list of str
        Number of the segment of each row; sentences.
    """
    time, run = rows["time_s"].to_numpy(), rows["run"].to_numpy()
    step, same = np.diff(time), np.diff(run) == 0.0
    forward = step[same & (step > 0.0)]
    usual = float(np.quantile(forward, 0.95)) if len(forward) else np.inf
    back, pause = same & (step <= 0.0), same & (step > _PAUSE * usual)
    findings = []
    for where, said in ((back, "does not run on"), (pause, "pauses")):
        if where.any():
            first = int(np.flatnonzero(where)[0])
            findings.append(
                f"The clock {said} at {int(where.sum())} place{'s' if where.sum() > 1 else ''}, first from "
                f"{time[first]:.6g} s to {time[first + 1]:.6g} s in run {run[first]:g}; no stretch across it is used."
            )
    breaks = np.concatenate([[False], back | pause | ~same])
    return np.cumsum(breaks), findings


def check_readings(rows: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Set aside readings that are stuck or clipped.

    Returns
    -------
    tuple of DataFrame and list of str
        The rows with these readings as NaN; sentences, of missing readings too.
    """
    findings, rows, time = [], rows.copy(), rows["time_s"].to_numpy()
    for name in _SENSORS:
        values = rows[name].to_numpy(copy=True)
        known = np.isfinite(values)
        if not known.any():
            continue
        if not known.all():
            findings.append(f"{int((~known).sum())} samples of {name} are missing.")
        for found, word in ((_stuck(values), "stuck at"), (_clipped(values), "clipped at")):
            if found.any():
                levels = np.unique(values[found])
                told = " and ".join(f"{level:.4g}" for level in levels[:2]) + (" and others" if len(levels) > 2 else "")
                findings.append(
                    f"{int(found.sum())} samples of {name} look {word} {told}, first at "
                    f"{time[np.flatnonzero(found)[0]]:.6g} s; they count as missing."
                )
                values[found] = np.nan
        rows[name] = values
    return rows, findings


def _lengths(values: FloatArray) -> tuple[IntArray, IntArray]:
    """Length of each stretch of one and the same reading, and the stretch of each sample."""
    stretch = np.cumsum(np.concatenate([[False], np.diff(values) != 0.0]))
    return np.bincount(stretch), stretch


def _stuck(values: FloatArray) -> BoolArray:
    length, stretch = _lengths(values)
    usual = float(np.quantile(length, 0.95))
    long = length > max(_LEAST_STUCK, _MUCH_LONGER * usual)
    if len(length) == 1:  # nothing moves it at all
        long[:] = len(values) > _LEAST_STUCK
    return np.asarray(long[stretch] & np.isfinite(values) & (values != 0.0))  # a current that is off rests at zero


def _clipped(values: FloatArray) -> BoolArray:
    result = np.zeros(len(values), dtype=bool)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    length, stretch = _lengths(values)
    for end, side in ((low, 1.0), (high, -1.0)):
        at_end = values == end
        beside = np.abs(values - (end + 0.005 * side * (high - low))) <= 0.005 * (high - low)
        next_level = np.nanmin(np.where(at_end, np.inf, np.abs(values - end)))  # of a coarse converter
        count = int(at_end.sum())
        near = max(int((beside & ~at_end).sum()), int((np.abs(values - end) == next_level).sum()))
        lasting = int(length[stretch[at_end]].max(initial=0)) >= _LEAST_CLIPPED // 2
        if high > low and end != 0.0 and lasting and count >= _LEAST_CLIPPED and count > _PILED * near:
            result |= at_end
    return result


def check_units(rows: pd.DataFrame) -> list[str]:
    """Suspect units from sizes alone."""
    findings = []
    for name, (largest, kind, unit) in _LARGEST.items():
        values = rows[name].to_numpy()
        values = np.diff(values) if kind == "step" else values
        values = np.abs(values[np.isfinite(values)])
        if len(values) and float(np.median(values)) > largest:
            findings.append(
                f"{name} has a {kind} of {np.median(values):.4g}: is it in {unit}? It was taken as it stands; put the "
                "unit into the header to have it converted."
            )
    return findings
