"""White noise and the converter's step of a recorded channel.

References
----------
J. von Neumann, Annals of Mathematical Statistics 12 (1941) 367: variance from successive differences.
"""

from math import comb

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.records.constants import DIFFERENCE_ORDER, LEAST_DIFFERENCES, NORMAL_MEDIAN, SAME_STEP, SPIKE


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
    usual = float(np.median(np.abs(differences))) / NORMAL_MEDIAN
    if usual > 0.0:  # a coarse converter leaves most differences at zero
        differences = np.clip(differences, -SPIKE * usual, SPIKE * usual)
    return float(np.sqrt(np.mean(differences**2) / comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER)))


def converter_step(values: FloatArray) -> float:
    """The step of the converter that made these values; zero where they lie on no grid."""
    levels = np.unique(values[np.isfinite(values)])
    if not 2 < len(levels) < 0.7 * np.count_nonzero(np.isfinite(values)):
        return 0.0
    steps = np.diff(levels)
    step = float(steps.min())
    multiple = steps / step
    return step if np.all(np.abs(multiple - np.round(multiple)) < SAME_STEP * np.maximum(multiple, 1.0)) else 0.0
