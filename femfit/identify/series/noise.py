"""Noise of a recorded series: of each sensor's sample, and what it becomes in the balances of short windows.

References
----------
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008), section 6 (dither).
J. W. Tukey, Exploratory Data Analysis (Addison-Wesley, 1977), section 2: the median as a measure that few large values
do not move.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse

from femfit.core.arrays import FloatArray, IntArray
from femfit.identify.series.constants import (
    LEAST_FOLLOWING,
    LEAST_VARIANCE,
)
from femfit.records.constants import NORMAL_MEDIAN


def carried(weights: sparse.csr_array, factor: FloatArray | float) -> sparse.csr_array:
    """Weights of samples that are multiplied by a factor each before they are summed."""
    return sparse.csr_array(weights.multiply(factor))


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """One sensor's samples, with the standard deviation of their white noise (NaN where unknown) and their step."""

    white: float
    step: float
    values: FloatArray


def propagated(mean: sparse.csr_array, *sensors: tuple[sparse.csr_array, SensorNoise]) -> FloatArray:
    """Standard deviation of sums of noisy samples of independent sensors, each with weights of shape (n, N).

    White noise adds up in squares. The error of a converter whose input hardly moves over a window, whose means have
    the weights ``mean``, is the same in all samples up to a few jumps; noise of the size of a step makes it white
    (dither), motion over several averages it.
    """
    total = np.zeros(mean.shape[0])
    for weights, sensor in sensors:
        total += sensor.white**2 * np.asarray(weights.power(2).sum(axis=1)).ravel()
        if sensor.step:
            values = np.nan_to_num(sensor.values)
            dither = max((sensor.white / sensor.step) ** 2 - 1.0 / 12.0, 0.0)
            spread = (mean @ values**2 - (mean @ values) ** 2) / sensor.step**2 - dither
            moved = 1.0 + 28.0 * np.maximum(spread, 0.0)  # 28: a ramp over k steps has a spread of k^2 / 28
            same = sensor.step**2 / 12.0 * np.exp(-4.0 * np.pi**2 * dither) / moved
            total += same * _largest_partial_sum(weights) ** 2
    return np.asarray(np.sqrt(total))


def _largest_partial_sum(weights: sparse.csr_array) -> FloatArray:
    """Largest magnitude that the weights of a row add up to on the way: what a jump between two samples changes."""
    result = np.zeros(weights.shape[0])
    for k, (start, stop) in enumerate(pairwise(weights.indptr)):
        if stop > start:
            order = np.argsort(weights.indices[start:stop])
            result[k] = np.abs(np.cumsum(weights.data[start:stop][order])).max()
    return result


def successive_scatter(misfit: FloatArray, follows: IntArray, removed: FloatArray) -> float:
    """Standard deviation from the median difference of successive windows; NaN for fewer than twelve.

    The windows ``follows`` follow the one before them. White noise less its part along patterns that were removed, of
    this orthonormal basis of shape (n, p), differs from one window to the next by a variance of 2 less the squared
    difference of the basis' rows.
    """
    if len(follows) < LEAST_FOLLOWING:
        return float("nan")
    variance = 2.0 - np.sum((removed[follows] - removed[follows - 1]) ** 2, axis=1)
    free = variance > LEAST_VARIANCE
    scaled = (misfit[follows] - misfit[follows - 1])[free] / np.sqrt(variance[free])
    return float(np.median(np.abs(scaled)) / NORMAL_MEDIAN) if len(scaled) >= LEAST_FOLLOWING else float("nan")
