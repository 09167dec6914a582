"""First-order recursions over millions of samples, by numpy alone.

x_k = a_k x_(k-1) + b_k and the scalar Riccati recursion P_k = (P_(k-1) + w_k) / (1 + j_k (P_(k-1) + w_k)) are chains of
maps (affine, Moebius) whose composition is associative. A block is folded into chunks of consecutive samples; all
chunks step together and compose their maps, the few chunk starts follow in order, and a second pass fills in the
values. Exact up to rounding, whatever the block length.

References
----------
G. E. Blelloch, Prefix sums and their applications, CMU-CS-90-190 (1990), section 1.4 (recurrences).
S. Särkkä and A. F. Garcia-Fernandez, Temporal parallelization of Bayesian smoothers, IEEE Trans. Automat. Contr. 66
(2021) 299 (the Kalman filter as an associative scan).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import FloatArray

CHUNK_LENGTH = 128
"""Samples of a chunk; blocks of half a million give chunks enough to hide the cost of a numpy call."""

# A chunk's Moebius map grows by (1 + j w) a sample; rescaled this often it cannot overflow for j w < 1e18.
_RESCALE_EVERY = 8


@dataclass(frozen=True)
class Folding:
    """How a block of samples is folded."""

    samples: int

    @property
    def length(self) -> int:
        """Samples of a chunk."""
        return min(self.samples, CHUNK_LENGTH)

    @property
    def count(self) -> int:
        """Number of chunks."""
        return -(-self.samples // self.length)

    def fold(self, values: FloatArray, fill: float) -> FloatArray:
        """Samples (n,) as (length, count), a chunk a column; the last chunk is filled up with a neutral value."""
        whole = np.full(self.length * self.count, fill)
        whole[: self.samples] = values
        return np.ascontiguousarray(whole.reshape(self.count, self.length).T)

    def unfold(self, folded: FloatArray) -> FloatArray:
        """Back to samples (n,)."""
        return np.ascontiguousarray(folded.T).ravel()[: self.samples]


def affine_recursion(a: FloatArray, b: Sequence[FloatArray], starts: Sequence[float]) -> tuple[FloatArray, ...]:
    """Run x_k = a_k x_(k-1) + b_k for several right sides that share a.

    Parameters
    ----------
    a : array, shape (length, count)
        Folded; neutral fill 1.
    b : sequence of arrays, shape (length, count)
        Folded; neutral fill 0.
    starts : sequence of float
        x before the first sample, one for each right side.

    Returns
    -------
    tuple of arrays, shape (length, count)
        x, one for each right side.
    """
    product = np.empty_like(a)
    product[0] = a[0]
    for row in range(1, len(a)):
        np.multiply(product[row - 1], a[row], out=product[row])
    ends = product[-1].tolist()
    carry, scratch, results = np.empty(a.shape[1]), np.empty_like(a), []
    for right, start in zip(b, starts, strict=True):
        x = right.copy()
        for row in range(1, len(a)):
            np.multiply(a[row], x[row - 1], out=carry)
            x[row] += carry
        value = start
        for chunk, (end, own) in enumerate(zip(ends, x[-1].tolist(), strict=True)):
            carry[chunk] = value
            value = end * value + own
        x += np.multiply(product, carry, out=scratch)
        results.append(x)
    return tuple(results)


def riccati_recursion(w: FloatArray, j: FloatArray, start: float) -> tuple[FloatArray, FloatArray]:
    """Variance of a scalar Kalman filter with F = D = 1: (12), then the update with the information j.

    Parameters
    ----------
    w : array, shape (length, count)
        Variances of the prediction's increments, folded; neutral fill 0.
    j : array, shape (length, count)
        Information 1 / sigma_q^2 of each measurement, 0 where there is none; neutral fill 0.

    Returns
    -------
    posterior, share : arrays, shape (length, count)
        P_k^+, and 1 - K_k, the prediction's share in the estimate.
    """
    value = start
    variance = np.empty(w.shape[1])
    for chunk, (a, b, c, d) in enumerate(zip(*_moebius_products(w, j), strict=True)):
        variance[chunk] = value
        value = (a * value + b) / (c * value + d)
    posterior, share = np.empty_like(w), np.empty_like(w)
    for row in range(len(w)):
        variance += w[row]
        np.multiply(variance, j[row], out=share[row])
        share[row] += 1.0
        np.divide(1.0, share[row], out=share[row])
        variance *= share[row]
        posterior[row] = variance
    return posterior, share


def _moebius_products(w: FloatArray, j: FloatArray) -> tuple[list[float], ...]:
    """Matrices [[a, b], [c, d]] of each chunk's map P -> (a P + b) / (c P + d), up to a common factor."""
    count = w.shape[1]
    upper, lower = np.array([np.ones(count), np.zeros(count)]), np.array([np.zeros(count), np.ones(count)])
    step = np.empty_like(upper)
    for row in range(len(w)):
        np.multiply(w[row], lower, out=step)
        upper += step
        np.multiply(j[row], upper, out=step)
        lower += step
        if row % _RESCALE_EVERY == 0:
            # d >= 1 and the other three grow with it at most: divided by d, all stay in range.
            upper /= lower[1]
            lower /= lower[1].copy()
    return upper[0].tolist(), upper[1].tolist(), lower[0].tolist(), lower[1].tolist()
