"""The coordinate in which splines follow the distance: an inverse distance, the distance, or one for two gaps.

Any number of functions of the distance: splines with common knots in one coordinate, evaluated together.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, GraphFunction, Memo, building
from femfit.core.numerics import FloatArray
from femfit.model.bspline import CellTable, cell_table, cells_of


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


INVERSE, PLAIN, TWO_GAPS = "inverse_distance", "distance", "two_gaps"

_LEAST_M = 1e-60
"""Derived: what a model file's numbers are divided by is no smaller."""


@dataclass(frozen=True, kw_only=True)
class FiledCoordinate:
    """A coordinate in a model file."""

    coordinate: Literal["inverse_distance", "distance", "two_gaps"] = "inverse_distance"  # As in files of schema 1
    reference_distance_m: float
    distance_shift_m: float | None = field(default=None, metadata={"lower": 0.0, "omit": True})
    stretch_m: float | None = field(default=None, metadata={"positive": True, "omit": True})

    @classmethod
    def of(cls, u: DistanceCoordinate) -> "FiledCoordinate":
        """A coordinate as the file has it."""
        kind: Any = TWO_GAPS if u.stretch_m is not None else INVERSE if u.inverse else PLAIN
        shift = u.distance_shift_m if kind == INVERSE else None
        return cls(
            coordinate=kind, reference_distance_m=u.reference_distance_m, distance_shift_m=shift, stretch_m=u.stretch_m
        )

    @property
    def value(self) -> DistanceCoordinate:
        """The coordinate itself."""
        if self.coordinate == TWO_GAPS:
            return DistanceCoordinate(self.reference_distance_m, inverse=False, stretch_m=self.stretch_m)
        return DistanceCoordinate(self.reference_distance_m, self.distance_shift_m or 0.0, self.coordinate == INVERSE)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Numbers that this kind of coordinate cannot have."""
        if self.coordinate != TWO_GAPS and self.reference_distance_m < _LEAST_M:
            yield "reference_distance_m", f"a finite number > 0, of at least {_LEAST_M:g}"
        if self.coordinate == TWO_GAPS and self.stretch_m is None:
            yield "stretch_m", "a finite number > 0"
        if self.coordinate == PLAIN and self.distance_shift_m:
            yield "distance_shift_m", f"absent beside coordinate {PLAIN}"


FLAT: dict[str, Any] = {"flat": True, "form": FiledCoordinate}
"""How a model file has the coordinate of splines, beside their knots."""


@dataclass(frozen=True, eq=False)
class DistanceSplines:
    """f_k(d) = sum_a c_ak N_a(u(d)), the polynomials at the ends of the knots continued."""

    coordinate: DistanceCoordinate
    knots: FloatArray
    degree: int
    coefficients: FloatArray  # c, shape (functions N, entries)

    def expression(self, distance: Expression) -> list[SX]:
        """All entries at an expression's distance."""
        return cell_table(self, self._cells).at(self.coordinate.of(distance))

    def _cells(self) -> CellTable:
        return CellTable([cells_of(self.knots, self.degree)], self.coefficients)

    def derivatives(self, distance: FloatArray, *orders: int) -> list[FloatArray]:
        """Derivatives in d of all entries at distances (...), each (..., entries)."""
        distance = np.asarray(distance, dtype=np.float64)
        if orders not in self._known:
            with building():
                d = SX.sym("d")
                value, found = ca.vertcat(*self.expression(d)), []
                for _ in range(max(orders) + 1):
                    found.append(value)
                    value = ca.jacobian(value, d)
                self._known[orders] = GraphFunction([d], ca.vertcat(*(found[order] for order in orders)))
        values = self._known[orders](distance.reshape(1, -1)).T
        return [part.reshape(*distance.shape, -1) for part in np.split(values, len(orders), axis=1)]

    @cached_property
    def _known(self) -> dict[tuple[int, ...], GraphFunction]:
        return Memo()
