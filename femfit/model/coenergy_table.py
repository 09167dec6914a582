"""The co-energy under effects as a table: what plant and filters ask for a million times is worked out once.

On every cell of a grid W'(d, i), and the field at the Hall element, are the polynomials of fifth order in d and in i
that have the exact values and derivatives up to the second in both at the four corners. Force, flux linkage, motional
constant and inductance are continuous and are derivatives of the one W', as without the table, so that reciprocity
holds to rounding. Where the polynomials do not agree with the effects (a stop that is touched and a sharp knee have
kinks), and beyond the grid, the effects themselves are evaluated.

The co-energy of a base model as a Taylor series.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapter I: osculatory interpolation and its error.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import comb

import numpy as np

from femfit.core.errors import MissingPartError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.effects.conditions import Nominal
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.model.hall import HallField, OneCurrentField
from femfit.model.magnetics import Magnetics, OneCurrentMagnetics

_ORDER = 2
"""Highest derivative in each variable that the corners share."""

_DEGREE = 2 * _ORDER + 1

_GRID = (48, 24)
"""Cells in distance and in current."""

_TOLERANCE = {(1, 0): 1e-6, (0, 1): 1e-6, (2, 0): 1e-5, (1, 1): 1e-5, (0, 2): 1e-5}
"""Tolerance of derivatives (in d, in i) that motion and current use, over their largest magnitude at the
distance: a thousandth, and for the second ones a hundredth, of what a field solution is good for."""

_HALL_TOLERANCE = {(0, 0): 1e-6, (1, 0): 1e-5, (0, 1): 1e-5}

_CHECKED = (1.0 / 6.0, 0.5, 5.0 / 6.0)
"""Places in a cell, in each direction, where the tolerance must be met."""

_BEYOND = 0.2
"""Part of the domain's ranges by which the grid reaches beyond it: filters probe there."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """Polynomials sum_kl P[k, l] (d - d_0)^k (i - i_0)^l, in n x m cells with a border of cells that hold nothing."""

    # Edges in m and A; shape (n + 1,)
    distance: FloatArray
    current: FloatArray
    starts: tuple[FloatArray, FloatArray]
    polynomials: FloatArray  # P, of W' and of the Hall field; shape (n + 2, m + 2, 1 or 2, 6, 6)
    good: BoolArray

    def find(self, d: FloatArray, i: FloatArray) -> tuple[IntArray, IntArray]:
        """The cells of points."""
        return np.searchsorted(self.distance, d, side="right"), np.searchsorted(self.current, i, side="right")

    def series(self, cell: tuple[IntArray, IntArray], d: FloatArray, i: FloatArray, n_d: int, n_i: int) -> FloatArray:
        """Taylor coefficients at points in their cells, shape (1 or 2, n_d + 1, n_i + 1, n)."""
        left = _shifted(d - self.starts[0][cell[0]], n_d)[:, None]
        right = _shifted(i - self.starts[1][cell[1]], n_i)[:, None]
        return (left @ self.polynomials[cell] @ right.swapaxes(-1, -2)).transpose(1, 2, 3, 0)


