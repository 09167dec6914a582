"""The linear equations of splines: a sweep's forces, flux linkages and inductances, or one field, and what they miss.

F = -dW'/dd, flux linkage_k = dW'/di_k and inductance_jk = d^2W'/di_j di_k are linear in the coefficients of W'. The
inductance is what identifies a winding that saturates between two currents: without it a spline through few currents
misses the bend. What no row determines takes the smoothest coefficients, by rows far below the data's weight.

The fit is a projection: one factorisation gives what is missed at rows left out, too.

References
----------
P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89: difference penalties on the coefficients of B-splines.
R. D. Cook and S. Weisberg, Residuals and Influence in Regression (Chapman and Hall, 1982), section 2.2: cases left out.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import solve_triangular

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.fit import constants
from femfit.fit.basis import CoenergyBasis
from femfit.fit.rows import FitRows
from femfit.model.bspline import basis_matrix

_UNDETERMINED = 1e-11
"""Numerical: what is left of a column beside those before it, or of its square beside rows left out, next to rounding.
"""

Penalties = Iterable[tuple[FloatArray, float]]
"""Rows (k, functions) that are to be zero, and their standard deviation."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Rows of one quantity, a derivative of the splines; shape (m,) each."""

    circuits: tuple[int, ...]  # Along whose currents: of a flux linkage one, of an inductance two
    which: IntArray  # Rows of the table that have it
    # Data, what their relative error is measured against, and their standard deviation
    value: FloatArray
    scale: FloatArray
    sigma: FloatArray
    along: int = 0  # Order along the distance: 1 of the force, which is minus that slope


@dataclass(frozen=True, eq=False)
class Projection:
    """Least squares of weighted rows with columns of length one."""

    q_factor: FloatArray  # Orthonormal columns, (rows, unknowns)
    residual: FloatArray  # (rows,)
    coefficients: FloatArray  # Of all functions
    guarded: bool  # Whether rows left out may leave the others undetermined

    def left_out(self, which: IntArray) -> FloatArray:
        """The residual of rows by a fit to the others; infinite where these do not determine it.

        Leaving out the rows B turns their residual r_B into (1 - Q_B Q_B^T)^-1 r_B.
        """
        fold, errors = self.q_factor[which], self.residual[which]
        few = len(which) < fold.shape[1]
        remaining = np.eye(min(fold.shape)) - (fold @ fold.T if few else fold.T @ fold)
        try:
            if self.guarded and np.linalg.eigvalsh(remaining)[0] < _UNDETERMINED:
                return np.full(len(which), np.inf)
            if few:
                return np.asarray(np.linalg.solve(remaining, errors))
            return np.asarray(errors + fold @ np.linalg.solve(remaining, fold.T @ errors))
        except np.linalg.LinAlgError:
            return np.full(len(which), np.inf)


