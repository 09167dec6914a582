"""Tensor-product B-splines in two variables, evaluated as piecewise polynomials with numpy alone.

A spline is stored by knots and coefficients (what the fit finds and the model file keeps) and converted once to one
polynomial a cell, S = sum_ab P[a, b] s^a t^b with s, t counted from the cell's lower corner, because a filter evaluates
it millions of times. Beyond the knots in y a spline continues as a parabola, or as a straight line: a cubic's last
piece would bend on, and a co-energy's inductance, its second derivative, would become negative there. For derivatives
that are asked for again and again, the polynomials in s before the powers of t are laid out once, so that one gather
and one Horner scheme in s serve all of them; a second one in t follows.

B-spline basis functions as one polynomial a cell, for those who evaluate them at a few points again and again.

The recursion of de Boor takes a dozen array operations a degree, whatever the number of points; a closed loop asks for
a handful of points a million times. The polynomials are Taylor's at the lower corner of each cell between two knots.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapters IX to XI.
"""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import factorial, perm

import numpy as np

from femfit.core.numerics import FloatArray, IntArray

PARABOLA, LINE = 2, 1
"""Degrees of what continues a co-energy beyond its currents, with the inductance at the last, and a field."""

Orders = tuple[tuple[int, int], ...]
FloatFunction = Callable[[list[float], list[float]], list[list[float]]]


@dataclass(frozen=True, eq=False)
class _Plan:
    """What some derivatives need."""

    table: FloatArray  # Each row is a polynomial in s, the lowest power first; shape (powers of s, rows, cells)
    # For each derivative the rows before the powers of t, the highest power first
    terms: tuple[tuple[tuple[int, float], ...], ...]

    def in_lists(self) -> list[list[list[list[float]]]]:
        """For each cell and derivative, its rows times their factors, the highest powers first."""
        _, _, cells = self.table.shape
        return [
            [[(factor * self.table[::-1, row, cell]).tolist() for row, factor in rows] for rows in self.terms]
            for cell in range(cells)
        ]


