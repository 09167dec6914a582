"""Stretches of equal readings of a column: whether a living instrument could have given them, or its range ended.

White noise turns at two samples of three, whatever its distribution (I.-J. Bienayme, C. R. Acad. Sci. 81 (1875) 417),
filtered noise less often; a stretch of equal readings never does. Turns by no more than one step of the readings do not
count, so that coarse converters, set values and computed records, which repeat as long as nothing moves, have no noise
that contradicts a stretch. Turns and steps are kept by decade of |reading|: numbers of so many digits have steps that
are ten times as large in the next one.
"""

import numpy as np
import pandas as pd

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.integrate.constants import (
    BEYOND_A_STEP,
    CLIPPED_RUN,
    CLIPPED_STEPS,
    NIL_CHANCE,
    STEPS_COMPARED,
    STUCK_TIME_S,
)

_STRETCH = ("begin", "end", "samples", "reading", "low", "high")
"""Of a stretch: its first and last time in s, and between which values something else moved meanwhile."""

_LOWEST, _DECADES = -20, 30
"""The first decade, of 1e-20 and what is smaller, and the number of decades."""


class EqualReadings:
    """Stretches of equal readings of one column, which streams past block by block."""

    def __init__(self) -> None:
        self._rows: list[FloatArray] = []  # Of stretches that may matter, the last block's open one at the end
        self._carried = np.empty((0, 4))  # Rows of time, reading, path and number of samples, for the open stretch
        self._last = np.full(2, np.nan)  # Readings
        # By decade: readings, turns by more than a step, and the smallest difference of two readings in a row
        self._samples, self._turns = np.zeros(_DECADES), np.zeros(_DECADES)
        self.step = np.full(_DECADES, np.inf)
        self._levels = pd.Series(dtype=np.float64)  # How often the smallest and the largest readings came, rising
        self._least = np.inf  # |reading|

    def see(self, time: FloatArray, readings: FloatArray, path: FloatArray) -> None:
        """Take in a block.

        Parameters
        ----------
        time, readings, path : array, shape (samples,)
            In s, what may repeat, and something else that moves meanwhile, NaN where it is not known.
        """
        present = np.isfinite(readings)
        if not present.any():
            return
        self._describe(np.concatenate([self._last, readings[present]]))
        samples = np.column_stack([time, readings, path, np.ones(len(time))])[present]
        times, values, others, counts = np.concatenate([self._carried, samples]).T
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        ends = np.append(starts[1:], len(values)) - 1
        low, high = np.fmin.reduceat(others, starts), np.fmax.reduceat(others, starts)
        columns = [times[starts], times[ends], np.add.reduceat(counts, starts), values[starts], low, high]
        rows = np.column_stack(columns)
        begin, end, count, reading, least, most = rows[-1]
        self._carried = np.array([[begin, reading, least, count - 1.0], [end, reading, most, 1.0]])
        table = pd.DataFrame(rows, columns=_STRETCH)
        worth = (_lasting(table) | self._at_top(table)).to_numpy()
        self._rows = [*self._rows[:-1], rows[:-1][worth[:-1]], rows[-1:]]

    def stretches(self) -> pd.DataFrame:
        """The stretches that last longer than a living reading repeats, or stand at the largest |reading|."""
        table = pd.DataFrame(np.concatenate([*self._rows, np.empty((0, len(_STRETCH)))]), columns=_STRETCH)
        least = table["reading"].abs() == self._least
        return table.assign(lasting=_lasting(table), highest=self._at_top(table), least=least)

    def unlikely(self, stretches: pd.DataFrame) -> BoolArray:
        """Which stretches the column's own noise, as it turns outside of them, has no chance to make in the record."""
        lasting, samples = stretches["lasting"].to_numpy(), stretches["samples"].to_numpy()
        decade = _decade(stretches["reading"].to_numpy())
        living = self._samples - np.bincount(decade, samples * lasting, minlength=_DECADES)
        # A decade without other readings turns as all do.
        mean = float(self._turns.sum()) / max(1.0, float(living.sum()))
        turning = np.clip((self._turns + mean) / (np.maximum(living, 0.0) + 1.0), 0.0, 1.0)[decade]
        # Whether a sample turns hangs together with its neighbours, but hardly with the next but one.
        return np.asarray(lasting & (self._samples.sum() * (1.0 - turning) ** (0.5 * samples) < NIL_CHANCE))

    def cut_off(self, stretches: pd.DataFrame) -> BoolArray:
        """Which stretches at the largest |reading| are a limit that the signal ran into.

        A converter's steps below the largest |reading| tell how fast the signal came near it, as the inverse of how
        often they were read. Its square falls evenly, or ever less, towards a maximum or a plateau, where the signal
        comes to rest; at a limit it would have been at rest only beyond the outermost step.
        """
        at_the_end = bool(self._levels.index[-1:] == self.highest)
        outermost = self._levels.to_numpy()[:: -1 if at_the_end else 1]
        near, far = (
            outermost[1 : 1 + STEPS_COMPARED].sum(),
            outermost[1 + STEPS_COMPARED : 1 + 2 * STEPS_COMPARED].sum(),
        )
        # The line through the two squares, STEPS_COMPARED steps apart, is still above 0 at the outermost step's end.
        beyond = STEPS_COMPARED * far**2 > (0.5 * STEPS_COMPARED + 1.0) * (near**2 - far**2)
        return np.asarray(stretches["highest"].to_numpy() & (len(outermost) >= CLIPPED_STEPS) & bool(beyond))

    def _at_top(self, stretches: pd.DataFrame) -> "pd.Series[bool]":
        """Which stretches stand at the largest |reading|."""
        return (stretches["reading"].abs() == self.highest) & (stretches["samples"] >= CLIPPED_RUN)

    @property
    def highest(self) -> float:
        """The largest |reading|."""
        return float(np.abs(self._levels.index.to_numpy()).max(initial=0.0))

    def _describe(self, joined: FloatArray) -> None:
        """Count a block's turns and look for its extremes; before its readings stand the two before them."""
        self._last, readings, change = joined[-2:], joined[2:], np.diff(joined)
        size, decade = np.abs(change), _decade(joined[1:])
        moving = size[1:] > 0.0
        np.minimum.at(self.step, decade[1:][moving], size[1:][moving])
        beyond = np.minimum(size[1:], size[:-1]) > BEYOND_A_STEP * self.step[decade[:-1]]
        self._turns += np.bincount(decade[:-1][beyond & (change[1:] * change[:-1] < 0.0)], minlength=_DECADES)
        self._samples += np.bincount(decade[1:], minlength=_DECADES)
        self._least = min(self._least, float(np.abs(readings).min()))
        if len(self._levels) >= CLIPPED_STEPS:
            low, high = self._levels.index[[CLIPPED_STEPS - 1, -CLIPPED_STEPS]]
            readings = readings[(readings <= low) | (readings >= high)]
        levels, counts = np.unique(readings, return_counts=True)
        self._levels = self._levels.add(pd.Series(counts, levels, dtype=np.float64), fill_value=0.0).sort_index()
        if len(self._levels) > 2 * CLIPPED_STEPS:
            self._levels = self._levels.iloc[np.r_[:CLIPPED_STEPS, -CLIPPED_STEPS:0]]


def _decade(readings: FloatArray) -> IntArray:
    """The decade of each |reading|, counted from the lowest; NaN is in the lowest."""
    size = np.maximum(np.nan_to_num(np.abs(readings)), 10.0**_LOWEST)
    return np.minimum(np.floor(np.log10(size)).astype(np.int64) - _LOWEST, _DECADES - 1)


def _lasting(stretches: pd.DataFrame) -> "pd.Series[bool]":
    """Which stretches last longer than a living reading repeats."""
    return (stretches["end"] - stretches["begin"] >= STUCK_TIME_S) & (stretches["samples"] > CLIPPED_RUN)
