"""Cholesky factors of many small matrices, each reporting its own failure.

``numpy.linalg.cholesky`` raises for the whole batch when one matrix fails; a Monte-Carlo run must name the run.
Entry by entry over all runs at once, it is also several times faster for many small matrices; a few large ones go to it
first.
"""

from contextlib import suppress

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray


def cholesky(matrices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Lower factors L with L L^T = M, the precision being that of the input.

    Parameters
    ----------
    matrices : array, shape (runs, n, n)
        Symmetric; only the lower triangle is read.

    Returns
    -------
    factor : array, shape (runs, n, n)
        NaN where the matrix is not positive definite.

    References
    ----------
    G. H. Golub and C. F. Van Loan, Matrix Computations (Johns Hopkins, 2013), section 4.2.5.
    """
    runs, order, _ = matrices.shape
    if 2 * runs < order**3:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(matrices), matrices.dtype), np.ones(runs, dtype=np.bool_)
    factor = np.zeros((order, order, runs), matrices.dtype)  # each entry's values of all runs are neighbours
    with np.errstate(invalid="ignore", divide="ignore", over="ignore", under="ignore"):
        for j in range(order):
            pivot = matrices[:, j, j]
            for k in range(j):
                pivot = pivot - factor[j, k] ** 2
            root = np.sqrt(pivot, out=factor[j, j])
            for i in range(j + 1, order):
                entry = matrices[:, i, j]
                for k in range(j):
                    entry = entry - factor[i, k] * factor[j, k]
                np.divide(entry, root, out=factor[i, j])
        definite = factor[-1, -1] > 0.0  # a pivot that is not positive makes all later ones NaN
    factor = factor.transpose(2, 0, 1)
    if not definite.all():
        factor[~definite] = np.nan
    return factor, definite
