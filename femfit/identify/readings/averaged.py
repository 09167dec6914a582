"""A bench table of very many readings as the means of short stretches of them, with the noise of a mean.

A stretch is rows of one run in the order of measuring, on one branch, over which no setting moves far. Of what a hidden
effect changes, a mean has all but the bend within its stretch: 1/24 of the square of the stretch over the range.

The noise of a mean follows from the halves of its stretch, however readings that follow each other are correlated: once
the model's own change is taken out, their difference has four times the variance of the mean. What lasts longer than a
stretch is left to the correlation of the means.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray, IntArray
from femfit.identify.constants import (
    AVERAGED_TO,
    LEAST_REPEATS,
    MOST_DROPPED,
    MOST_ROWS,
    NORMAL_MEDIAN,
    SAME_LINE,
    SHORT,
)
from femfit.identify.readings.settings import quantisation_step
from femfit.identify.words import finding
from femfit.tables.measurement import BenchTable


def averaged(
    table: BenchTable, currents: tuple[str, ...], residuals: Callable[[BenchTable], Mapping[str, FloatArray]]
) -> BenchTable:
    """The table as means of stretches, where it has more rows than a comparison takes and stretches to be averaged.

    Parameters
    ----------
    currents : tuple of str
        Columns of the currents that were set.
    residuals : callable
        Readings of each channel that a model predicts, less what it predicts.
    """
    if len(table.rows) <= MOST_ROWS:
        return table
    number = stretches(table, currents)
    count = np.bincount(number)
    usual = float(np.median(count[number]))
    kept = count >= SHORT * usual
    dropped = float(np.mean(~kept))
    if usual < 2.0 or np.count_nonzero(kept) > MOST_ROWS or dropped > MOST_DROPPED:  # the short ones are settings
        return table
    rows = table.rows.groupby(number).mean()[kept].reset_index(drop=True)
    residual = residuals(table)
    at_means = residuals(replace(table, rows=rows))
    for name, values in residual.items():  # the model's own bend within a stretch is no misfit
        mean = pd.Series(values).groupby(number).mean()[kept].to_numpy()
        rows[name] = rows[name] - at_means[name] + mean
    noise = {name: noise_of_means(values, number, count * kept) for name, values in residual.items()}
    for name, sigma in noise.items():  # halves may round to the same
        step = quantisation_step(table.rows[name].to_numpy())
        noise[name] = max(sigma, step / np.sqrt(12.0 * usual)) if sigma > 0.0 or step > 0.0 else float("nan")
    known = {name: sigma for name, sigma in noise.items() if np.isfinite(sigma)}
    told = finding(
        "averaged",
        rows=len(table.rows),
        means=len(rows),
        readings=int(np.median(count[kept])),
        left_out=int(count[~kept].sum()),
        declared=[name for name in known if name in table.declared_noise],
    )
    return replace(
        table,
        rows=rows,
        declared_noise={**table.declared_noise, **known},
        noise_source="samples",
        findings=(*table.findings, told),
    )


def stretches(table: BenchTable, currents: tuple[str, ...]) -> IntArray:
    """Number of the stretch that each row belongs to, from 0; a row without a setting is one of its own.

    What could be longer is divided evenly. A temperature that is not read with each row is taken for the last one read.
    """
    rows, most = table.rows, -(-len(table.rows) // AVERAGED_TO)
    labels = rows[[name for name in ("run", "mount", "branch", "frequency_Hz") if name in rows]].fillna(0.0).to_numpy()
    warm = ("coil_temperature_C", "magnet_temperature_C")
    settings = [name for name in ("distance_m", *currents, *warm) if name in rows]
    known = rows[[name for name in settings if rows[name].notna().any()]]
    values = known.fillna(known.filter(items=warm).ffill().bfill()).to_numpy()
    near = SAME_LINE * np.nanmax(values, axis=0) - SAME_LINE * np.nanmin(values, axis=0)
    number, first, begun = np.zeros(len(rows), dtype=np.intp), 0, -1
    changes = np.append(True, np.any(labels[1:] != labels[:-1], axis=1))
    for k, value in enumerate(values):
        if changes[k] or not (np.abs(value - values[first]) <= near).all():
            first, begun = k, begun + 1
        number[k] = begun
    count = np.bincount(number)
    place, parts = pd.Series(number).groupby(number).cumcount().to_numpy(), -(-count // most)
    part = place * parts[number] // count[number]
    return np.cumsum(np.diff(number, prepend=0) + np.diff(part, prepend=0) != 0)


def noise_of_means(residual: FloatArray, number: IntArray, count: IntArray) -> float:
    """Standard deviation of the mean of a stretch of usual length, from the differences of halves.

    NaN for fewer than twelve stretches. Those with a ``count`` of 0 are left out.
    """
    place, size = pd.Series(number).groupby(number).cumcount().to_numpy(), np.bincount(number)[number]
    halves = [np.where(place < size // 2, 1.0, 0.0), np.where(place >= size - size // 2, 1.0, 0.0)]
    sums = [np.bincount(number, half * np.nan_to_num(residual)) for half in halves]
    there = [np.bincount(number, half * np.isfinite(residual)) for half in halves]
    shown = (there[0] > 0) & (there[1] > 0) & (count > 0)
    if np.count_nonzero(shown) < LEAST_REPEATS:
        return float("nan")
    difference = sums[1][shown] / there[1][shown] - sums[0][shown] / there[0][shown]
    length = count[shown] / np.median(np.repeat(count[shown], count[shown]))
    return 0.5 * float(np.median(np.abs(difference) * np.sqrt(length))) / NORMAL_MEDIAN
