"""Tensor-product B-splines, evaluated as piecewise polynomials.

A spline is stored by knots and coefficients (what the fit finds and the model file keeps) and enters an expression as
one polynomial a cell, in powers of the way from the cell's middle. Beyond the knots of a current it continues as
a parabola, or as a straight line: a cubic's last piece would bend on, and a co-energy's inductance, its second
derivative, would become negative there.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapters IX to XI.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import factorial
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, row_of
from femfit.core.numerics import FloatArray

PARABOLA, LINE = 2, 1
"""Degrees of what continues a co-energy beyond its currents, with the inductance at the last, and a field."""


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


def functions(knots: FloatArray, degree: int) -> int:
    """How many B-splines have these knots."""
    return len(knots) - degree - 1


def nested_shape(spline: Any, along: Sequence[Any]) -> tuple[int, ...]:
    """Numbers of functions of u and of each current, of which each has knots and a degree."""
    return functions(spline.u_knots, spline.u_degree), *(functions(one.knots_A, one.degree) for one in along)


def is_clamped(knots: FloatArray, degree: int) -> bool:
    """Whether knots carry a spline: ascending, ``degree + 1`` equal at both ends, no more than ``degree`` inside."""
    if len(knots) < 2 * degree + 2 or np.any(np.diff(knots) < 0.0):
        return False
    _, counts = np.unique(knots, return_counts=True)
    return bool(len(counts) > 1 and counts[0] == counts[-1] == degree + 1 and np.all(counts[1:-1] <= degree))


@dataclass(frozen=True, eq=False)
class TensorSpline:
    """S(x, y) = sum_ab C[a, b] B_a(x) B_b(y); in a model file x is u, and y the current."""

    # Clamped knot vectors (``degree + 1`` equal knots at both ends)
    x_knots: FloatArray = field(metadata={"key": "u_knots", "degree": "x_degree"})
    y_knots: FloatArray = field(metadata={"key": "current_knots_A", "degree": "y_degree"})
    x_degree: int = field(metadata={"key": "u_degree", "within": (1, 9)})
    y_degree: int = field(metadata={"key": "current_degree", "within": (0, 9)})
    # C; shape (functions of x, functions of y)
    coefficients: FloatArray = field(
        metadata={"shape": lambda s: (functions(s.x_knots, s.x_degree), functions(s.y_knots, s.y_degree))}
    )
    beyond: int = field(default=PARABOLA, metadata={"key": None})  # Degree of what continues it in y

    def expression(self, x: Expression, y: Expression) -> SX:
        """The value of an expression's x and y."""
        return cell_table(self, self._cells).at(x, y)[0]

    def _cells(self) -> CellTable:
        axes = cells_of(self.x_knots, self.x_degree), cells_of(self.y_knots, self.y_degree, self.beyond)
        return CellTable(axes, self.coefficients[..., None])


def taylor_rows(points: FloatArray, knots: FloatArray, degree: int) -> FloatArray:
    """Taylor coefficients of every basis function at points, shape (n, degree + 1, functions)."""
    rows = [basis_matrix(points, knots, degree, k) / factorial(k) for k in range(degree + 1)]
    return np.stack(rows, axis=1)


Cells = tuple[FloatArray, FloatArray, FloatArray]
"""Of one axis: the borders between its cells, where each one's polynomials count from, and their Taylor coefficients,
shape (cells, degree + 1, functions)."""


def cells_of(knots: FloatArray, degree: int, beyond: int | None = None) -> Cells:
    """The cells of an axis; outside of its knots the polynomials at their ends go on, at most of degree ``beyond``.

    They count from their middles: from an end, powers of a whole cell's width would cancel. Where the degree is above
    ``beyond``, there is one cell below the knots and one above, which count from the first and the last knot.
    """
    breaks = np.unique(knots)
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    if beyond is None or degree <= beyond:
        return breaks[1:-1], middles, taylor_rows(middles, knots, degree)
    origins = np.concatenate([breaks[:1], middles, breaks[-1:]])
    rows = taylor_rows(origins, knots, degree)
    rows[[0, -1], beyond + 1 :] = 0.0
    return breaks, origins, rows


class CellTable:
    """A tensor spline as one polynomial a cell, for expressions.

    Parameters
    ----------
    axes : sequence of Cells
    coefficients : array, shape (functions of the first axis, .., entries)
    """

    def __init__(self, axes: Sequence[Cells], coefficients: FloatArray) -> None:
        table, n = coefficients, len(axes)
        for *_, rows in axes:  # each axis' functions become its cells and powers, at the end of the table's axes
            table = np.tensordot(table, rows, axes=(0, 2))
        entries, *pairs = range(table.ndim)
        table = table.transpose(*pairs[0::2], entries, *pairs[1::2])
        origins = np.stack(np.meshgrid(*(origins for _, origins, _ in axes), indexing="ij"), axis=-1)
        self._entries, self._powers = table.shape[n], table.shape[n + 1 :]
        self._rows = np.concatenate([origins, table.reshape(*table.shape[:n], -1)], axis=n)
        self._borders = [borders for borders, *_ in axes]

    def at(self, *coordinates: Expression) -> list[SX]:
        """The entries at an expression's coordinates."""
        row, value = row_of(self._rows, self._borders, coordinates), polynomial(self._powers)
        origins, *each = ca.vertsplit(row, [0, *range(len(coordinates), row.numel() + 1, int(np.prod(self._powers)))])
        local = ca.vertcat(*coordinates) - origins
        return [value(one, local) for one in each]


@cache
def polynomial(powers: tuple[int, ...]) -> ca.Function:
    """(coefficients, variables) -> value by Horner's scheme, the first variable's powers outermost, lowest first."""
    coefficients, at = SX.sym("c", int(np.prod(powers))), SX.sym("x", len(powers))

    def value(part: SX, variables: list[SX], sizes: tuple[int, ...]) -> SX:
        if not variables:
            return part
        result = SX(0.0)
        for one in reversed(ca.vertsplit(part, part.numel() // sizes[0])):
            result = result * variables[0] + value(one, variables[1:], sizes[1:])
        return result

    return ca.Function("polynomial", [coefficients, at], [value(coefficients, ca.vertsplit(at), powers)])


_TABLES: WeakKeyDictionary[Any, CellTable] = WeakKeyDictionary()


def cell_table(owner: Any, make: Callable[[], CellTable]) -> CellTable:
    """The table of what owns it, made once."""
    if owner not in _TABLES:
        _TABLES[owner] = make()
    return _TABLES[owner]
