"""Cholesky factors of many small matrices, each reporting its own failure.

``numpy.linalg.cholesky`` raises for the whole batch when one matrix fails; a Monte-Carlo run must name the run.
Entry by entry over all runs at once, it is also several times faster for matrices this small.
"""

from math import sqrt

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray


def empty_matrices(runs: int, order: int, dtype: np.dtype[np.floating] | None = None) -> FloatArray:
    """Uninitialised array of shape (runs, n, n) in which each entry's values of all runs are neighbours in memory."""
    return np.empty((order, order, runs), dtype).transpose(2, 0, 1)


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
    factor = empty_matrices(runs, order, matrices.dtype)
    definite = np.ones(runs, dtype=np.bool_)
    for j in range(order):
        pivot = matrices[:, j, j]
        for k in range(j):
            pivot = pivot - factor[:, j, k] ** 2
        positive = pivot > 0.0
        if not positive.all():
            definite &= positive
            pivot = np.where(positive, pivot, np.nan)
        factor[:, j, j] = root = np.sqrt(pivot)
        for i in range(j + 1, order):
            entry = matrices[:, i, j]
            for k in range(j):
                entry = entry - factor[:, i, k] * factor[:, j, k]
            factor[:, i, j] = entry / root
            factor[:, j, i] = 0.0
    if not definite.all():
        factor[~definite] = np.nan
    return factor, definite


def cholesky_rows(matrix: list[list[float]]) -> list[list[float]] | None:
    """Rows of the lower factor of one matrix in Python's floats, of which the lower triangle is read.

    None where it is not positive definite.
    """
    rows: list[list[float]] = []
    order = len(matrix)
    for i, entries in enumerate(matrix):
        row = [0.0] * order
        for j in range(i):
            other, total = rows[j], entries[j]
            for k in range(j):
                total -= row[k] * other[k]
            row[j] = total / other[j]
        pivot = entries[i]
        for k in range(i):
            pivot -= row[k] * row[k]
        if not pivot > 0.0:
            return None
        row[i] = sqrt(pivot)
        rows.append(row)
    return rows


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

    References
    ----------
    P. E. Gill, G. H. Golub, W. Murray and M. A. Saunders, Mathematics of Computation 28 (1974) 505, method C1.
    """
    result, remaining = factor.copy(order="K"), vector.copy(order="K")
    definite = np.ones(len(factor), dtype=np.bool_)
    for k in range(factor.shape[-1]):
        diagonal = result[:, k, k]
        square = diagonal**2 + sign * remaining[:, k] ** 2
        definite &= square > 0.0
        root = np.sqrt(np.where(square > 0.0, square, np.nan))
        cosine, sine = root / diagonal, remaining[:, k] / diagonal
        result[:, k, k] = root
        if k + 1 < factor.shape[-1]:
            column = (result[:, k + 1 :, k] + sign * sine[:, None] * remaining[:, k + 1 :]) / cosine[:, None]
            remaining[:, k + 1 :] = cosine[:, None] * remaining[:, k + 1 :] - sine[:, None] * column
            result[:, k + 1 :, k] = column
    result[~definite] = np.nan
    return result, definite
