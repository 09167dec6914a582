"""The B-splines that a co-energy is made of, and how many of them the sweep asks for."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import FitError
from femfit.fit.rows import FitRows
from femfit.model.bspline import basis_matrix

U_DEGREE = 4
RELATIVE_SIGMA = 1e-4
"""Rows are weighted for this error relative to the force, or to the flux linkage's change over the distance ..."""

FLOOR = 0.01
"""... and to this fraction of the largest force at the same distance, where the force itself vanishes."""

HELD_OUT_TARGET = 5e-5
"""The smallest basis whose held-out error is below this fraction is taken: below a good sweep's own error."""

NEARLY_BEST = 1.1
"""Where none reaches the target (noisy rows), the smallest within this factor of the least held-out error."""


@dataclass(frozen=True, eq=False)
class CoenergyBasis:
    """Degrees and knots of the spline.

    Parameters
    ----------
    reference_distance_m : float
        d_0.
    u_knots, current_knots : array
        Clamped knot vectors.
    current_degree : int
        Polynomial degree in the current.
    """

    reference_distance_m: float
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
        u = self.reference_distance_m / distance
        in_i = basis_matrix(current, self.current_knots, self.current_degree, b)

        def in_u(k: int) -> FloatArray:
            return basis_matrix(u, self.u_knots, U_DEGREE, k)

        slope = (-u / distance)[:, None]
        if a == 0:
            part = in_u(0)
        elif a == 1:
            part = slope * in_u(1)
        else:
            part = slope**2 * in_u(2) + (2.0 * u / distance**2)[:, None] * in_u(1)
        return (part[:, :, None] * in_i[:, None, :]).reshape(len(u), -1)


def choose_basis(rows: FitRows) -> tuple[CoenergyBasis, float]:
    """The smallest basis below :data:`HELD_OUT_TARGET` on held-out rows, or else the smallest that is nearly the best.

    Force and flux linkage are judged apart, since noise of the one must not hide what the other still tells.

    Parameters
    ----------
    rows : FitRows
        Of the sweep.

    Returns
    -------
    tuple of CoenergyBasis and float
        The basis and its held-out error, as in :class:`femfit.fit.coenergy.CoenergyFit`.

    Raises
    ------
    FitError
        If there are too few currents or distances.
    """
    scored: list[tuple[FloatArray, CoenergyBasis]] = []
    folds = held_out_masks(rows)
    for basis in sorted(_candidate_bases(rows), key=lambda b: b.shape[0] * b.shape[1]):
        errors = _held_out_errors(basis, rows, folds)
        if np.max(errors) < HELD_OUT_TARGET:
            return basis, float(np.max(errors))
        # A column that is good enough must not ask for more.
        scored.append((np.maximum(errors, HELD_OUT_TARGET), basis))
    best = np.min([errors for errors, _ in scored], axis=0) if scored else np.array([np.inf])
    if not np.all(np.isfinite(best)):
        raise FitError(
            f"A co-energy needs at least 3 currents and {U_DEGREE + 3} distances; instead received "
            f"{len(rows.currents)} currents and {len(rows.distances)} distances. Sweep more, or fit a law."
        )
    allowed = max(NEARLY_BEST, min(float(np.max(errors / best)) for errors, _ in scored))
    errors, basis = next(pair for pair in scored if np.max(pair[0] / best) <= allowed)
    return basis, float(np.max(errors))


def _candidate_bases(rows: FitRows) -> list[CoenergyBasis]:
    start, end = float(rows.distances[0]), float(rows.distances[-1])
    low, high = float(rows.currents[0]), float(rows.currents[-1])
    # In each direction a held-out fold must leave more points than functions.
    in_current = [(2, 1)] if len(rows.currents) >= 3 else []
    in_current += [(k, n) for k in (3, 4) for n in (1, 2, 3, 4, 6) if k + n + 2 <= len(rows.currents)]
    cells = [n for n in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20) if U_DEGREE + n + 2 <= len(rows.distances)]
    breaks = [np.linspace(start / end, 1.0, n + 1) for n in cells]
    # Breaks that follow the rows leave data in every cell, where uniform ones would not (steep forces at small d).
    breaks += [start / np.quantile(rows.distances, np.linspace(1.0, 0.0, n + 1)) for n in cells if n > 1]
    return [
        CoenergyBasis(start, _clamped(u, U_DEGREE), _clamped(np.linspace(low, high, n + 1), degree), degree)
        for degree, n in in_current
        for u in breaks
    ]


def _clamped(breaks: FloatArray, degree: int) -> FloatArray:
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])


