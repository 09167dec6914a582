"""A record on its regular grid: a sample that was not written is a row without readings.

A filter predicts over one step. Rows that a recorder lost must not be passed over: from the row before to the row after
there are several steps, and the body goes on moving in them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from femfit.core.amount import amount, counted
from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.records.constants import FINEST_PART, MOST_OFF_GRID, OFF_GRID
from femfit.tables.circuit_columns import parts_of
from femfit.tables.measurement import TimeSeries


class OnGrid(NamedTuple):
    """A record without gaps within its segments, and which of its rows were added."""

    series: TimeSeries
    added: BoolArray


def on_grid(series: TimeSeries) -> OnGrid:
    """Add the rows that are missing between samples; their commands are interpolated, their readings are NaN.

    Raises
    ------
    TableError
        If the steps are no near multiples of one.
    """
    time, segment = series.rows["time_s"].to_numpy(), series.rows["segment"].to_numpy()
    inside = np.flatnonzero(np.diff(segment) == 0) + 1
    steps = time[inside] - time[inside - 1]
    count = np.ones(len(time), dtype=np.intp)
    findings = []
    if len(steps) and (np.abs(steps - np.median(steps)) > OFF_GRID * np.median(steps)).any():
        count[inside], off = _multiples(steps, series.source)
        findings = _said(count, off, len(time))
    place = np.cumsum(count) - 1
    added = np.ones(int(place[-1]) + 1, dtype=bool)
    added[place] = False
    if not added.any():
        return OnGrid(replace(series, findings=(*series.findings, *findings)), added)
    rows = series.rows.set_axis(place, axis=0).reindex(range(len(added)))
    rows = rows.assign(**{name: rows[name].ffill() for name in ("run", "segment")})
    rows["segment"] = rows["segment"].astype(np.intp)
    for name in ("time_s", *(name for name in rows if parts_of(str(name))[0] == "voltage_V")):
        rows[name] = bridged(rows[name].to_numpy(copy=True), added)
    clipped = {name: np.full(len(added), np.nan) for name in series.clipped}
    for name, values in clipped.items():
        values[place] = series.clipped[name]
    return OnGrid(replace(series, rows=rows, clipped=clipped, findings=(*series.findings, *findings)), added)


def stretches_and_step(time: FloatArray, segment: IntArray, usual_step_s: float = 1.0) -> tuple[IntArray, float]:
    """First samples of the stretches without a gap, and the median step in s within them.

    Parameters
    ----------
    usual_step_s : float
        The step where no stretch has two samples.
    """
    begins = np.flatnonzero(np.r_[True, np.diff(segment) != 0])
    steps = np.delete(np.diff(time), begins[1:] - 1)
    return begins, float(np.median(steps)) if len(steps) else usual_step_s


def bridged(values: FloatArray, added: BoolArray) -> FloatArray:
    """Values of shape (rows, ...) with those of the added rows interpolated; NaN beside a missing reading.

    Examples
    --------
    >>> import numpy as np
    >>> bridged(np.array([1.0, np.nan, 3.0, np.nan]), np.array([False, True, False, False]))
    array([ 1.,  2.,  3., nan])
    """
    here, written = np.flatnonzero(added), np.flatnonzero(~added)
    result = values.copy()
    for column in result.reshape(len(values), -1).T:
        column[here] = np.interp(here, written, column[written])
    return result


def _multiples(steps: FloatArray, source: str) -> tuple[IntArray, BoolArray]:
    """How many grid steps lie in each step, and which steps are no near multiple of it."""
    median = float(np.median(steps))
    shares = []
    for parts in range(1, FINEST_PART + 1):
        count = np.maximum(np.round(steps * parts / median), 1.0)
        base = float(steps.sum() / count.sum())
        count = np.maximum(np.round(steps / base), 1.0)
        off = np.abs(steps / base - count) > OFF_GRID
        if off.mean() <= MOST_OFF_GRID:
            return count.astype(np.intp), off
        shares.append(float(off.mean()))
    raise TableError(
        f"A filter needs samples at equal steps, where single ones may be missing; the steps of {source} are "
        f"{amount(median, 's')} in the median, {amount(float(steps.min()), 's')} to {amount(float(steps.max()), 's')}, "
        f"and {100.0 * shares[0]:.3g} % of them are no near multiple of that. Record at a fixed rate, or resample."
    )


def _said(count: IntArray, off: BoolArray, samples: int) -> list[Finding]:
    missing, findings = int((count - 1).sum()), []
    if missing:
        text = (
            f"{counted(missing, 'row')} of {samples + missing} are missing between samples. The filter predicts over "
            "them, with the command interpolated."
        )
        findings.append(Finding("missing-rows", "warning", text, size=float(missing), column="time_s"))
    if off.any():
        text = (
            f"{counted(int(off.sum()), 'step')} of the clock differ from a multiple of the usual one by more than a "
            "third of it; the nearest multiple was taken."
        )
        findings.append(Finding("uneven-steps", "warning", text, size=float(off.sum()), column="time_s"))
    return findings
