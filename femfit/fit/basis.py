"""The functions whose sum is a co-energy: splines in a coordinate of the distance, times functions of all currents.

W' = sum of c_af N_a(u(d)) f(i). The functions of the currents are products of one spline in each current, or, where no
iron saturates, products of two currents.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.fit.constants import ALONE, U_DEGREE
from femfit.model.bspline import DistanceCoordinate, basis_matrix


def clamped_knots(breaks: FloatArray, degree: int) -> FloatArray:
    """The knots of splines of a degree over ascending breaks, the outermost ones repeated."""
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])


def row_products(*factors: FloatArray) -> FloatArray:
    """Each product of one column of each factor at the same row, the last factor's columns fastest."""
    return reduce(lambda a, b: (a[:, :, None] * b[:, None, :]).reshape(len(a), -1), factors)


def misfit_by_currents(columns: FloatArray, values: FloatArray, distance: FloatArray) -> FloatArray:
    """What the best sum of columns, found at each distance by itself, leaves of values (rows,)."""
    residual = np.empty_like(values)
    for d in np.unique(distance):
        here = distance == d
        residual[here] = columns[here] @ np.linalg.lstsq(columns[here], values[here], rcond=None)[0] - values[here]
    return residual


@dataclass(frozen=True, eq=False)
class CurrentSplines:
    """Products of one spline in each current, or sums of them."""

    knots: tuple[FloatArray, ...]
    degrees: tuple[int, ...]
    sums: FloatArray | None = None  # Coefficients of the products in each sum, (products, count); None: of each alone
    constant: bool = True  # Whether a constant in W', which no row determines, is among them

    @property
    def shape(self) -> tuple[int, ...]:
        """Functions of each current."""
        return tuple(len(knots) - degree - 1 for knots, degree in zip(self.knots, self.degrees, strict=True))

    @property
    def cells(self) -> tuple[int, ...]:
        """Polynomial cells in each current."""
        return tuple(len(np.unique(knots)) - 1 for knots in self.knots)

    @property
    def count(self) -> int:
        """How many sums there are."""
        return int(np.prod(self.shape)) if self.sums is None else self.sums.shape[1]

    def columns(self, currents: FloatArray, *circuits: int) -> FloatArray:
        """Each function at currents (rows, n), differentiated once along each circuit named; (rows, count)."""
        axes = enumerate(zip(self.knots, self.degrees, strict=True))
        splines = [basis_matrix(currents[:, k], *axis, circuits.count(k)) for k, axis in axes]
        products = row_products(*splines) if splines else np.ones((len(currents), 1))
        return products if self.sums is None else products @ self.sums

    def table(self, coefficients: FloatArray) -> FloatArray:
        """Coefficients (functions of u, count) as those of the products, (functions of u, functions of i_1, ..)."""
        of_products = coefficients if self.sums is None else coefficients @ self.sums.T
        return np.asarray(of_products).reshape(-1, *self.shape)

    def roughness(self) -> FloatArray:
        """Sums of the coefficients that are penalised, (penalties, count).

        Mixed second differences along each two currents, and, far weaker, third ones along each by itself.
        """
        orders = [dict.fromkeys(pair, 2) for pair in combinations(range(len(self.knots)), 2)]
        orders += [{k: 3} for k in range(len(self.knots))]
        blocks = []
        for order in orders:
            parts = [_differences(knots, order.get(k, 0)) for k, knots in enumerate(self.knots)]
            weight = 1.0 if len(order) == 2 else ALONE
            blocks.append(weight * reduce(lambda a, b: np.asarray(np.kron(a, b)), parts))
        return np.concatenate(blocks) if self.sums is None else np.concatenate(blocks) @ self.sums


