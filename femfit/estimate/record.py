"""A record on its regular grid: a sample that was not written is a row without readings.

A filter predicts over one step. Rows that a recorder lost must not be passed over: from the row before to the row after
there are several steps, and the body goes on moving in them.

Which samples of a sensor in a record tell nothing: repeats of a reading, and what stands at an end of its range.

The distance of a record that a position sensor gives in volts.

White noise and the converter's step of a recorded channel.

References
----------
J. von Neumann, Annals of Mathematical Statistics 12 (1941) 367: variance from successive differences.
"""

from dataclasses import replace
from math import comb, floor
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline

from femfit.core.errors import TableError
from femfit.core.numerics import ROUNDING, BoolArray, FloatArray, IntArray, robust_deviation
from femfit.core.results import Finding
from femfit.core.text import amount, amount_range
from femfit.device.electrics import PositionSensor
from femfit.estimate.constants import DIFFERENCE_ORDER, LEAST_DIFFERENCES, SPIKE
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensing import piece_of
from femfit.model.sensors import WHOLE, Reading, reading_of
from femfit.tables.findings import finding
from femfit.tables.header import parts_of
from femfit.tables.measurement import TimeSeries

OFF_GRID = 1.0 / 3.0
"""Conventional: part of the usual step by which a step may miss a multiple of it and still be that multiple."""

MOST_OFF_GRID = 0.05
"""Conventional: part of the steps that may miss by more; of steps of arbitrary length one third does."""

FINEST_PART = 4
"""Conventional: the median step is at most so many grid steps; a record of which more is missing is not resampled."""

NEAR_STEPS, WHOLE_STEPS, LEAST_GAPS = 10.0, 0.05, 5
"""Numerical: levels up to so many steps apart are whole steps apart, to this part of one; so many tell a step."""


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
    if not len(steps) or (np.abs(steps - np.median(steps)) <= OFF_GRID * np.median(steps)).all():
        return OnGrid(series, np.zeros(len(time), dtype=bool))
    count = np.ones(len(time), dtype=np.intp)
    count[inside], off = _multiples(steps, series.source)
    place = np.cumsum(count) - 1
    added = np.ones(int(place[-1]) + 1, dtype=bool)
    added[place] = False
    findings, missing, uneven = [*series.findings], int(added.sum()), int(off.sum())
    if missing:
        facts = {"missing": missing, "size": float(missing), "samples": f"{len(added)}"}
        findings.append(finding("missing-rows", column="time_s", **facts))
    if uneven:
        findings.append(finding("uneven-steps", uneven=uneven, size=float(uneven), column="time_s"))
    rows = series.rows.set_axis(place, axis=0).reindex(range(len(added)))
    rows = rows.assign(**{name: rows[name].ffill().astype(series.rows[name].dtype) for name in ("run", "segment")})
    for name in ("time_s", *(name for name in rows if parts_of(str(name))[0] == "voltage_V")):
        rows[name] = bridged(rows[name].to_numpy(copy=True), added)
    return OnGrid(replace(series, rows=rows, findings=tuple(findings)), added)


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


def repeated(values: FloatArray, begins: IntArray, period: int) -> BoolArray:
    """Which samples a recorder filled with the last reading.

    Parameters
    ----------
    begins : array
        First samples of stretches.
    period : int
        Samples from one reading to the next: one that happens to be the same as the last is a reading all the same.

    Examples
    --------
    >>> import numpy as np
    >>> repeated(np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]), np.array([0]), 3).astype(int)
    array([0, 1, 1, 0, 1, 1, 0, 1, 1])
    """
    if period < 2 or not len(values):
        return np.zeros(len(values), dtype=np.bool_)
    row = np.arange(len(values))
    latest = np.maximum.accumulate(np.where(np.isfinite(values), row, 0))
    last = values[latest]  # a missing row does not make a new reading of the one after it
    starts = np.r_[True, (last[1:] != last[:-1]) & np.isfinite(last[1:])]
    starts[begins] = True
    since = row - np.maximum.accumulate(np.where(starts, row, 0))
    return np.asarray((since % period != 0) & np.isfinite(values))


def sensor_readings(
    series: TimeSeries, reading: Reading, begins: IntArray, step_s: float
) -> tuple[FloatArray, list[Finding]]:
    """Readings of a sensor, NaN where they tell nothing, and what is said of those.

    That is where a slow sensor's last one was repeated, or one stands at an end of the range that the drawing shows.
    """
    column, period, findings = str(reading.column), reading.period(step_s), []
    values = series.rows[column].to_numpy(copy=True)
    if (again := repeated(values, begins, period)).any():
        facts = {"name": reading.name, "period": period, "repeats": int(again.sum())}
        findings.append(finding("repeated", column=column, **facts))
        values[again] = np.nan
    low, high = reading.inner
    clipped = (values >= high) | (values <= low)
    if clipped.any():
        limits = amount_range(reading.low, reading.high, reading.unit) if np.isfinite(high - low) else "its range"
        facts = {"clipped": int(clipped.sum()), "samples": f"{len(values)}", "name": reading.name, "limits": limits}
        findings.append(finding("clipped sensor", column=column, **facts))
        values[clipped] = np.nan
    return values, findings


