"""Tensor-product B-splines, evaluated as piecewise polynomials.

A spline is stored by knots and coefficients (what the fit finds and the model file keeps) and enters an expression as
one polynomial a cell, in powers of the way from the cell's middle. Beyond the knots of a current it continues as
a parabola, or as a straight line: a cubic's last piece would bend on, and a co-energy's inductance, its second
derivative, would become negative there.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapters IX to XI.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import factorial
from typing import Any, Literal

import casadi as ca
import numpy as np
from casadi import SX
from scipy.interpolate import BSpline

from femfit.core.graph import Expression, GraphFunction, once, row_of
from femfit.core.numerics import FloatArray

PARABOLA, LINE = 2, 1
"""Degrees of what continues a co-energy beyond its currents, with the inductance at the last, and a field."""


def basis_matrix(x: FloatArray, knots: FloatArray, degree: int, derivative: int = 0) -> FloatArray:
    """B-spline basis functions, or their derivatives, at points, shape (n, len(knots) - degree - 1).

    Knots are clamped (``degree + 1`` equal ones at both ends); outside of them the end polynomials are continued.
    """
    return np.asarray(BSpline(knots, np.eye(functions(knots, degree)), degree)(x, derivative))


def functions(knots: FloatArray, degree: int) -> int:
    """How many B-splines have these knots."""
    return len(knots) - degree - 1


def nested_shape(spline: Any, along: Sequence[Any]) -> tuple[int, ...]:
    """Numbers of functions of u and of each current, of which each has knots and a degree."""
    return functions(spline.u_knots, spline.u_degree), *(functions(axis.knots_A, axis.degree) for axis in along)


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

    def expression(self, x: Expression, y: Expression, beyond: int = PARABOLA) -> SX:
        """The value of an expression's x and y, continued in y by a polynomial of the degree ``beyond``."""
        axes = (self.x_knots, self.x_degree), (self.y_knots, self.y_degree, beyond)
        return spline_at(self, axes, self.coefficients[..., None], x, y)[0]


Cells = tuple[FloatArray, FloatArray, FloatArray]
"""Of one axis: the borders between its cells, where each one's polynomials count from, and their Taylor coefficients,
shape (cells, degree + 1, functions)."""


def cells_of(knots: FloatArray, degree: int, beyond: int | None = None) -> Cells:
    """The cells of an axis; outside of its knots the polynomials at their ends go on, at most of degree ``beyond``.

    They count from their middles: from an end, powers of a whole cell's width would cancel. Where the degree is above
    ``beyond``, there is one cell below the knots and one above, which count from the first and the last knot.
    """
    breaks = np.unique(knots)
    borders, origins, lower = breaks[1:-1], 0.5 * (breaks[1:] + breaks[:-1]), beyond is not None and degree > beyond
    if lower:
        borders, origins = breaks, np.concatenate([breaks[:1], origins, breaks[-1:]])
    rows = np.stack([basis_matrix(origins, knots, degree, k) / factorial(k) for k in range(degree + 1)], axis=1)
    if lower:
        rows[[0, -1], (beyond or 0) + 1 :] = 0.0
    return borders, origins, rows


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
        self._powers = table.shape[n + 1 :]
        self._rows = np.concatenate([origins, table.reshape(*table.shape[:n], -1)], axis=n)
        self._borders = [borders for borders, *_ in axes]

    def at(self, *coordinates: Expression) -> list[SX]:
        """The entries at an expression's coordinates."""
        row, value = row_of(self._rows, self._borders, coordinates), polynomial(self._powers)
        origins, *each = ca.vertsplit(row, [0, *range(len(coordinates), row.numel() + 1, int(np.prod(self._powers)))])
        local = ca.vertcat(*coordinates) - origins
        return [value(values, local) for values in each]


