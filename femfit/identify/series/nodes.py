"""A record seen on a coarser grid: values and slopes at nodes from polynomials fitted to the samples near each.

References
----------
J. Fan and I. Gijbels, Local Polynomial Modelling and Its Applications (Chapman and Hall, 1996), section 3.2.
"""

import numpy as np
from scipy import sparse

from femfit.core.arrays import BoolArray, FloatArray, IntArray


def local_polynomials(
    node_s: FloatArray,
    node_segment: IntArray,
    time: FloatArray,
    segment: IntArray,
    known: BoolArray,
    *,
    centre_s: FloatArray,
    behind_s: float,
    ahead_s: float,
    degree: int,
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Weights of the value and of the slope of a local polynomial.

    Parameters
    ----------
    node_s : array, shape (n,)
        Times of the nodes.
    node_segment : array of int, shape (n,)
        Segment of each.
    time, segment, known : array, shape (N,)
        Of the samples, time growing within each segment and segments never falling.
    centre_s : array, shape (n,)
        Where the samples stand that count for each node: the node itself, or before it.
    behind_s, ahead_s : float
        From so far behind the centre to so far ahead of it, by the weight (1 - s^2)^2; more, on the same sides, where
        there are too few of them.

    Returns
    -------
    tuple of two sparse arrays, shape (n, N)
        Of values and of slopes, exact for polynomials up to the degree.
    """
    here = np.flatnonzero(known)
    # One clock for all segments, far enough apart that no node sees another segment
    span = float(time.max() - time.min()) + 10.0 * (behind_s + ahead_s)
    clock, asked = time[here] - time.min() + span * segment[here], centre_s - time.min() + span * node_segment
    least, slack = 2 * (degree + 1), 1e-9 * (behind_s + ahead_s)
    first = np.searchsorted(clock, asked - behind_s - slack)
    last = np.searchsorted(clock, asked + ahead_s + slack)
    few = last - first < least
    shift = np.where(ahead_s > 0.0, least // 2, least)
    begin = np.clip(np.searchsorted(clock, asked + slack) - shift, 0, max(len(clock) - least, 0))
    first, last = np.where(few, begin, first), np.where(few, np.minimum(begin + least, len(clock)), last)
    picked = first[:, None] + np.arange(int((last - first).max()))
    inside = picked < last[:, None]
    picked = np.minimum(picked, len(clock) - 1)
    distance = clock[picked] - asked[:, None]
    farthest = np.abs(np.where(inside, distance, 0.0)).max(axis=1, keepdims=True)
    width = np.maximum(max(behind_s, ahead_s), 1.01 * farthest)
    weight = np.where(inside, (1.0 - (distance / width) ** 2) ** 2, 0.0)
    s = (distance - (node_s - centre_s)[:, None]) / width
    basis = s[:, :, None] ** np.arange(degree + 1)
    carried = weight[:, :, None] * basis
    gram = np.einsum("nka,nkb->nab", carried, basis)
    unit = np.zeros((len(asked), degree + 1, 2))
    unit[:, 0, 0], unit[:, 1, 1] = 1.0, 1.0 / width[:, 0]
    value = carried @ np.linalg.solve(gram, unit)
    row = np.repeat(np.arange(len(asked)), picked.shape[1])[inside.ravel()]
    column = here[picked[inside]]
    shape = (len(asked), len(time))
    level, slope = (sparse.csr_array((value[:, :, j][inside], (row, column)), shape=shape) for j in (0, 1))
    return level, slope