def _differences(knots: FloatArray, order: int) -> FloatArray:
    """Divided differences of a spline's coefficients, zero for polynomials of lower order, times the mean step.

    The coefficients stand at the means of U_DEGREE knots (Greville).
    """
    places = np.lib.stride_tricks.sliding_window_view(knots[1:-1], U_DEGREE).mean(axis=1)
    step, differences = np.ptp(places) / (len(places) - 1), np.eye(len(places))
    for k in range(1, order + 1):
        differences = np.diff(differences, axis=0) * (k * step / (places[k:] - places[:-k]))[:, None]
    return differences


def even_splines(knots: tuple[FloatArray, ...], degrees: tuple[int, ...]) -> CurrentSplines:
    """Without a magnet: the sums of products that are even, and 0 at 0."""
    each = CurrentSplines(knots, degrees)
    pairs = np.eye(each.count)[:, : (each.count - 1) // 2]  # those in the middle follow from W'(d, 0) = 0
    pairs = pairs + pairs[::-1]
    return replace(each, sums=pairs - each.columns(np.zeros((1, len(knots)))) @ pairs, constant=False)


def lines_by_current(ends: Sequence[FloatArray]) -> CurrentSplines:
    """1 and each current, between the lowest and the highest."""
    lines = CurrentSplines(tuple(np.repeat(pair, 2) for pair in ends), (1,) * len(ends))
    currents = np.meshgrid(*ends, indexing="ij")  # a line's coefficients are its values at the ends
    return replace(lines, sums=np.stack([np.ones(lines.shape), *currents], axis=-1).reshape(lines.count, -1))


def quadratic_form(largest: FloatArray, magnet: bool) -> CurrentSplines:
    """v_a v_b of v = (1, i_1, .., i_n), a <= b, half of the squares; those with 1 where there is a magnet alone.

    ``largest`` holds each current's largest size, (n,): between its negative and itself 1, i and i^2 have the
    coefficients (1, 1, 1), (-i, 0, i) and (i^2, -i^2, i^2) in splines of one cell.
    """
    a, b = np.triu_indices(len(largest) + 1)
    a, b = a[(a > 0) | magnet], b[(a > 0) | magnet]
    powers = [np.array([[1.0, 1.0, 1.0], [-i, 0.0, i], [i * i, -i * i, i * i]]) for i in largest]
    orders = [(a == k).astype(int) + (b == k) for k in range(1, len(largest) + 1)]
    of_each = [power[order] for power, order in zip(powers, orders, strict=True)]
    knots = tuple(np.repeat([-i, i], 3) for i in largest)
    sums = np.where(a == b, 0.5, 1.0) * row_products(*of_each).T
    return CurrentSplines(knots, (2,) * len(largest), sums, constant=magnet)


@dataclass(frozen=True, eq=False)
class CoenergyBasis:
    """Splines in a coordinate of the distance, times functions of the currents."""

    coordinate: DistanceCoordinate
    u_knots: FloatArray
    functions: CurrentSplines
    u_degree: int = U_DEGREE

    @property
    def shape(self) -> tuple[int, int]:
        """Number of basis functions in u and of the currents."""
        return len(self.u_knots) - self.u_degree - 1, self.functions.count

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.shape[0] * self.shape[1]

    @property
    def u_cells(self) -> int:
        """Number of polynomial cells in u."""
        return len(np.unique(self.u_knots)) - 1

    def columns(
        self, distance: FloatArray, currents: FloatArray, along: int = 0, circuits: Sequence[int] = ()
    ) -> FloatArray:
        """Each function at distances (rows,) and currents (rows, n), differentiated; (rows, functions).

        Parameters
        ----------
        along : int
            Order of the derivative along the distance, up to 2.
        circuits : sequence of int
            The circuits along whose currents it is differentiated, each once.
        """
        u, first, second = self.coordinate.with_slopes(distance)
        in_u = [basis_matrix(u, self.u_knots, self.u_degree, k) for k in range(min(along, 1), along + 1)]
        if along == 1:
            in_u[0] = first[:, None] * in_u[0]
        elif along == 2:
            in_u[0] = first[:, None] ** 2 * in_u[1] + second[:, None] * in_u[0]
        return row_products(in_u[0], self.functions.columns(currents, *circuits))
