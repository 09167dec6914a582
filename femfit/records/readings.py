"""Which samples of a sensor in a record tell nothing: repeats of a reading, and what stands at an end of its range."""

import numpy as np
from numpy.typing import NDArray

from femfit.core.amount import counted
from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.finding import Finding
from femfit.model.sensors import Reading


def repeated(values: FloatArray, begins: NDArray[np.intp], period: int) -> BoolArray:
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


def without_repeats(
    values: FloatArray, begins: NDArray[np.intp], reading: Reading, step_s: float
) -> tuple[FloatArray, list[Finding]]:
    """Readings with NaN where a slow sensor's last one was repeated, and what is said of it."""
    period = reading.period(step_s)
    again = repeated(values, begins, period)
    if not again.any():
        return values, []
    text = (
        f"Sensor {reading.name} is read once in {period} samples of the record; {counted(int(again.sum()), 'sample')} "
        "that repeat a reading are passed over."
    )
    return np.where(again, np.nan, values), [Finding("repeated", "info", text, column=str(reading.column))]


def at_ends(values: FloatArray, reading: Reading) -> tuple[BoolArray, BoolArray]:
    """Which samples stand at an end of the sensor's range, and which of all at the upper one."""
    span = reading.high - reading.low
    slack = 1e-9 * span if np.isfinite(span) else 0.0
    above = values >= reading.high - slack
    return above | (values <= reading.low + slack), above
