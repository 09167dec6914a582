"""Times of a record whose clock gives several rows the same stamp, as one that counts milliseconds does."""

import numpy as np
import pandas as pd

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding

_SHARE = 0.1
"""Conventional: part of the steps that stand still from which the stamps are coarse; fewer are single faults."""

_PAUSE = 5.0
"""Assumed: a step longer than this many stamps is a gap, and what follows is spread by itself."""

_WITHIN = 1.25
"""Derived: equal steps stray from their stamps by less than one stamp's resolution; a quarter is for the line's fit."""


def spread_stamps(rows: pd.DataFrame, source: str) -> tuple[pd.DataFrame, list[Finding]]:
    """Give the rows of equal stamps times at equal steps, where equal steps lead to these stamps.

    Raises
    ------
    TableError
        If the stamps are coarse and no equal steps lead to them.
    """
    time, run = rows["time_s"].to_numpy(copy=True), rows["run"].to_numpy()
    steps, same = np.diff(time), np.diff(run) == 0.0
    forward = steps[same & (steps > 0.0)]
    if not len(forward) or (steps[same] == 0.0).mean() < _SHARE:
        return rows, []
    stamp = float(np.median(forward))
    breaks = np.flatnonzero(~same | (steps < 0.0) | (steps > _PAUSE * stamp)) + 1
    slopes, irregular = [], False
    for first, last in zip(np.r_[0, breaks], np.r_[breaks, len(time)], strict=True):
        stamps = time[first:last]
        if stamps[0] == stamps[-1]:  # too short to tell its step, and no stretch for a filter
            continue
        line = _even(stamps, stamp)
        irregular |= line is None
        if line is not None:
            time[first:last] = line
            slopes.append(line[1] - line[0])
    shared = 1.0 / (1.0 - float((steps[same] == 0.0).mean()))
    head = f"The clock of {source} gives {shared:.2g} rows on average one stamp, {amount(stamp, 's')} apart"
    if irregular or not slopes:
        raise TableError(
            f"{head}, and no equal steps lead to these stamps, so that the rows' times cannot be told: record finer "
            "stamps, or put times at the fixed rate of the recorder into time_s."
        )
    text = f"{head}; the rows were spread evenly, {amount(float(np.median(slopes)), 's')} from one to the next."
    return rows.assign(time_s=time), [Finding("coarse-clock", "warning", text, column="time_s")]


def _even(stamps: FloatArray, stamp: float) -> FloatArray | None:
    """Times at equal steps, none before its stamp; None where no equal steps give these stamps."""
    row = np.arange(len(stamps), dtype=np.float64)
    slope = float(np.polyfit(row, stamps - stamps[0], 1)[0])
    rest = stamps - slope * row
    return np.asarray(rest.max() + slope * row) if np.ptp(rest) <= _WITHIN * stamp else None