@dataclass(frozen=True, eq=False)
class CoenergySystem:
    """All equations of a sweep, or those of one field."""

    distance: FloatArray
    currents: FloatArray  # (rows, circuits)
    channels: tuple[Channel, ...]  # Force, then flux linkages and inductances where the table has them
    folds: Sequence[BoolArray]  # Rows to leave out, fold by fold
    # Of a basis and the rows over their standard deviations
    penalties: Callable[[CoenergyBasis, FloatArray], Penalties] | None = None
    # One circuit's grid: the rows left out never leave the others undetermined, and what is missed as fitted counts as
    # well, for no outermost row is ever left out, and a saturating force is missed most at the least distance and the
    # largest current
    grid: bool = False

    def equations(self, basis: CoenergyBasis) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Matrix, data and standard deviations, as the table has them."""
        blocks, value, sigma = [], [c.value for c in self.channels], [c.sigma for c in self.channels]
        for c in self.channels:
            columns = basis.columns(self.distance[c.which], self.currents[c.which], c.along, c.circuits)
            blocks.append(-columns if c.along else columns)
        if self.penalties is not None:
            weighted = np.concatenate(blocks) / np.concatenate(sigma)[:, None]
            for rough, typical in self.penalties(basis, weighted):
                blocks.append(rough)
                value.append(np.zeros(len(rough)))
                sigma.append(np.full(len(rough), typical))
        return np.concatenate(blocks), np.concatenate(value), np.concatenate(sigma)

    def projection(self, basis: CoenergyBasis) -> Projection | None:
        """The least squares without constraints; None if the rows do not determine them."""
        (matrix, value, sigma), unknown = self.equations(basis), self.determined(basis)
        weighted, target = matrix[:, unknown] / sigma[:, None], value / sigma
        norms = np.linalg.norm(weighted, axis=0)
        if len(weighted) < len(norms) or not np.all(norms > 0.0):
            return None
        q_factor, triangle = np.linalg.qr(weighted / norms)
        if np.min(np.abs(np.diag(triangle))) < _UNDETERMINED:
            return None
        data, coefficients = self._ends[-1], np.zeros(basis.size)
        coefficients[unknown] = solve_triangular(triangle, q_factor[:data].T @ target[:data]) / norms
        return Projection(q_factor, target - q_factor @ (q_factor.T @ target), coefficients, not self.grid)

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
        system = replace(self, channels=self.channels[: len(values)])
        (matrix, value, sigma), unknown = system.equations(basis), self.determined(basis)
        right = np.zeros((len(value), values.shape[2]))
        stacked = np.concatenate([column[c.which] for column, c in zip(values, system.channels, strict=True)])
        right[: len(stacked)] = stacked
        weighted = matrix[:, unknown] / sigma[:, None]
        norms = np.linalg.norm(weighted, axis=0)
        result = np.zeros((matrix.shape[1], values.shape[2]))
        result[unknown] = np.linalg.lstsq(weighted / norms, right / sigma[:, None], rcond=1e-12)[0] / norms[:, None]
        return result

    def determined(self, basis: CoenergyBasis) -> IntArray:
        """Indices of the coefficients that the rows determine: the others are the gauge and stay zero.

        Force and flux leave a constant open (one coefficient); force alone leaves any function of the current open: the
        whole row that is W' at the largest distance, the first of an inverse distance, the last of the distance itself.
        """
        indices = np.arange(basis.size)
        if not self.channels[0].along:  # the values themselves
            return indices
        farthest = indices.reshape(basis.shape)[0 if basis.coordinate.inverse else -1]
        return np.delete(indices, farthest if len(self.channels) == 1 else farthest[: basis.functions.constant])

    def held_out_errors(self, basis: CoenergyBasis) -> FloatArray:
        """Rms error of force and of each flux linkage on rows left out, as a part of their scales."""
        judged = sum(len(channel.circuits) < 2 for channel in self.channels)
        fitted, left_out, times = (np.split(rows, self._ends)[:judged] for rows in self._squared_errors(basis))
        if not self.folds:
            return np.full(judged, np.inf)
        squares = np.array([np.sum(b) / np.sum(n) for b, n in zip(left_out, times, strict=True)])
        return np.sqrt(np.fmax([np.mean(a) for a in fitted], squares) if self.grid else squares)

    def left_out_errors(self, basis: CoenergyBasis) -> list[FloatArray]:
        """Error of each channel, of rows that are left out predicted by the others, else as fitted; (rows,) each.

        Zero in rows of the table that lack the channel.
        """
        fitted, left_out, times = self._squared_errors(basis)
        squares = np.split(np.where(times > 0, left_out / np.maximum(times, 1.0), fitted), self._ends[:-1])
        errors = [np.zeros(len(self.distance)) for _ in self.channels]
        for column, of_channel, channel in zip(errors, squares, self.channels, strict=True):
            column[channel.which] = np.sqrt(of_channel) * channel.scale
        return errors

    def places(self, out: BoolArray) -> IntArray:
        """Which of all channels' rows are those of a mask of the table's."""
        return np.flatnonzero(out[np.concatenate([channel.which for channel in self.channels])])

    def _squared_errors(self, basis: CoenergyBasis) -> FloatArray:
        """Squared errors of every row of the columns over its scale: as fitted, summed where left out, and how often.

        Infinite if the rows do not determine the basis; shape (3, rows).
        """
        projection, count = self.projection(basis), self._ends[-1]
        if projection is None:
            return np.stack([np.full(count, np.inf), np.full(count, np.inf), np.ones(count)])
        left_out, times = np.zeros(count), np.zeros(count)
        for which in map(self.places, self.folds):
            left_out[which] += projection.left_out(which) ** 2
            times[which] += 1.0
        scale = np.concatenate([channel.sigma / channel.scale for channel in self.channels]) ** 2
        return np.stack([projection.residual[:count] ** 2 * scale, left_out * scale, times])

    @cached_property
    def _ends(self) -> IntArray:
        """Where the rows of each channel end among all channels'."""
        return np.cumsum([len(channel.which) for channel in self.channels])


def coenergy_system(rows: FitRows) -> CoenergySystem:
    """The equations of a sweep, with or without flux linkage and inductance; of several circuits each row's own scale.

    A small force of theirs is met as well as a large one.
    """
    scale = rows.force_scale
    sigma = _divisor(scale) if rows.several else np.hypot(rows.force_error, constants.RELATIVE_SIGMA * scale)
    every, circuits = np.arange(len(rows.force)), range(rows.circuit_currents.shape[1])
    channels = [Channel((), every, rows.force, sigma if rows.several else scale, sigma, along=1)]
    if rows.flux_linkage is not None:
        channels += [_channel(rows, (k,), rows.flux_linkage[:, k]) for k in circuits]
    if rows.inductance is not None:
        pairs = combinations_with_replacement(circuits, 2)
        channels += [_channel(rows, (j, k), rows.inductance[:, j, k]) for j, k in pairs]
    folds = [rows.distance == d for d in rows.distances[1:-1]] if rows.several else held_out_masks(rows)
    smooth = _smooth_tensor if rows.several else partial(_smooth_plane, rows) if rows.saturates else None
    return CoenergySystem(rows.distance, rows.circuit_currents, tuple(channels), folds, smooth, grid=not rows.several)


