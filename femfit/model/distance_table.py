"""Smooth functions of the distance as polynomials, as finely cut as an error asks for.

On each cell stands the polynomial through the functions' values at Chebyshev's points, both ends among them, so that
neighbours meet. A cell is halved while the polynomial is off between those points; what is still off at the last is
left out.

References
----------
L. N. Trefethen, Approximation Theory and Approximation Practice (SIAM, 2013), chapters 2 and 8.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.model.coordinate import FEW, DistanceCoordinate

DEGREE, HALVINGS = 5, 7
"""Numerical: half a cell is off by 1/64 of the whole one."""

ERROR = 1e-9
"""Chosen: of the largest entry of its kind in a cell; far below what a model knows, and far above rounding."""

BEYOND = 0.25
"""Chosen: share of the knots' range that is tabulated beyond their ends, where polynomials are continued; a filter's
points lie there while it acquires."""

SAME = 1e-9
"""Numerical: share of the range within which two knots are one, rounded in two coordinates."""

_NONE, _ALL = np.zeros(0, dtype=np.int64), slice(None)


@dataclass(frozen=True, eq=False)
class DistanceTable:
    """Values (entries,) over the distance."""

    breaks: FloatArray  # Of the cells, in m
    cells: FloatArray  # Polynomials in the distance from a cell's first end, shape (cells, powers, entries)
    known: BoolArray  # Which cells are as good as was asked for, shape (cells,)

    def cell(self, distance: FloatArray) -> IntArray:
        """The cell of each distance (N,), and -1 of those that are not in the table."""
        return self._cell_after.take(self.breaks.searchsorted(distance, "right"))

    def in_order(self, distance: FloatArray) -> tuple[IntArray, IntArray | slice, IntArray]:
        """Places of distances (N,) beyond the table, those of the others as it takes them, and the cells of these."""
        cell = self.cell(distance)
        if len(cell) <= FEW and -1 not in cell.tolist():
            return _NONE, _ALL, cell
        order = np.argsort(cell.astype(np.int16), kind="stable")
        beyond, inside = np.split(order, [np.count_nonzero(cell < 0)])
        return beyond, inside, cell.take(inside)

    def values(self, distance: FloatArray, cell: IntArray) -> FloatArray:
        """Values at distances (N,) in their cells, shape (entries, N); of many points the cells come in order."""
        return self._sums(self._powers(distance, cell), cell)

    def slopes(self, distance: FloatArray, cell: IntArray) -> FloatArray:
        """Their derivatives in the distance."""
        powers = self._powers(distance, cell)
        powers[1:] = powers[:-1] * np.arange(1.0, DEGREE + 1.0)[:, None]
        powers[0] = 0.0
        return self._sums(powers, cell)

    @cached_property
    def _cell_after(self) -> IntArray:
        """The cell behind so many breaks."""
        return np.array([-1, *np.where(self.known, np.arange(len(self.known)), -1), -1])

    def _powers(self, distance: FloatArray, cell: IntArray) -> FloatArray:
        """Powers of the distances from the cells' first ends, shape (powers, N)."""
        result = np.empty((DEGREE + 1, len(cell)))
        result[0] = 1.0
        if len(cell) <= FEW:
            result[1:] = distance - self.breaks.take(cell)
            return np.multiply.accumulate(result, axis=0, out=result)
        np.subtract(distance, self.breaks.take(cell), out=result[1])
        for k in range(2, DEGREE + 1):
            np.multiply(result[k - 1], result[1], out=result[k])
        return result

    def _sums(self, powers: FloatArray, cell: IntArray) -> FloatArray:
        if len(cell) <= FEW:
            return np.asarray((powers.T[:, None] @ self.cells.take(cell, axis=0))[:, 0].T)
        result = np.empty((self.cells.shape[2], len(cell)))
        ends = np.flatnonzero(cell[1:] != cell[:-1]) + 1
        for first, last in zip([0, *ends.tolist()], [*ends.tolist(), len(cell)], strict=True):
            np.matmul(self.cells[cell[first]].T, powers[:, first:last], out=result[:, first:last])
        return result


def distance_table(
    function: Callable[[FloatArray], FloatArray],
    splines: Sequence[tuple[DistanceCoordinate, FloatArray]],
    kinds: Sequence[FloatArray],
) -> DistanceTable:
    """The table of a function of distances (N,) with values (N, entries), which NaN leaves out.

    Parameters
    ----------
    splines : sequence of (DistanceCoordinate, array)
        Coordinate and knots of each spline that the function is made of: it is smooth between them.
    kinds : sequence of array
        For each kind of entries, in their order, what an error of each of its entries counts.
    """
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
    between, powers = 0.5 * (nodes[1:] + nodes[:-1]), np.arange(DEGREE + 1)
    to_polynomial = np.linalg.inv(nodes[:, None] ** powers)
    breaks = _breaks(splines)
    ends, found = np.stack([breaks[:-1], breaks[1:]], axis=1), []
    for halving in range(HALVINGS + 1):
        width = np.diff(ends)
        points = ends[:, :1] + width * np.concatenate([nodes, between])
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            exact = function(points.ravel()).reshape(*points.shape, -1)
            cells = to_polynomial @ exact[:, : len(nodes)]
            good = _is_good(exact[:, len(nodes) :], (between[:, None] ** powers) @ cells, kinds)
        cells = cells / width[:, :, None] ** powers[:, None]
        done = np.flatnonzero(good | (halving == HALVINGS))
        found += [(*ends[k], cells[k], good[k]) for k in done]
        low, high = np.delete(ends, done, axis=0).T
        middle = 0.5 * (low + high)
        ends = np.concatenate([np.stack([low, middle], axis=1), np.stack([middle, high], axis=1)])
        if not len(ends):
            break
    found.sort(key=lambda one: float(one[0]))
    lows, highs, polynomials, known = zip(*found, strict=True)
    return DistanceTable(np.array([*lows, highs[-1]]), np.nan_to_num(np.stack(polynomials)), np.array(known))


def _breaks(splines: Sequence[tuple[DistanceCoordinate, FloatArray]]) -> FloatArray:
    breaks = np.unique(np.concatenate([coordinate.distance(np.unique(knots)) for coordinate, knots in splines]))
    low, high = breaks[[0, -1]]
    breaks = breaks[np.diff(breaks, prepend=-np.inf) > SAME * (high - low)]
    more = BEYOND * (high - low)
    before = max(low - more, 0.5 * low) if low > 0.0 else low - more  # no inverse distance beyond the face
    return np.array([before, *breaks, high + more])


def _is_good(exact: FloatArray, found: FloatArray, kinds: Sequence[FloatArray]) -> BoolArray:
    """Of values (cells, points, entries)."""
    good, first = np.ones(len(exact), dtype=np.bool_), 0
    for counts in kinds:
        part = slice(first, first + len(counts))
        largest = np.abs(exact[..., part] * counts).max(axis=(1, 2))
        good &= np.abs((found - exact)[..., part] * counts).max(axis=(1, 2)) <= ERROR * largest
        first += len(counts)
    return good