@dataclass(frozen=True, eq=False)
class CoenergyTable:
    """A co-energy as a series, from a table; called as :data:`femfit.effects.taylor_series.CoenergySeries`."""

    exact: CoenergySeries  # The co-energy under effects that depend on distance and current alone
    nominal: Nominal
    hall: bool  # Whether the field at the Hall element is asked for

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A."""
        if max(in_distance, in_current) > _DEGREE:
            return self.exact(distance, current, in_distance, in_current)
        cells = self._cells
        cell = cells.find(distance, current)
        result = np.zeros((2, in_distance + 1, in_current + 1, len(distance)))
        result[: 1 + self.hall] = cells.series(cell, distance, current, in_distance, in_current)
        good = cells.good[cell]
        if not good.all():
            beyond = ~good
            result[..., beyond] = self.exact(distance[beyond], current[beyond], in_distance, in_current).coefficients
        return TaylorSeries(result)

    @cached_property
    def _cells(self) -> _Cells:
        at = self.nominal
        farther = _BEYOND * (at.distance_max_m - at.distance_min_m)
        more = _BEYOND * (at.current_max_A - at.current_min_A)
        d = np.linspace(at.distance_min_m - farther, at.distance_max_m + farther, _GRID[0] + 1)
        if at.distance_min_m > 0.0:  # it does not pass the face: denser towards it
            d = np.geomspace(at.distance_min_m / (1.0 + _BEYOND), at.distance_max_m + farther, _GRID[0] + 1)
        i = np.linspace(at.current_min_A - more, at.current_max_A + more, _GRID[1] + 1)
        points = [axis.ravel() for axis in np.meshgrid(d, i, indexing="ij")]
        series = self.exact(points[0], points[1], _ORDER, _ORDER).coefficients[: 1 + self.hall]
        polynomials = _osculating(series.reshape(*series.shape[:3], len(d), len(i)), np.diff(d), np.diff(i))
        border = ((1, 1), (1, 1))
        cells = _Cells(
            d,
            i,
            (np.pad(d, (1, 0)), np.pad(i, (1, 0))),
            np.pad(polynomials, (*border, *[(0, 0)] * 3)),
            np.zeros(0, bool),
        )
        return replace(cells, good=np.pad(self._agreement(cells), border))

    def _agreement(self, cells: _Cells) -> BoolArray:
        """In which cells the polynomials are the effects' co-energy, of the grid's shape."""
        d, i = (
            (edges[:-1, None] + np.diff(edges)[:, None] * _CHECKED).ravel() for edges in (cells.distance, cells.current)
        )
        points = [axis.ravel() for axis in np.meshgrid(d, i, indexing="ij")]
        found = cells.series(cells.find(points[0], points[1]), points[0], points[1], _ORDER, _ORDER)
        wanted = self.exact(points[0], points[1], _ORDER, _ORDER).coefficients
        good = np.ones((len(d), len(i)), dtype=np.bool_)
        for channel, tolerances in enumerate((_TOLERANCE, _HALL_TOLERANCE)[: 1 + self.hall]):
            for (a, b), tolerance in tolerances.items():
                x, y = (values[channel, a, b].reshape(good.shape) for values in (found, wanted))
                good &= np.abs(x - y) <= tolerance * np.abs(y).max(axis=1, keepdims=True)
        return np.asarray(good.reshape(_GRID[0], len(_CHECKED), _GRID[1], len(_CHECKED)).all(axis=(1, 3)))


def _osculating(series: FloatArray, lengths_d: FloatArray, lengths_i: FloatArray) -> FloatArray:
    """The cells' polynomials P (n, m, channels, 6, 6) from Taylor coefficients at the corners of n x m cells.

    ``series`` has the shape (channels, 3, 3, n + 1, m + 1); the cells' lengths are in m and A.
    """
    ends = np.concatenate([series[..., :-1, :], series[..., 1:, :]], axis=1)
    ends = np.concatenate([ends[..., :-1], ends[..., 1:]], axis=2)
    data = np.moveaxis(ends, (3, 4), (0, 1))
    left, right = _from_ends(lengths_d)[:, None, None], _from_ends(lengths_i)[:, None]
    return np.asarray(left @ data @ right.swapaxes(-1, -2))


_EXPONENTS = np.arange(_DEGREE + 1)
_BINOMIALS = np.array([[comb(k, a) for k in _EXPONENTS] for a in _EXPONENTS], dtype=np.float64)
_LEFT_OVER = np.maximum(_EXPONENTS - _EXPONENTS[:, None], 0)


def _shifted(step: FloatArray, order: int) -> FloatArray:
    """Matrices from a polynomial's coefficients to its Taylor coefficients at a step, shape (n, order + 1, 6).

    Entries C(k, a) step^(k - a).
    """
    powers = step[:, None] ** _EXPONENTS
    return powers[:, _LEFT_OVER[: order + 1]] * _BINOMIALS[: order + 1]


def _from_ends(lengths: FloatArray) -> FloatArray:
    """Matrices from the Taylor coefficients at both ends of a cell to its polynomial, shape (cells, 6, 6)."""
    ends = np.concatenate([*_shifted(np.array([0.0, 1.0]), _ORDER)])
    powers = lengths[:, None] ** _EXPONENTS
    orders = np.tile(powers[:, : _ORDER + 1], 2)
    return np.asarray(np.linalg.inv(ends) * orders[:, None, :] / powers[:, :, None])


KEPT = 64
"""Numerical: series that are kept; effects ask for one or two points a reading each."""


@dataclass(frozen=True, eq=False)
class RepeatedCoenergy:
    """A co-energy that gives again what it gave before: a fit changes one size of one effect at a time."""

    coenergy: CoenergySeries
    _known: dict[tuple[bytes, bytes, int, int], TaylorSeries] = field(default_factory=dict, init=False, repr=False)

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A, not to be written to."""
        key = (distance.tobytes(), current.tobytes(), in_distance, in_current)
        series = self._known.pop(key, None)
        if series is None:
            series = self.coenergy(distance, current, in_distance, in_current)
            series.coefficients.flags.writeable = False
            while len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
        self._known[key] = series  # the newest last
        return series


@dataclass(frozen=True, eq=False)
class ModelCoenergy:
    """Co-energy and Hall field of a model, called as :data:`femfit.effects.taylor_series.CoenergySeries`."""

    magnetics: Magnetics
    hall: HallField | None  # B at the Hall element; zero where None

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A."""
        orders = tuple((a, b) for a in range(in_distance + 1) for b in range(in_current + 1))
        if not isinstance(self.magnetics, OneCurrentMagnetics) or not isinstance(self.hall, OneCurrentField | None):
            raise MissingPartError(
                "This needs a co-energy of one current; instead the model has several circuits. Take a drawing with "
                "one circuit, for example both coils in series."
            )
        field = None if self.hall is None else self.hall.partials(distance, current, orders)
        result = np.zeros((2, in_distance + 1, in_current + 1, len(distance)))
        result[0] = taylor(self.magnetics.coenergy_derivatives(distance, current, orders), in_distance, in_current)
        if field is not None:
            result[1] = taylor(field, in_distance, in_current)
        return TaylorSeries(result)


def taylor(derivatives: Sequence[FloatArray], in_distance: int, in_current: int) -> FloatArray:
    """Taylor coefficients, shape (A + 1, B + 1, n), from derivatives of orders (0, 0), (0, 1), .. (A, B)."""
    factorials = np.cumprod(np.maximum(np.arange(max(in_distance, in_current) + 1.0), 1.0))
    both = factorials[: in_distance + 1, None] * factorials[: in_current + 1]
    return np.asarray(np.reshape(derivatives, (*both.shape, -1)) / both[..., None])
