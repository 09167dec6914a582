"""What a recorded command was from each sample to the next one.

A controller gives its command at a sample and holds it to the next, and changes it at most samples. A command that
mostly is what it was a sample before is switched, and its edges come anywhere between two samples. In a record slower
than the driver one command of several is seen: any change comes anywhere, and the unseen scatter as the seen ones do.
"""

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.identify.series.constants import EVEN
from femfit.identify.series.samples import Samples
from femfit.records.constants import NORMAL_MEDIAN, SPIKE


def held_from(samples: Samples, k: int) -> BoolArray:
    """Whether the command of a circuit is known from each usable sample to the next one."""
    here = np.flatnonzero(samples.usable)
    result = np.zeros(len(samples.time), dtype=bool)
    if len(here) < 2:
        return result
    step = np.diff(samples.time[here])
    inside = np.diff(samples.segment[here]) == 0
    usual = np.median(step[inside]) if inside.any() else 0.0
    uneven = inside.any() and float(np.quantile(step[inside], 0.9)) > EVEN * usual
    result[here[:-1]] = inside & (uneven | (step < EVEN * usual))
    return np.asarray(result & np.isfinite(samples.columns[samples.commands[k]]))


def between_samples(samples: Samples, k: int, held: BoolArray, driver_step: float) -> tuple[FloatArray, FloatArray]:
    """Mean of a command from each sample to the next one, and its mean squared error.

    An edge by dU that is even between two samples leaves dU^2 / 3 of a command that is taken as held, as it is where
    the edge is at a sample, and dU^2 / 12 of one that runs straight.

    Parameters
    ----------
    held : array, shape (N,)
        From which samples the command is known to the next one.
    driver_step : float
        Time in s from one command of the driver to its next.
    """
    volts = samples.columns[samples.commands[k]]
    here, mean, rise, step = (
        np.flatnonzero(samples.usable),
        np.nan_to_num(volts),
        np.zeros(len(volts)),
        np.diff(samples.time),
    )
    if not held.any():
        return mean, rise
    rise[here[:-1]] = np.where(held[here[:-1]], np.nan_to_num(np.diff(volts[here])), 0.0)
    scatter = float(np.median(np.abs(rise[held]))) / NORMAL_MEDIAN
    if float(np.median(step[np.flatnonzero(held)])) > EVEN * driver_step:
        jump = np.where(np.abs(rise) > SPIKE * scatter, rise, 0.0)
        return mean + 0.5 * rise, jump**2 / 12.0 + 0.5 * scatter**2
    return mean, rise**2 / 3.0 if scatter == 0.0 else np.zeros_like(mean)
