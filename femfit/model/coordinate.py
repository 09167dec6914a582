"""The coordinate in which splines follow the distance: an inverse distance, the distance, or one for two gaps.

Any number of functions of the distance: splines with common knots in one coordinate, evaluated together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from math import comb, factorial

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray, IntArray
from femfit.model.bspline import TensorSpline, taylor_rows

Orders = tuple[tuple[int, int], ...]
FloatPlaces = Callable[[list[float]], tuple[list[float], list[float]]]


@dataclass(frozen=True)
class DistanceCoordinate:
    """u = d_0 / (d + s), u = d / d_0, or u = sinh((d - d_0) / h).

    A force that grows towards a face is nearly a polynomial in the inverse distance; one of a body that passes the
    face is finite there, as the distance itself is. A body between two magnets has a gap on either side: the third one
    is stretched towards both ends, without a pole beyond them.
    """

    reference_distance_m: float  # d_0
    # s >= 0: the part of the magnetic path that the distance does not close, so that a small one leaves W' finite
    distance_shift_m: float = 0.0
    inverse: bool = True
    stretch_m: float | None = None  # h, where the coordinate is the one for two gaps; several circuits alone have it

    def of(self, distance: FloatArray) -> FloatArray:
        """The coordinate u at distances in m."""
        return self.with_slopes(distance)[0]

    def distance(self, u: FloatArray) -> FloatArray:
        """Distances in m at coordinates u."""
        d_0 = self.reference_distance_m
        if self.stretch_m is not None:
            return np.asarray(d_0 + self.stretch_m * np.arcsinh(u))
        return d_0 / u - self.distance_shift_m if self.inverse else d_0 * u

    def with_slopes(self, distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """u, du/dd in 1/m and d^2u/dd^2 in 1/m^2."""
        if self.stretch_m is not None:
            x = (distance - self.reference_distance_m) / self.stretch_m
            u = np.sinh(x)
            return u, np.cosh(x) / self.stretch_m, u / self.stretch_m**2
        if not self.inverse:
            u = distance / self.reference_distance_m
            return u, np.full_like(u, 1.0 / self.reference_distance_m), np.zeros_like(u)
        shifted = distance + self.distance_shift_m
        u = self.reference_distance_m / shifted
        return u, -u / shifted, 2.0 * u / shifted**2

    def finite_between(self, least: float, greatest: float) -> bool:
        """Whether u is finite at all distances in m from the least to the greatest."""
        return not self.inverse or not least <= -self.distance_shift_m <= greatest

    def partial_derivatives(
        self, spline: TensorSpline, distance: FloatArray, current: FloatArray, orders: Orders
    ) -> list[FloatArray]:
        """Partial derivatives, of orders (in d, in i), of a spline in (u, i) at flat arrays of d and i.

        du/dd = -u^2 / d_0 of the inverse, so that d^n/dd^n = (-1 / d_0)^n sum_k L(n, k) u^(n + k) d^k/du^k with the
        Lah numbers L(n, k) = C(n - 1, k - 1) n! / k!.

        References
        ----------
        L. Comtet, Advanced Combinatorics (Reidel, 1974), section 3.3, for the Lah numbers.
        """
        self._require_one_gap()
        d_0 = self.reference_distance_m
        if not self.inverse:
            values = spline.derivatives(distance / d_0, current, orders)
            return [(1.0 / d_0) ** a * value if a else value for (a, _), value in zip(orders, values, strict=True)]
        shifted = distance + self.distance_shift_m
        u = d_0 / shifted
        wanted = _inner_orders(orders)
        inner = dict(zip(wanted, spline.derivatives(u, current, wanted), strict=True))
        return [_in_distance(inner, u, shifted, a, b) for a, b in orders]

    def in_floats(self) -> FloatPlaces:
        """A function from distances to u and -du/dd, for a handful of points in Python's floats."""
        self._require_one_gap()
        d_0, shift = self.reference_distance_m, self.distance_shift_m

        def inverse(distances: list[float]) -> tuple[list[float], list[float]]:
            shifted = [d + shift for d in distances]
            u = [d_0 / one for one in shifted]
            return u, [one / d for one, d in zip(u, shifted, strict=True)]

        def plain(distances: list[float]) -> tuple[list[float], list[float]]:
            return [d / d_0 for d in distances], [-1.0 / d_0] * len(distances)

        return inverse if self.inverse else plain

    def _require_one_gap(self) -> None:
        if self.stretch_m is not None:
            raise DomainError("The coordinate of two gaps is that of several circuits; use one of a single gap here.")


@cache
def _inner_orders(orders: Orders) -> Orders:
    """Orders (in u, in i) that the chain rule needs."""
    return tuple(dict.fromkeys((k, b) for a, b in orders for k in range(min(a, 1), a + 1)))


def _in_distance(
    inner: dict[tuple[int, int], FloatArray], u: FloatArray, shifted: FloatArray, a: int, b: int
) -> FloatArray:
    if a == 0:
        return inner[0, b]
    if a == 1:
        return (-u / shifted) * inner[1, b]
    total = np.zeros_like(u)
    for k in range(1, a + 1):
        total += comb(a - 1, k - 1) * (factorial(a) // factorial(k)) * u**k * inner[k, b]
    return np.asarray((-1.0 / shifted) ** a * total)


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