def _channel(rows: FitRows, circuits: tuple[int, ...], column: FloatArray) -> Channel:
    """A flux linkage, or an inductance, whose sigma is larger."""
    which = np.flatnonzero(np.isfinite(column))
    weaker = constants.INDUCTANCE_SIGMA if len(circuits) > 1 else 1.0
    if not rows.several:
        current, values = rows.current[which], column[which]
        change = float(np.median([np.ptp(values[current == i]) for i in np.unique(current)]))  # over the distances
        least = 1e-3 * float(np.max(np.abs(values)))  # of a column that hardly changes
        scale = np.full(len(which), max(change, least))
        return Channel(circuits, which, values, scale, constants.RELATIVE_SIGMA * weaker * scale)
    if rows.inductance is None or len(circuits) == 1:
        sigma = _divisor(np.maximum(np.abs(column), constants.SMALL_FLUX * np.abs(column).max()))
    else:
        first, second = (_divisor(rows.inductance[:, k, k]) for k in circuits)
        sigma = weaker * np.sqrt(first * second)
    return Channel(circuits, which, column, sigma, sigma)


def _divisor(scale: FloatArray) -> FloatArray:
    return np.where(scale > 0.0, scale, 1.0)


def _smooth_plane(rows: FitRows, basis: CoenergyBasis, _weighted: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """Of one circuit that saturates: d^3W'/di^3, and d^4W'/du^3 di in u itself, with sigmas that only fill gaps.

    In the middle of a cell in i, and at as many places of it in u as fix a polynomial there.
    """
    (knots,), (degree,) = basis.functions.knots, basis.functions.degrees
    if degree != constants.SMOOTHED_DEGREE:
        return
    u, i = np.unique(basis.u_knots), np.unique(knots)
    middles = 0.5 * (i[1:] + i[:-1])
    places = (
        u[:-1, None] + np.diff(u)[:, None] * (np.arange(constants.U_DEGREE + 1.0) + 0.5) / (constants.U_DEGREE + 1.0)
    ).ravel()
    largest, wide = float(np.abs(rows.inductances).max()), float(np.ptp(rows.current))
    slope, bend = largest / wide, largest * wide / float(np.ptp(basis.u_knots)) ** 3
    for in_u, in_i, typical in ((0, 3, constants.FREE_SLOPE * slope), (3, 1, constants.FREE_BEND * bend)):
        along_u = np.linalg.qr(basis_matrix(places, basis.u_knots, constants.U_DEGREE, in_u), mode="r")
        yield np.asarray(np.kron(along_u, basis_matrix(middles, knots, degree, in_i)), np.float64), typical


def _smooth_tensor(basis: CoenergyBasis, weighted: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """Of several circuits: what the smoothest coefficients have none of, along currents and distance."""
    size = float(np.linalg.norm(weighted))
    in_u, count = basis.shape
    rough = [(np.kron(np.diff(np.eye(in_u), constants.U_DEGREE, axis=0), np.eye(count)), constants.SMOOTH_DISTANCE)]
    if constants.U_DEGREE in basis.functions.degrees:  # a quadratic form leaves nothing open
        rough = [(np.kron(np.eye(in_u), basis.functions.roughness()), constants.SMOOTHNESS), *rough]
    for penalty, weight in rough:
        if len(penalty):
            yield weight * size / np.linalg.norm(penalty) * penalty, 1.0


def held_out_masks(rows: FitRows, ends: bool = False) -> list[BoolArray]:
    """Rows of one circuit to leave out, fold by fold.

    The extremes of distance and current stay in, because beyond them a model extrapolates, which its validity domain
    forbids. Between them every fourth distance is left out, and each single current. Where the iron saturates it is
    single rows scattered over the grid, whose neighbours in both directions stay: a bend that moves with the distance
    is narrower than what a whole distance or current would leave open. It is sharpest at the least distance:
    ``ends`` leaves out rows there, too, and at the largest, which lie between two currents.
    """
    distances, currents = rows.distances, rows.currents
    if not rows.saturates or len(currents) <= constants.FEWEST_CURRENTS:
        every = constants.DISTANCE_FOLDS
        masks = [np.isin(rows.distance, distances[1:-1][k::every]) for k in range(every)]
        if len(currents) > constants.FEWEST_CURRENTS:
            masks += [rows.current == i for i in currents[1:-1]]
    else:
        j, k = np.searchsorted(distances, rows.distance), np.searchsorted(currents, rows.current)
        inner = (k > 0) & (k < len(currents) - 1)
        if not ends:
            inner &= (j > 0) & (j < len(distances) - 1)
        masks = [inner & ((j + 2 * k) % constants.SCATTERED_FOLDS == fold) for fold in range(constants.SCATTERED_FOLDS)]
    return [mask for mask in masks if mask.any()]
