"""B-spline basis functions as one polynomial a cell, for those who evaluate them at a few points again and again.

The recursion of de Boor takes a dozen array operations a degree, whatever the number of points; a closed loop asks for
a handful of points a million times. The polynomials are Taylor's at the lower corner of each cell between two knots.
"""

from dataclasses import dataclass
from functools import cached_property
from math import perm

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.bspline import continued_rows


@dataclass(frozen=True, eq=False)
class Places:
    """Points on one axis: the cell that each lies in, and the powers of its distance from the cell's lower corner."""

    cell: IntArray  # (n,)
    powers: FloatArray  # (n, degree + 1), the lowest first


@dataclass(frozen=True, eq=False)
class BasisPolynomials:
    """All basis functions of one axis; outside of the knots the polynomials at their ends are continued.

    With a degree ``beyond`` below that of the spline, only as far as that.
    """

    knots: FloatArray  # Clamped
    degree: int
    beyond: int | None = None

    @cached_property
    def _breaks_and_rows(self) -> tuple[FloatArray, FloatArray]:
        return continued_rows(self.knots, self.degree, self.beyond)

    @cached_property
    def _tables(self) -> dict[int, FloatArray]:
        return {}

    def places(self, x: FloatArray) -> Places:
        """Where points of shape (n,) lie."""
        breaks, _ = self._breaks_and_rows
        cell = breaks[1:-1].searchsorted(x, "right")
        powers = np.ones((len(x), self.degree + 1))
        powers[:, 1:] = (x - breaks[cell])[:, None]
        return Places(cell, np.multiply.accumulate(powers, axis=1))

    def values(self, at: Places, derivative: int = 0) -> FloatArray:
        """Basis functions or their derivatives at places, of shape (n, functions)."""
        if derivative > self.degree:
            return np.zeros((len(at.cell), len(self.knots) - self.degree - 1))
        if derivative not in self._tables:
            rows = self._breaks_and_rows[1][:, derivative:]
            factors = [perm(power, derivative) for power in range(derivative, self.degree + 1)]
            self._tables[derivative] = rows * np.array(factors, dtype=np.float64)[:, None]
        powers = at.powers[:, None, : self.degree + 1 - derivative]
        return np.asarray((powers @ self._tables[derivative].take(at.cell, axis=0))[:, 0])