@cache
def polynomial(powers: tuple[int, ...]) -> ca.Function:
    """(coefficients, variables) -> value by Horner's scheme, the first variable's powers outermost, lowest first."""
    coefficients, x = SX.sym("c", int(np.prod(powers))), SX.sym("x", len(powers))

    def value(cells: SX, variables: list[SX], sizes: tuple[int, ...]) -> SX:
        if not variables:
            return cells
        result = SX(0.0)
        for cell in reversed(ca.vertsplit(cells, cells.numel() // sizes[0])):
            result = result * variables[0] + value(cell, variables[1:], sizes[1:])
        return result

    return ca.Function("polynomial", [coefficients, x], [value(coefficients, ca.vertsplit(x), powers)])


def spline_at(
    owner: Any, axes: Sequence[tuple[Any, ...]], coefficients: FloatArray, *coordinates: Expression
) -> list[SX]:
    """The entries of an owner's spline at an expression's coordinates; its table is made once.

    Parameters
    ----------
    axes : sequence of tuple
        Of each axis what :func:`cells_of` takes.
    coefficients : array
        As of :class:`CellTable`.
    """
    key = tuple((knots.tobytes(), *orders) for knots, *orders in axes)
    table = once(owner, ("table", key), lambda: CellTable([cells_of(*axis) for axis in axes], coefficients))
    return table.at(*coordinates)


@dataclass(frozen=True)
class DistanceCoordinate:
    """In which splines follow the distance: u = d_0 / (d + s), u = d / d_0, or u = sinh((d - d_0) / h).

    A force that grows towards a face is nearly a polynomial in the inverse distance; one of a body that passes the
    face is finite there, as the distance itself is. A body between two magnets has a gap on either side: the third one
    is stretched towards both ends, without a pole beyond them.
    """

    reference_distance_m: float  # d_0
    # s >= 0: the part of the magnetic path that the distance does not close, so that a small one leaves W' finite
    distance_shift_m: float = field(default=0.0, metadata={"lower": 0.0})
    kind: Literal["inverse_distance", "distance", "two_gaps"] = field(
        default="inverse_distance", metadata={"key": "coordinate"}
    )
    # h, where the coordinate is the one for two gaps; several circuits alone have it
    stretch_m: float | None = field(default=None, metadata={"positive": True, "omit": True})

    def faults(self) -> Iterator[tuple[str, str]]:
        """Numbers that this kind of coordinate cannot have."""
        if self.kind != "two_gaps" and not self.reference_distance_m > 0.0:
            yield "reference_distance_m", "a finite number > 0"
        if (self.kind == "two_gaps") != (self.stretch_m is not None):
            yield "stretch_m", "a finite number > 0 beside two_gaps, and absent beside others"

    @property
    def inverse(self) -> bool:
        """Whether it is the inverse distance."""
        return self.kind == "inverse_distance"

    def of(self, distance: Expression) -> Expression:
        """The coordinate u at distances in m, of arrays and of expressions."""
        d_0 = self.reference_distance_m
        if self.stretch_m is not None:
            return np.sinh((distance - d_0) / self.stretch_m)
        return d_0 / (distance + self.distance_shift_m) if self.inverse else distance / d_0

    def distance(self, u: FloatArray) -> FloatArray:
        """Distances in m at coordinates u."""
        d_0 = self.reference_distance_m
        if self.stretch_m is not None:
            return np.asarray(d_0 + self.stretch_m * np.arcsinh(u))
        return d_0 / u - self.distance_shift_m if self.inverse else d_0 * u

    def with_slopes(self, distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """u, du/dd in 1/m and d^2u/dd^2 in 1/m^2."""
        u, d_0 = self.of(distance), self.reference_distance_m
        if self.stretch_m is not None:
            return u, np.sqrt(1.0 + u**2) / self.stretch_m, u / self.stretch_m**2
        if self.inverse:
            return u, -(u**2) / d_0, 2.0 * u**3 / d_0**2
        return u, np.full_like(u, 1.0 / d_0), np.zeros_like(u)


FLAT = {"flat": True}
"""How a model file has the coordinate of splines, beside their knots."""


@dataclass(frozen=True, eq=False)
class DistanceSplines:
    """Functions f_k(d) = sum_a c_ak N_a(u(d)) of common knots, the polynomials at their ends continued."""

    coordinate: DistanceCoordinate
    knots: FloatArray
    degree: int
    coefficients: FloatArray  # c, shape (functions N, entries)

    def expression(self, distance: Expression) -> list[SX]:
        """All entries at an expression's distance."""
        return spline_at(self, [(self.knots, self.degree)], self.coefficients, self.coordinate.of(distance))

    def derivatives(self, distance: FloatArray, *orders: int) -> list[FloatArray]:
        """Derivatives in d of all entries at distances (...), each (..., entries)."""
        distance = np.asarray(distance, dtype=np.float64)

        def made() -> GraphFunction:
            d = SX.sym("d")
            values = [ca.vertcat(*self.expression(d))]
            for _ in range(max(orders)):
                values.append(ca.jacobian(values[-1], d))
            return GraphFunction([d], ca.vertcat(*(values[order] for order in orders)))

        values = once(self, orders, made)(distance.reshape(1, -1)).T
        return [derivative.reshape(*distance.shape, -1) for derivative in np.split(values, len(orders), axis=1)]
