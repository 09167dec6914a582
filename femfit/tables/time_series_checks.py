"""What may be wrong with a recorded time series: its clock and its sensors. Found and said, never repaired."""

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.text import amount, counted
from femfit.tables.findings import finding
from femfit.tables.header import parts_of
from femfit.tables.units import CHANNELS, Channel

_SHARE = 0.1
"""Conventional: part of the steps that stand still from which the stamps are coarse; fewer are single faults."""

_PAUSE = 5.0
"""Assumed: a step of the clock longer than this many times the usual longest (95 %) one is a gap."""

_LEAST_STUCK, _MUCH_LONGER = 50, 20
"""Assumed: samples of one and the same reading, and how much longer than the channel's usual ones that must be."""

_MOST_IMPOSSIBLE = 0.02
"""Assumed: largest part of a channel that can be impossible by single faults."""

_LEAST_CLIPPED, _PILED = 20, 5
"""Assumed: samples at the end of a range, and how many times those of the next hundredth of the range that must be."""


def check_clock(rows: pd.DataFrame, source: str = "the record") -> tuple[IntArray, list[Finding]]:
    """Find where a clock jumps back, stands still or pauses, and number the segments between."""
    time, run = rows["time_s"].to_numpy(), rows["run"].to_numpy()
    step, same = np.diff(time), np.diff(run) == 0.0
    forward = step[same & (step > 0.0)]
    if not len(forward):
        raise TableError(
            f"The time_s of {source} rises nowhere within a run: {counted(len(rows), 'sample')} from {time.min():.6g} "
            f"s to {time.max():.6g} s. Repair the clock, or leave the column time_s out if these are readings at rest."
        )
    if (step[same] == 0.0).mean() > _SHARE:
        raise TableError(
            f"The clock of {source} gives several rows one stamp, {amount(float(np.median(forward)), 's')} apart. "
            "Record finer stamps, or put times at the fixed rate of the recorder into time_s."
        )
    usual = float(np.quantile(forward, 0.95))
    back, pause = same & (step <= 0.0), same & (step > _PAUSE * usual)
    findings = []
    for where, fault in ((back, "does not run on"), (pause, "pauses")):
        if where.any():
            first = int(np.flatnonzero(where)[0])
            facts = {"places": int(where.sum()), "begin": time[first], "end": time[first + 1], "run": run[first]}
            findings.append(finding("clock", size=float(where.sum()), column="time_s", fault=fault, **facts))
    breaks = np.concatenate([[False], back | pause | ~same])
    return np.cumsum(breaks), findings


def check_readings(rows: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding], set[str]]:
    """Set aside what is impossible, stuck or clipped, as NaN; and which channels are clipped somewhere."""
    rows, findings = _without_impossible(rows)
    time = rows["time_s"].to_numpy()
    clipped: set[str] = set()
    for name in (name for name in rows.columns if _channel(name).sensor):
        values = rows[name].to_numpy(copy=True)
        readable = np.isfinite(values)
        if not readable.any():
            continue
        if count := int((~readable).sum()):
            findings.append(finding("cells missing", size=count, column=name, cells=count))
        ended, (length, stretch) = _clipped(values), equal_stretches(values)
        usual = float(np.quantile(length, 0.95)) if len(length) > 1 else 0.0  # nothing moves it at all
        long = length > max(_LEAST_STUCK, _MUCH_LONGER * usual)
        stuck = long[stretch] & readable & (values != 0.0)  # a current that is off rests at zero
        if ended.any():
            clipped.add(name)
        for faulty, fault in ((stuck & ~ended, "stuck"), (ended, "clipped")):
            if faulty.any():
                levels = [f"{level:.4g}" for level in np.unique(values[faulty])]
                shown = " and ".join([*levels[:2], *(["others"] if len(levels) > 2 else [])])
                facts = {"samples": int(faulty.sum()), "levels": shown, "time": time[np.flatnonzero(faulty)[0]]}
                findings.append(finding(fault, size=float(faulty.sum()), column=name, **facts))
                values[faulty] = np.nan
        rows[name] = values
    return rows, findings, clipped


def _without_impossible(rows: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Set aside single numbers that no actuator has, such as 1e30 A; many of them are a wrong unit, and stay."""
    findings, rows, time = [], rows.copy(), rows["time_s"].to_numpy()
    for name in rows.columns:
        limit, values = _channel(name).possible, rows[name].to_numpy(copy=True)
        beyond = np.abs(values) > limit
        if not beyond.any() or beyond.mean() > _MOST_IMPOSSIBLE:
            continue
        first = int(np.flatnonzero(beyond)[0])
        facts = {"readings": int(beyond.sum()), "limit": limit, "first": values[first], "time": time[first]}
        findings.append(finding("outliers impossible", size=float(beyond.sum()), column=name, **facts))
        rows[name] = np.where(beyond, np.nan, values)
    return rows, findings


def _channel(column: str) -> Channel:
    """The row of the registry for a column, of several circuits that of the quantity; an empty one for others."""
    return CHANNELS.get(parts_of(column)[0], Channel())


def equal_stretches(values: FloatArray, run: FloatArray | None = None) -> tuple[IntArray, IntArray]:
    """Length of each stretch of one and the same reading, within a run, and the stretch of each sample."""
    changes = np.diff(values, prepend=values[:1]) != 0.0
    if run is not None:
        changes |= np.diff(run, prepend=run[:1]) != 0.0
    stretch = np.cumsum(changes)
    return np.bincount(stretch), stretch


def _clipped(values: FloatArray) -> BoolArray:
    result = np.zeros(len(values), dtype=bool)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    length, stretch = equal_stretches(values)
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
