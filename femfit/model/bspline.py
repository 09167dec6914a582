"""Tensor-product B-splines in two variables, evaluated as piecewise polynomials with numpy alone.

A spline is stored by knots and coefficients (what the fit finds and the model file keeps). For evaluation it
is converted once to one small polynomial a cell, sum_ab P[a, b] s^a t^b with s, t counted from the cell's lower
corner, because a filter evaluates it millions of times: two searches and one gather replace the recursion.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapters IX to XI.
"""

from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.cell_polynomials import CellPolynomials, FloatFunction


def basis_matrix(x: FloatArray, knots: FloatArray, degree: int, derivative: int = 0) -> FloatArray:
    """B-spline basis functions, or their derivatives, at points, shape (n, len(knots) - degree - 1).

    Knots are clamped (``degree + 1`` equal ones at both ends); outside of them the end polynomials are continued.
    """
    count = len(knots) - degree - 1
    if derivative > degree:
        return np.zeros((len(x), count))
    if derivative:
        lower = basis_matrix(x, knots[1:-1], degree - 1, derivative - 1)
        span = knots[degree + 1 : degree + count] - knots[1:count]
        scaled = degree * lower / span
        result = np.zeros((len(x), count))
        result[:, 1:] += scaled
        result[:, :-1] -= scaled
        return result
    cell = np.clip(np.searchsorted(knots, x, side="right") - 1, degree, count - 1)
    local = np.zeros((len(x), degree + 1))
    local[:, 0] = 1.0
    for p in range(1, degree + 1):
        saved = np.zeros(len(x))
        for r in range(p):
            right = knots[cell + r + 1] - x
            left = x - knots[cell + 1 - p + r]
            term = local[:, r] / (right + left)
            local[:, r] = saved + right * term
            saved = left * term
        local[:, p] = saved
    result = np.zeros((len(x), count))
    columns = cell[:, None] - degree + np.arange(degree + 1)
    np.put_along_axis(result, columns, local, axis=1)
    return result


def is_clamped(knots: FloatArray, degree: int) -> bool:
    """Whether knots carry a spline: ascending, ``degree + 1`` equal at both ends, no more than ``degree`` inside."""
    if len(knots) < 2 * degree + 2 or np.any(np.diff(knots) < 0.0):
        return False
    _, counts = np.unique(knots, return_counts=True)
    return bool(len(counts) > 1 and counts[0] == counts[-1] == degree + 1 and np.all(counts[1:-1] <= degree))


@dataclass(frozen=True, eq=False)
class TensorSpline:
    """S(x, y) = sum_ab C[a, b] B_a(x) B_b(y).

    Parameters
    ----------
    x_knots, y_knots : array
        Clamped knot vectors (``degree + 1`` equal knots at both ends).
    coefficients : array, shape (len(x_knots) - x_degree - 1, len(y_knots) - y_degree - 1)
        C.
    """

    x_knots: FloatArray
    y_knots: FloatArray
    x_degree: int
    y_degree: int
    coefficients: FloatArray

    @cached_property
    def _cells(self) -> CellPolynomials:
        """One polynomial a cell, from the Taylor coefficients of the basis at its corner."""
        x_breaks, y_breaks = np.unique(self.x_knots), np.unique(self.y_knots)
        x_taylor = _taylor_rows(x_breaks[:-1], self.x_knots, self.x_degree)
        y_taylor = _taylor_rows(y_breaks[:-1], self.y_knots, self.y_degree)
        cells = np.einsum("xai,ij,ybj->xyab", x_taylor, self.coefficients, y_taylor)
        return CellPolynomials(x_breaks, y_breaks, cells.reshape(-1, self.x_degree + 1, self.y_degree + 1))

    def derivatives(self, x: FloatArray, y: FloatArray, orders: tuple[tuple[int, int], ...]) -> list[FloatArray]:
        """Partial derivatives of orders (in x, in y) at points (n,); border cells are continued outwards."""
        return self._cells.derivatives(x, y, orders)

    def in_floats(self, orders: tuple[tuple[int, int], ...]) -> FloatFunction:
        """The same for a handful of points in Python's floats: (list of x, list of y) -> one list a point."""
        return self._cells.in_floats(orders)


def _taylor_rows(points: FloatArray, knots: FloatArray, degree: int) -> FloatArray:
    """Taylor coefficients of every basis function at points, shape (n, degree + 1, functions)."""
    rows = [basis_matrix(points, knots, degree, k) / factorial(k) for k in range(degree + 1)]
    return np.stack(rows, axis=1)
