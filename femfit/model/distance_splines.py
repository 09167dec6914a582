"""Any number of functions of the distance: splines with common knots in one coordinate, evaluated together."""

from dataclasses import dataclass
from functools import cached_property
from math import perm

import numpy as np

from femfit.core.arrays import FloatArray
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
        u, first, second = (part.ravel()[:, None] for part in self.coordinate.with_slopes(distance))
        inner = self._breaks[1:-1].searchsorted(u[:, 0], "right")
        step = u - self._breaks[inner, None]
        cells = self._cells[inner]  # (points, powers, entries)

        def along(k: int) -> FloatArray:
            value = np.zeros((len(u), cells.shape[2]))
            for power in range(self.degree, k - 1, -1):
                value = value * step + cells[:, power] * perm(power, k)
            return value

        def entries(order: int) -> FloatArray:
            if order == 0:
                return along(0)
            return first * along(1) if order == 1 else first**2 * along(2) + second * along(1)

        shape = (*distance.shape, cells.shape[2])
        return [entries(order).reshape(shape) for order in orders]

    @cached_property
    def _breaks(self) -> FloatArray:
        return np.unique(self.knots)

    @cached_property
    def _cells(self) -> FloatArray:
        """One polynomial a cell and entry, the lowest power first: shape (cells, powers, entries)."""
        return np.asarray(taylor_rows(self._breaks[:-1], self.knots, self.degree) @ self.coefficients)
