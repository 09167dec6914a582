"""A piecewise polynomial in two variables, evaluated quickly for one point as for thousands.

In every cell S(x, y) = sum_ab P[a, b] s^a t^b with s, t counted from the cell's lower corner. For a set of derivatives
that is asked for again and again, as plant and filters do, the polynomials in s that stand before the powers of t are
laid out once, so that one gather and one Horner scheme in s serve every derivative; a second one in t follows.
"""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from math import perm

import numpy as np

from femfit.core.arrays import FloatArray

Orders = tuple[tuple[int, int], ...]
FloatFunction = Callable[[list[float], list[float]], list[list[float]]]


@dataclass(frozen=True, eq=False)
class _Plan:
    """What some derivatives need.

    Parameters
    ----------
    table : array, shape (powers of s, rows, cells)
        Each row is a polynomial in s, the lowest power first.
    terms : tuple of tuple of (row, factor)
        Of each derivative the rows before the powers of t, the highest power first.
    """

    table: FloatArray
    terms: tuple[tuple[tuple[int, float], ...], ...]

    def in_lists(self) -> list[list[list[list[float]]]]:
        """Of each cell and derivative, its rows times their factors, the highest powers first."""
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
        """Partial derivatives at points of shape (n,); outside, the border cells' polynomials are continued.

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
            """Of each derivative, the polynomial in t at one x, the highest power first."""
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
