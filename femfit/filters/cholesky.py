"""Cholesky factors of many small matrices, each reporting its own failure.

``numpy.linalg.cholesky`` raises for the whole batch when one matrix fails; a Monte-Carlo run must name the run.
"""

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray


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
    definite : array of bool, shape (runs,)
        Which succeeded.

    References
    ----------
    G. H. Golub and C. F. Van Loan, Matrix Computations (Johns Hopkins, 2013), section 4.2.5.
    """
    runs, order, _ = matrices.shape
    factor = np.zeros_like(matrices)
    definite = np.ones(runs, dtype=np.bool_)
    for j in range(order):
        row = factor[:, j, :j]
        pivot = matrices[:, j, j] - np.einsum("rk,rk->r", row, row)
        definite &= pivot > 0.0
        root = np.sqrt(np.where(pivot > 0.0, pivot, np.nan))
        factor[:, j, j] = root
        if j + 1 < order:
            below = matrices[:, j + 1 :, j] - np.einsum("rik,rk->ri", factor[:, j + 1 :, :j], row)
            factor[:, j + 1 :, j] = below / root[:, None]
    factor[~definite] = np.nan
    return factor, definite


def rank_one_change(factor: FloatArray, vector: FloatArray, sign: float) -> tuple[FloatArray, BoolArray]:
    """Factors of L L^T + sign v v^T.

    Parameters
    ----------
    factor : array, shape (runs, n, n)
        Lower factors L.
    vector : array, shape (runs, n)
        v.

    Returns
    -------
    factor : array, shape (runs, n, n)
        NaN where the result is not positive definite.
    definite : array of bool, shape (runs,)
        Which succeeded.

    References
    ----------
    P. E. Gill, G. H. Golub, W. Murray and M. A. Saunders, Mathematics of Computation 28 (1974) 505, method C1.
    """
    result, rest = factor.copy(), vector.copy()
    definite = np.ones(len(factor), dtype=np.bool_)
    for k in range(factor.shape[-1]):
        diagonal = result[:, k, k]
        square = diagonal**2 + sign * rest[:, k] ** 2
        definite &= square > 0.0
        root = np.sqrt(np.where(square > 0.0, square, np.nan))
        cosine, sine = root / diagonal, rest[:, k] / diagonal
        result[:, k, k] = root
        if k + 1 < factor.shape[-1]:
            column = (result[:, k + 1 :, k] + sign * sine[:, None] * rest[:, k + 1 :]) / cosine[:, None]
            rest[:, k + 1 :] = cosine[:, None] * rest[:, k + 1 :] - sine[:, None] * column
            result[:, k + 1 :, k] = column
    result[~definite] = np.nan
    return result, definite
