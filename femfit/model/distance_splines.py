"""Any number of functions of the distance: splines with common knots in one coordinate, evaluated together."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.bspline import taylor_rows
from femfit.model.coordinate import DistanceCoordinate


@dataclass(frozen=True, eq=False)
class DistanceSplines:
    """f_k(d) = sum_a c_ak N_a(u(d)), the polynomials at the ends of the knots continued."""

    coordinate: DistanceCoordinate
    knots: FloatArray
    degree: int
    coefficients: FloatArray  # c, shape (functions N, entries)

    def derivatives(self, distance: FloatArray, *orders: int) -> list[FloatArray]:
        """Derivatives in d of zeroth to second order of all entries at distances (...), each (..., entries)."""
        distance = np.asarray(distance, dtype=np.float64)
        u, first, second = self.coordinate.with_slopes(distance.ravel())
        inner = self._breaks[1:-1].searchsorted(u, "right")
        powers = (u - self._breaks[inner])[:, None] ** np.arange(self.degree + 1)
        weights = np.empty((len(u), len(orders), self.degree + 1))
        for row, order in enumerate(orders):
            if order == 0:
                weights[:, row] = powers
                continue
            weights[:, row] = powers @ self._slope
            if order == 1:
                weights[:, row] *= first[:, None]
            else:
                weights[:, row] *= second[:, None]
                weights[:, row] += (first**2)[:, None] * (powers @ self._slope @ self._slope)
        found = products_by_cell(weights, self._cells, inner)
        shape = (*distance.shape, found.shape[2])
        return [found[:, row].reshape(shape) for row in range(len(orders))]

    @cached_property
    def _slope(self) -> FloatArray:
        """The matrix D of (1, s, s^2, ..)' = (1, s, s^2, ..) D."""
        return np.diag(np.arange(1.0, self.degree + 1), 1)

    @cached_property
    def _breaks(self) -> FloatArray:
        return np.unique(self.knots)

    @cached_property
    def _cells(self) -> FloatArray:
        """One polynomial a cell and entry, the lowest power first: shape (cells, powers, entries)."""
        return np.asarray(taylor_rows(self._breaks[:-1], self.knots, self.degree) @ self.coefficients)


FEW = 64
"""Measured: up to so many points, one product a point is quicker than one a cell."""


def products_by_cell(weights: FloatArray, cells: FloatArray, cell: IntArray) -> FloatArray:
    """Weights (N, orders, powers) times the polynomials (cells, powers, entries) of each point's cell."""
    if len(cell) <= FEW:
        return np.asarray(weights @ cells[cell])
    orders, powers = weights.shape[1:]
    result = np.empty((len(cell), orders, cells.shape[2]))
    for one in np.flatnonzero(np.bincount(cell)):
        points = np.flatnonzero(cell == one)
        result[points] = (weights[points].reshape(-1, powers) @ cells[one]).reshape(len(points), orders, -1)
    return result