def with_distance(model: ActuatorModel, series: TimeSeries) -> TimeSeries:
    """The record with ``distance_m`` where it has none and a position sensor of the model tells it; its noise too."""
    position_sensors = [
        (sensor, reading)
        for sensor in model.other_sensors
        if isinstance(sensor, PositionSensor) and (reading := reading_of(model, sensor.name)).column in series.given
    ]
    if "distance_m" in series.given or not position_sensors:
        return series
    sensor, reading = position_sensors[0]
    readings, passed = undelayed_readings(series, reading)
    distance, noise = distance_of(sensor, readings), dict(series.declared_noise)
    slope = np.abs(piece_of(sensor, distance[np.isfinite(distance)])[2])
    if (declared := series.declared_noise.get(str(reading.column))) and len(slope):
        noise["distance_m"] = declared / float(np.median(slope))
    placed = finding("distance position", source=reading.column, name=sensor.name, column="distance_m")
    return replace(
        series,
        rows=series.rows.assign(distance_m=distance),
        given=(*series.given, "distance_m"),
        declared_noise=noise,
        findings=(*series.findings, placed, *passed),
    )


def undelayed_readings(series: TimeSeries, reading: Reading) -> tuple[FloatArray, list[Finding]]:
    """Readings of a sensor when they were true, NaN where none is known: at the ends of its range, between slow ones.

    A delay that is no whole number of samples is taken back by a line between two; between slow readings there is none,
    and the nearest sample takes its place.
    """
    time, segment = series.rows["time_s"].to_numpy(), series.rows["segment"].to_numpy()
    begins, step = stretches_and_step(time, segment)
    values, passed = sensor_readings(series, reading, begins, step)
    readings, late = pd.Series(values).groupby(segment), reading.delay_s / step
    slow = reading.sample_time_s is not None and reading.sample_time_s > 1.5 * step
    if slow or abs(late - round(late)) < WHOLE:
        return np.asarray(readings.shift(-round(late))), passed
    fraction, samples = late - floor(late), floor(late)
    early, later = (np.asarray(readings.shift(-shift)) for shift in (samples, samples + 1))
    return (1.0 - fraction) * early + fraction * later, passed


def distance_of(sensor: PositionSensor, readings: FloatArray) -> FloatArray:
    """Distances in m that give these readings; beyond the characteristic its last pieces go on."""
    read, places = np.asarray(sensor.readings), np.asarray(sensor.distances_m)
    order = np.argsort(read)
    return np.asarray(make_interp_spline(read[order], places[order], 1)(readings))


def white_noise(misfit: FloatArray, segment: IntArray, least: int = LEAST_DIFFERENCES) -> float:
    """Standard deviation of white noise on a smooth misfit, from third differences; NaN for fewer than a hundred.

    Parameters
    ----------
    least : int
        Another number than a hundred.
    """
    if len(misfit) <= DIFFERENCE_ORDER:
        return float("nan")
    differences = np.diff(misfit, DIFFERENCE_ORDER)[segment[DIFFERENCE_ORDER:] == segment[:-DIFFERENCE_ORDER]]
    differences = differences[np.isfinite(differences)]
    if len(differences) < least:
        return float("nan")
    usual = float(robust_deviation(differences))
    if usual > 0.0:  # a coarse converter leaves most differences at zero
        differences = np.clip(differences, -SPIKE * usual, SPIKE * usual)
    return float(np.sqrt(np.mean(differences**2) / comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER)))


def converter_step(values: FloatArray) -> float:
    """The step of the converter that made these values; zero where they lie on no grid.

    Levels next to each other are whole steps apart. Chance makes that once in 1e5 of five levels that are more than a
    step apart, and hardly of values that repeat. Where settings were repeated, so that values do without a converter,
    give each level once.
    """
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    gaps = np.diff(levels)
    gaps = gaps[gaps > ROUNDING * np.abs(levels).max(initial=0.0)]
    step = gaps.min(initial=np.inf)
    near = gaps[gaps < NEAR_STEPS * step] / step
    stepped = np.count_nonzero(near > 1.5) >= LEAST_GAPS or (len(gaps) > 0 and 2 < len(levels) < 0.7 * counts.sum())
    return float(step) if stepped and np.all(np.abs(near - np.round(near)) < WHOLE_STEPS) else 0.0