@dataclass(frozen=True, eq=False)
class CellPolynomials:
    """A piecewise polynomial."""

    x_breaks: FloatArray
    y_breaks: FloatArray
    polynomials: FloatArray
    _plans: dict[Orders, _Plan] = field(default_factory=dict, init=False, repr=False)

    def derivatives(self, x: FloatArray, y: FloatArray, orders: Orders) -> list[FloatArray]:
        """Partial derivatives at points of shape (n,); outside, the polynomials of the outermost cells are continued.

        Parameters
        ----------
        orders : tuple of (int, int)
            Order in x and in y of each; (0, 0) is the value.
        """
        plan = self._planned(orders)
        cell = across = self.x_breaks[1:-1].searchsorted(x, "right")
        s = x - self.x_breaks[across]
        if len(self.y_breaks) == 2:
            t = y - self.y_breaks[0]
        else:
            along = self.y_breaks[1:-1].searchsorted(y, "right")
            t, cell = y - self.y_breaks[along], across * (len(self.y_breaks) - 1) + along
        coefficients = plan.table.take(cell, axis=2)
        rows = coefficients[-1]
        for lower in coefficients[-2::-1]:
            rows *= s
            rows += lower
        result = []
        for terms in plan.terms:
            if not terms:
                result.append(np.zeros_like(s))
                continue
            (row, factor), *lower_terms = terms
            value = factor * rows[row]
            for row, factor in lower_terms:
                value *= t
                value += rows[row] if factor == 1.0 else factor * rows[row]
            result.append(value)
        return result

    def in_floats(self, orders: Orders) -> FloatFunction:
        """The same derivatives at a handful of points in Python's floats: numpy's calls would cost more.

        Returns
        -------
        callable
            (list of x, list of y) -> one list of derivatives a point.
        """
        cells = self._planned(orders).in_lists()
        x_breaks, y_breaks = self.x_breaks.tolist(), self.y_breaks.tolist()
        x_inner, y_inner, width = x_breaks[1:-1], y_breaks[1:-1], len(y_breaks) - 1

        def polynomials(x: float, along: int) -> list[list[float]]:
            """For each derivative, the polynomial in t at one x, the highest power first."""
            across, result = bisect_right(x_inner, x), []
            s = x - x_breaks[across]
            for rows in cells[across * width + along]:
                polynomial = []
                for row in rows:
                    value = 0.0
                    for coefficient in row:
                        value = value * s + coefficient
                    polynomial.append(value)
                result.append(polynomial)
            return result

        def evaluate(x: list[float], y: list[float]) -> list[list[float]]:
            known: dict[tuple[float, int], list[list[float]]] = {}  # sigma points share their distances
            result = []
            for one_x, one_y in zip(x, y, strict=True):
                along = bisect_right(y_inner, one_y)
                place = (one_x, along)
                if place not in known:
                    known[place] = polynomials(one_x, along)
                t, values = one_y - y_breaks[along], []
                for polynomial in known[place]:
                    value = 0.0
                    for coefficient in polynomial:
                        value = value * t + coefficient
                    values.append(value)
                result.append(values)
            return result

        return evaluate

    def _planned(self, orders: Orders) -> _Plan:
        if orders in self._plans:
            return self._plans[orders]
        cells, x_count, y_count = self.polynomials.shape
        needed = dict.fromkeys((a, power) for a, b in orders for power in range(b, y_count))
        table = np.zeros((max([1, *(x_count - a for a, _ in orders)]), len(needed), cells))
        for row, (a, power) in enumerate(needed):
            for k in range(a, x_count):
                table[k - a, row] = perm(k, a) * self.polynomials[:, k, power]
        index = {key: row for row, key in enumerate(needed)}
        terms = tuple(
            tuple((index[a, power], float(perm(power, b))) for power in range(y_count - 1, b - 1, -1))
            for a, b in orders
        )
        plan = self._plans[orders] = _Plan(table, terms)
        return plan


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
        scaled = np.divide(degree * lower, span, out=np.zeros_like(lower), where=span > 0.0)  # zero at double knots
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
    """S(x, y) = sum_ab C[a, b] B_a(x) B_b(y)."""

    # Clamped knot vectors (``degree + 1`` equal knots at both ends)
    x_knots: FloatArray
    y_knots: FloatArray
    x_degree: int
    y_degree: int
    coefficients: FloatArray  # C; shape (len(x_knots) - x_degree - 1, len(y_knots) - y_degree - 1)
    beyond: int = PARABOLA  # Degree of what continues it in y

    @cached_property
    def _cells(self) -> CellPolynomials:
        """One polynomial a cell, from the Taylor coefficients of the basis at its corner."""
        x_breaks = np.unique(self.x_knots)
        x_taylor = taylor_rows(x_breaks[:-1], self.x_knots, self.x_degree)
        y_breaks, y_taylor = continued_rows(self.y_knots, self.y_degree, self.beyond)
        cells = np.einsum("xai,ij,ybj->xyab", x_taylor, self.coefficients, y_taylor)
        return CellPolynomials(x_breaks, y_breaks, cells.reshape(-1, self.x_degree + 1, self.y_degree + 1))

    def derivatives(self, x: FloatArray, y: FloatArray, orders: tuple[tuple[int, int], ...]) -> list[FloatArray]:
        """Partial derivatives of orders (in x, in y) at points (n,), continued outwards."""
        return self._cells.derivatives(x, y, orders)

    def in_floats(self, orders: tuple[tuple[int, int], ...]) -> FloatFunction:
        """The same for a handful of points in Python's floats: (list of x, list of y) -> one list a point."""
        return self._cells.in_floats(orders)


def taylor_rows(points: FloatArray, knots: FloatArray, degree: int) -> FloatArray:
    """Taylor coefficients of every basis function at points, shape (n, degree + 1, functions)."""
    rows = [basis_matrix(points, knots, degree, k) / factorial(k) for k in range(degree + 1)]
    return np.stack(rows, axis=1)


def continued_rows(knots: FloatArray, degree: int, beyond: int | None) -> tuple[FloatArray, FloatArray]:
    """Breaks and the :func:`taylor_rows` at the lower ends of all cells.

    Where the degree is above ``beyond``, there is one cell below the knots and one above, without an end: they count
    from the first and the last knot, and end with that power.
    """
    breaks = np.unique(knots)
    if beyond is None or degree <= beyond:
        return breaks, taylor_rows(breaks[:-1], knots, degree)
    rows = taylor_rows(breaks[[0, *range(len(breaks))]], knots, degree)
    rows[[0, -1], beyond + 1 :] = 0.0
    return breaks[[0, *range(len(breaks)), -1]], rows


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