def _scales(rows: FitRows) -> list[FloatArray]:
    """What an error of each row is measured against: the force, and the flux linkage's change over the distance."""
    size = np.abs(rows.force)
    largest = np.array([np.max(size[rows.distance == d]) for d in rows.distances])
    floor = FLOOR * np.maximum(largest, 1e-6 * np.max(size))[np.searchsorted(rows.distances, rows.distance)]
    scales = [np.hypot(rows.force, floor)]
    if rows.flux_linkage is not None:
        flux = rows.flux_linkage
        change = float(np.median([np.ptp(flux[rows.current == i]) for i in rows.currents]))
        scales.append(np.full_like(flux, max(change, 1e-3 * float(np.max(np.abs(flux))))))
    return scales


def linear_system(basis: CoenergyBasis, rows: FitRows) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Force rows, then flux-linkage rows where the table has them.

    Parameters
    ----------
    basis : CoenergyBasis
        Of the spline.
    rows : FitRows
        Of the sweep.

    Returns
    -------
    tuple of matrix, data and sigma
        A, y and the standard deviations, N and Wb.
    """
    scales = _scales(rows)
    blocks = [-basis.columns(rows.distance, rows.current, (1, 0))]
    data, sigma = [rows.force], [np.hypot(rows.force_error, RELATIVE_SIGMA * scales[0])]
    if rows.flux_linkage is not None:
        blocks.append(basis.columns(rows.distance, rows.current, (0, 1)))
        data.append(rows.flux_linkage)
        sigma.append(RELATIVE_SIGMA * scales[1])
    return np.concatenate(blocks), np.concatenate(data), np.concatenate(sigma)


def determined(basis: CoenergyBasis, rows: FitRows) -> IntArray:
    """Indices of the coefficients that the data determine: the rest are the gauge and stay zero.

    Force and flux leave a constant open (one coefficient); force alone leaves any function of the current open (the
    whole first row, which is W' at the largest distance).

    Parameters
    ----------
    basis : CoenergyBasis
        Of the spline.
    rows : FitRows
        With or without flux linkage.

    Returns
    -------
    array of int
        Into the flat coefficients.
    """
    indices = np.arange(basis.shape[0] * basis.shape[1])
    return indices[1:] if rows.flux_linkage is not None else indices[basis.shape[1] :]


def _held_out_errors(basis: CoenergyBasis, rows: FitRows, folds: Sequence[BoolArray]) -> FloatArray:
    """Rms error of force and of flux linkage on rows left out, as a part of their scales.

    One factorisation serves all folds: leaving out the rows B turns their residual r_B into (1 - Q_B Q_B^T)^-1 r_B.
    """
    matrix, y, sigma = linear_system(basis, rows)
    channels = len(y) // len(rows.force)
    undetermined = np.full(channels, np.inf)
    weighted = matrix[:, determined(basis, rows)] / sigma[:, None]
    norms = np.linalg.norm(weighted, axis=0)
    if not np.all(norms > 0):
        return undetermined
    q_factor, triangle = np.linalg.qr(weighted / norms)
    if np.min(np.abs(np.diag(triangle))) < 1e-10:
        return undetermined
    target = y / sigma
    residual = target - q_factor @ (q_factor.T @ target)
    to_relative = sigma / np.concatenate(_scales(rows))
    squares = []
    for out in folds:
        removed = np.tile(out, channels)
        part = q_factor[removed]
        left = np.eye(part.shape[1]) - part.T @ part
        try:
            left_out = residual[removed] + part @ np.linalg.solve(left, part.T @ residual[removed])
        except np.linalg.LinAlgError:
            return undetermined
        squares.append((left_out * to_relative[removed]).reshape(channels, -1) ** 2)
    return np.asarray(np.sqrt(np.mean(np.concatenate(squares, axis=1), axis=1)))


def held_out_masks(rows: FitRows, folds: int = 4) -> list[BoolArray]:
    """Rows to leave out, fold by fold: every fourth distance, and single inner currents.

    The extremes of distance and current stay in, because beyond them a model extrapolates, which its validity box
    forbids.

    Parameters
    ----------
    rows : FitRows
        Of the sweep.
    folds : int
        Number of distance folds.

    Returns
    -------
    list of array of bool
        One mask a fold.
    """
    inner = rows.distances[1:-1]
    masks = [np.isin(rows.distance, inner[k::folds]) for k in range(min(folds, len(inner)))]
    if len(rows.currents) > 3:
        masks.extend(rows.current == i for i in rows.currents[1:-1])
    return masks
