"""What acts on a record beside the model's states: the noise of its sensors, and eddy currents of the drawing.

The noise of each sensor's sample becomes one of the balances of short windows. Of the eddy currents, at given distances
and currents the patterns' flux linkages beside a current of their own are b = C^T phi + lambda, and with A = C^T L C +
Q

    d(b + A e)/dt = -R e.

Between two times b is taken as linear and A as constant, so that a step is exact however fast a pattern decays. A
stretch begins at rest.

References
----------
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008), section 6 (dither).
J. W. Tukey, Exploratory Data Analysis (Addison-Wesley, 1977), section 2: the median as a measure that few large values
do not move.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from scipy import sparse
from scipy.linalg import lapack

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.estimate.constants import NORMAL_MEDIAN
from femfit.identify.series.constants import LEAST_FOLLOWING, LEAST_VARIANCE, SLOWEST
from femfit.model.eddy_currents import EddyCurrents, EddyForms


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


@dataclass(frozen=True, eq=False)
class EddiesAlong:
    """The patterns' forms at N distances and their derivatives.

    Currents (N, n) without a circuit are a column of zeros, which no pattern acts like.
    """

    eddy: EddyCurrents
    distance: FloatArray
    forms: EddyForms
    rising: EddyForms

    @classmethod
    def at(cls, eddy: EddyCurrents, distance: FloatArray) -> Self:
        """At distances (N,) in m."""
        forms, rising = eddy.forms(distance, 0, 1)
        return cls(eddy, distance, forms, rising)

    def acting(self, current: FloatArray, induced: FloatArray) -> FloatArray:
        """Currents (N, n) that act on the static field like these and induced ones (N, r) together."""
        result = current.copy()
        result[:, : len(self.eddy.circuits)] += (self.forms.coupling @ induced[..., None])[..., 0]
        return result


def induced_along(
    along: EddiesAlong, time: FloatArray, first: BoolArray, flux_linkage: FloatArray, inductance: FloatArray
) -> FloatArray:
    """Currents (N, r) of the patterns at N times, where stretches begin ``first``.

    Parameters
    ----------
    flux_linkage, inductance : array, shapes (N, n) and (N, n, n)
        Of the circuits, without eddy currents.
    """
    forms, root, n = along.forms, 1.0 / np.sqrt(along.eddy.resistances_ohm), len(along.eddy.circuits)
    turned = np.swapaxes(forms.coupling, -1, -2)
    beside = root * ((turned @ flux_linkage[:, :n, None])[..., 0] + forms.flux_linkage)
    matrix = root[:, None] * (turned @ inductance[:, :n, :n] @ forms.coupling + forms.inductance) * root
    factors, gained = _steps(np.diff(time), 0.5 * (matrix[1:] + matrix[:-1]), -np.diff(beside, axis=0))
    factors[first[1:]], gained[first[1:]] = 0.0, 0.0
    linked = recurrence(factors, gained)
    return np.asarray(root * np.linalg.solve(matrix, linked[..., None])[..., 0])


def pull_of(along: EddiesAlong, flux_linkage: FloatArray, induced: FloatArray) -> FloatArray:
    """What induced currents (N, r) add to the force beside the static one, at the currents that act together."""
    rising, n = along.rising, len(along.eddy.circuits)
    acting = (rising.coupling @ induced[..., None])[..., 0]
    linkage = rising.flux_linkage + 0.5 * (rising.inductance @ induced[..., None])[..., 0]
    return -np.asarray((flux_linkage[:, :n] * acting).sum(axis=-1) + (linkage * induced).sum(axis=-1))


def recurrence(factors: FloatArray, gained: FloatArray) -> FloatArray:
    """x_k = K_k x_(k-1) + g_k from x_0 = 0: a triangular system of bandwidth 2 r, which LAPACK solves in one pass."""
    steps, r = gained.shape
    below = np.zeros((2 * r, steps + 1, r))  # Entry (d, j) stands d rows below the diagonal in column j
    row, column = np.indices((r, r)).reshape(2, -1)
    below[r + row - column, :-1, column] = -factors[:, row, column].T
    right = np.concatenate([np.zeros(r), gained.ravel()])
    solution, _ = lapack.dtbtrs(below.reshape(2 * r, -1), right[:, None], uplo="L", diag="U")
    return np.asarray(solution).reshape(steps + 1, r)


def _steps(step: FloatArray, matrix: FloatArray, gained: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is left of A e after each step in s, and of a flux linkage that grows evenly within it."""
    delay, modes = np.linalg.eigh(matrix)
    decay = np.maximum(np.maximum(step, 0.0)[:, None] / delay, SLOWEST)
    turned = np.swapaxes(modes, -1, -2)
    mean = -np.expm1(-decay) / decay
    factors = (modes * np.exp(-decay)[:, None]) @ turned
    return factors, (modes @ (mean[..., None] * (turned @ gained[..., None])))[..., 0]
