"""The B-splines of a co-energy and their linear equations: a sweep's force, flux linkage and inductance.

F = -dW'/dd, flux linkage = dW'/di and inductance = d^2W'/di^2 are linear in the coefficients of W'. The inductance is
what identifies a winding that saturates between two currents: without it a spline through few currents misses the bend.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.fit.constants import (
    DISTANCE_FOLDS,
    FEWEST_CURRENTS,
    FREE_BEND,
    FREE_SLOPE,
    INDUCTANCE_SIGMA,
    JUDGED,
    RELATIVE_SIGMA,
    SCATTERED_FOLDS,
    SMOOTHED_DEGREE,
    U_DEGREE,
)
from femfit.fit.rows import FitRows
from femfit.fit.splines import row_products
from femfit.model.bspline import basis_matrix
from femfit.model.coordinate import DistanceCoordinate


@dataclass(frozen=True, eq=False)
class CoenergyBasis:
    """Degrees and knots of the spline."""

    coordinate: DistanceCoordinate
    u_knots: FloatArray
    current_knots: FloatArray
    current_degree: int

    @property
    def shape(self) -> tuple[int, int]:
        """Number of basis functions in u and in i."""
        return len(self.u_knots) - U_DEGREE - 1, len(self.current_knots) - self.current_degree - 1

    @property
    def cells(self) -> tuple[int, int]:
        """Number of polynomial cells in u and in i."""
        return len(np.unique(self.u_knots)) - 1, len(np.unique(self.current_knots)) - 1

    def columns(self, distance: FloatArray, current: FloatArray, order: tuple[int, int]) -> FloatArray:
        """d^(a+b) W' / dd^a di^b of each basis function, shape (n, functions); a up to 2."""
        a, b = order
        u, first, second = self.coordinate.with_slopes(distance)
        in_i = basis_matrix(current, self.current_knots, self.current_degree, b)

        def in_u(k: int) -> FloatArray:
            return basis_matrix(u, self.u_knots, U_DEGREE, k)

        slope = first[:, None]
        if a == 0:
            along_u = in_u(0)
        elif a == 1:
            along_u = slope * in_u(1)
        else:
            along_u = slope**2 * in_u(2) + second[:, None] * in_u(1)
        return row_products(along_u, in_i)

    def roughness(self) -> tuple[FloatArray, FloatArray]:
        """d^3W'/di^3, and d^4W'/du^3 di in u itself, of each basis function in every cell, shape (n, functions) each.

        In the middle of a cell in i, and at as many places of it in u as fix a polynomial there.
        """
        u, i = np.unique(self.u_knots), np.unique(self.current_knots)
        middles = 0.5 * (i[1:] + i[:-1])
        places = (u[:-1, None] + np.diff(u)[:, None] * (np.arange(U_DEGREE + 1.0) + 0.5) / (U_DEGREE + 1.0)).ravel()

        def at_each(in_u: int, in_i: int) -> FloatArray:
            along_u = basis_matrix(places, self.u_knots, U_DEGREE, in_u)
            along_i = basis_matrix(middles, self.current_knots, self.current_degree, in_i)
            return np.asarray(np.kron(np.linalg.qr(along_u, mode="r"), along_i), np.float64)

        return at_each(0, 3), at_each(3, 1)


@dataclass(frozen=True, eq=False)
class Channel:
    """Rows of one column, shape (m,) each."""

    order: tuple[int, int]  # Derivative of W' in d and i
    sign: float
    which: IntArray  # Rows of the table that have the column
    # Data, what their relative error is measured against, and their standard deviation
    value: FloatArray
    scale: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False)
class CoenergySystem:
    """All equations of a sweep."""

    rows: FitRows
    channels: tuple[Channel, ...]  # Force, then flux linkage and inductance where the table has them

    def equations(
        self, basis: CoenergyBasis, channels: Sequence[Channel] | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Matrix, data and standard deviations in N, Wb and H, as the table has them; of all channels by default.

        Where it has inductances, also zeros of the basis' roughness, with sigmas that only fill gaps.
        """
        channels = self.channels if channels is None else channels
        d, i = self.rows.distance, self.rows.current
        blocks = [c.sign * basis.columns(d[c.which], i[c.which], c.order) for c in channels]
        value, sigma = [c.value for c in channels], [c.sigma for c in channels]
        if self.rows.inductance is not None and basis.current_degree == SMOOTHED_DEGREE:
            largest = float(np.nanmax(np.abs(self.rows.inductance)))
            in_i, in_u = largest / float(np.ptp(i)), largest * float(np.ptp(i)) / float(np.ptp(basis.u_knots)) ** 3
            for rough, typical in zip(basis.roughness(), (FREE_SLOPE * in_i, FREE_BEND * in_u), strict=True):
                blocks.append(rough)
                value.append(np.zeros(len(rough)))
                sigma.append(np.full(len(rough), typical))
        return np.concatenate(blocks), np.concatenate(value), np.concatenate(sigma)

    def without_constraints(self, basis: CoenergyBasis, values: FloatArray) -> FloatArray:
        """Coefficients of W' or of small changes of it, from what the first channels have of it.

        Parameters
        ----------
        values : array, shape (channels, rows, k)
            Force, flux linkage and inductance, in N, Wb and H.

        Returns
        -------
        array, shape (functions, k)
        """
        channels = self.channels[: len(values)]
        matrix, value, sigma = self.equations(basis, channels)
        keep = determined(basis, self.rows)
        right = np.zeros((len(value), values.shape[2]))
        stacked = np.concatenate([column[c.which] for column, c in zip(values, channels, strict=True)])
        right[: len(stacked)] = stacked
        weighted = matrix[:, keep] / sigma[:, None]
        norms = np.linalg.norm(weighted, axis=0)
        result = np.zeros((matrix.shape[1], values.shape[2]))
        result[keep] = np.linalg.lstsq(weighted / norms, right / sigma[:, None], rcond=1e-12)[0] / norms[:, None]
        return result

    def held_out_errors(self, basis: CoenergyBasis) -> FloatArray:
        """Rms error of force and of flux linkage, as a part of their scales: on rows left out, or on all if larger.

        No outermost row is ever left out, and a saturating force is missed most where it is largest, at the least
        distance and the largest current.
        """
        judged = range(min(len(self.channels), JUDGED))
        errors = self._squared_errors(basis)
        if errors is None:
            return np.full(len(judged), np.inf)
        fitted, left_out, times = ([array[self._channel == k] for k in judged] for array in errors)
        return np.array(
            [np.sqrt(max(np.mean(a), np.sum(b) / np.sum(n))) for a, b, n in zip(fitted, left_out, times, strict=True)]
        )

    def left_out_force_errors(self, basis: CoenergyBasis) -> FloatArray:
        """Error of the force in N with each inner row predicted by the others; outermost rows as fitted; (rows,)."""
        errors = self._squared_errors(basis)
        if errors is None:
            return np.full(len(self.rows.force), np.inf)
        fitted, left_out, times = (array[: len(self.rows.force)] for array in errors)
        squares = np.where(times > 0, left_out / np.maximum(times, 1.0), fitted)
        return np.asarray(np.sqrt(squares) * self.channels[0].scale)

    def _squared_errors(self, basis: CoenergyBasis) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Squared errors of every row of the columns over its scale: as fitted, summed where left out, and how often.

        None if the rows do not determine the basis. One factorisation serves all folds: leaving out the rows B turns
        their residual r_B into (1 - Q_B Q_B^T)^-1 r_B.
        """
        matrix, value, sigma = self.equations(basis)
        weighted = matrix[:, determined(basis, self.rows)] / sigma[:, None]
        norms = np.linalg.norm(weighted, axis=0)
        if not np.all(norms > 0):
            return None
        q_factor, triangle = np.linalg.qr(weighted / norms)
        if len(triangle) < len(norms) or np.min(np.abs(np.diag(triangle))) < 1e-10:
            return None
        target = value / sigma
        residual = target - q_factor @ (q_factor.T @ target)
        left_out, times = np.zeros(len(self._channel)), np.zeros(len(self._channel))
        for which in self._folds:
            fold, errors = q_factor[which], residual[which]
            try:
                if len(which) < fold.shape[1]:
                    errors = np.linalg.solve(np.eye(len(which)) - fold @ fold.T, errors)
                else:
                    errors = errors + fold @ np.linalg.solve(np.eye(fold.shape[1]) - fold.T @ fold, fold.T @ errors)
            except np.linalg.LinAlgError:
                return None
            left_out[which] += errors**2
            times[which] += 1.0
        scale = np.concatenate([channel.sigma / channel.scale for channel in self.channels]) ** 2
        return residual[: len(left_out)] ** 2 * scale, left_out * scale, times

    @cached_property
    def _channel(self) -> IntArray:
        return np.repeat(np.arange(len(self.channels)), [len(channel.which) for channel in self.channels])

    @cached_property
    def _folds(self) -> list[IntArray]:
        row = np.concatenate([channel.which for channel in self.channels])
        return [np.flatnonzero(mask[row]) for mask in held_out_masks(self.rows)]


def coenergy_system(rows: FitRows) -> CoenergySystem:
    """The equations of a sweep, with or without flux linkage and inductance."""
    every, scale = np.arange(len(rows.force)), rows.force_scale
    channels = [Channel((1, 0), -1.0, every, rows.force, scale, np.hypot(rows.force_error, RELATIVE_SIGMA * scale))]
    slopes = (((0, 1), rows.flux_linkage, 1.0), ((0, 2), rows.inductance, INDUCTANCE_SIGMA))
    for order, values, weaker in slopes:
        if values is not None:
            column = values.reshape(-1)
            which = np.flatnonzero(np.isfinite(column))
            scale = np.full(len(which), _change_over_distance(rows.current[which], column[which]))
            channels.append(Channel(order, 1.0, which, column[which], scale, RELATIVE_SIGMA * weaker * scale))
    return CoenergySystem(rows, tuple(channels))


def _change_over_distance(current: FloatArray, values: FloatArray) -> float:
    """The median current's change over the distances; of a column that hardly changes, a thousandth of its largest."""
    change = float(np.median([np.ptp(values[current == i]) for i in np.unique(current)]))
    return max(change, 1e-3 * float(np.max(np.abs(values))))


def determined(basis: CoenergyBasis, rows: FitRows) -> IntArray:
    """Indices of the coefficients that the data determine: the others are the gauge and stay zero.

    Force and flux leave a constant open (one coefficient); force alone leaves any function of the current open (the
    whole row that is W' at the largest distance: the first of an inverse distance, the last of the distance itself).
    """
    indices = np.arange(basis.shape[0] * basis.shape[1])
    if rows.flux_linkage is not None:
        return indices[1:]
    return indices[basis.shape[1] :] if basis.coordinate.inverse else indices[: -basis.shape[1]]


def held_out_masks(rows: FitRows) -> list[BoolArray]:
    """Rows to leave out, fold by fold.

    The extremes of distance and current stay in, because beyond them a model extrapolates, which its validity domain
    forbids. Between them every fourth distance is left out, and each single current; where inductances stand beside
    the flux linkages, single rows scattered over the grid, whose neighbours in both directions stay: a bend that moves
    with the distance is narrower than what a whole distance or current would leave open.
    """
    distances, currents = rows.distances, rows.currents
    if rows.inductance is None or len(currents) <= FEWEST_CURRENTS:
        masks = [np.isin(rows.distance, distances[1:-1][k::DISTANCE_FOLDS]) for k in range(DISTANCE_FOLDS)]
        if len(currents) > FEWEST_CURRENTS:
            masks += [rows.current == i for i in currents[1:-1]]
    else:
        j, k = np.searchsorted(distances, rows.distance), np.searchsorted(currents, rows.current)
        inner = (j > 0) & (j < len(distances) - 1) & (k > 0) & (k < len(currents) - 1)
        masks = [inner & ((j + 2 * k) % SCATTERED_FOLDS == fold) for fold in range(SCATTERED_FOLDS)]
    return [mask for mask in masks if mask.any()]
