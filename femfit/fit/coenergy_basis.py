"""The B-splines that a co-energy is made of, and how many of them the sweep asks for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import FitError
from femfit.fit.rows import FitRows
from femfit.model.bspline import basis_matrix

U_DEGREE = 4
FEWEST_CURRENTS = 3
FEWEST_DISTANCES = U_DEGREE + 1
ROUNDS = 2
"""How often distance and current are searched in turn."""

RELATIVE_SIGMA = 1e-4
"""Rows are weighted for this error relative to the force's scale, or to the flux linkage's change over the distance."""

HELD_OUT_TARGET = 5e-5
"""The smallest basis whose held-out error is below this fraction is taken: below a good sweep's own error."""

SHIFTS = (0.0, 0.1, 0.3, 1.0, 3.0)
"""Shifts s of u = d_0 / (d + s) that are tried, as parts of the range of distances: none suits a magnet far from its
electromagnet, large ones a plunger or a pole with a long gap of its own, where d_0 / d would crowd the distances."""

NEARLY_BEST = 1.1
"""Where none reaches the target (noisy rows), the smallest within this factor of the least held-out error."""


@dataclass(frozen=True, eq=False)
class CoenergyBasis:
    """Degrees and knots of the spline.

    Parameters
    ----------
    reference_distance_m, distance_shift_m : float
        d_0 and s of u = d_0 / (d + s).
    u_knots, current_knots : array
        Clamped knot vectors.
    current_degree : int
        Polynomial degree in the current.
    """

    reference_distance_m: float
    distance_shift_m: float
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
        shifted = distance + self.distance_shift_m
        u = self.reference_distance_m / shifted
        in_i = basis_matrix(current, self.current_knots, self.current_degree, b)

        def in_u(k: int) -> FloatArray:
            return basis_matrix(u, self.u_knots, U_DEGREE, k)

        slope = (-u / shifted)[:, None]
        if a == 0:
            part = in_u(0)
        elif a == 1:
            part = slope * in_u(1)
        else:
            part = slope**2 * in_u(2) + (2.0 * u / shifted**2)[:, None] * in_u(1)
        return (part[:, :, None] * in_i[:, None, :]).reshape(len(u), -1)


def choose_basis(rows: FitRows) -> tuple[CoenergyBasis, float]:
    """The smallest basis below :data:`HELD_OUT_TARGET` on held-out rows, or else the smallest that is nearly the best.

    Distance and current are searched in turn, each with what was chosen for the other.

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
    check_grid(len(rows.currents), len(rows.distances), _fewest_distances(rows))
    in_distance, in_current = _distance_trials(rows), _current_trials(rows)
    folds = held_out_masks(rows)
    basis, error = CoenergyBasis(**in_distance[0], **in_current[0]), np.inf
    for trials in (in_distance, in_current) * ROUNDS:
        basis, error = _best([replace(basis, **trial) for trial in trials], rows, folds)
        if error < HELD_OUT_TARGET:
            break
    if not np.isfinite(error):
        raise FitError(
            "The rows do not determine a co-energy: too many currents are missing at too many distances. Sweep every "
            "current at every distance, or fit a law."
        )
    return basis, error


def _best(bases: Sequence[CoenergyBasis], rows: FitRows, folds: Sequence[BoolArray]) -> tuple[CoenergyBasis, float]:
    """The choice among bases, force and flux linkage apart: noise of the one must not hide what the other tells."""
    scored: list[tuple[FloatArray, CoenergyBasis]] = []
    for _, alike in groupby(sorted(bases, key=_size), key=_size):
        tried = [(_held_out_errors(basis, rows, folds), basis) for basis in alike]
        errors, basis = min(tried, key=lambda pair: float(np.max(pair[0])))
        if np.max(errors) < HELD_OUT_TARGET:
            return basis, float(np.max(errors))
        # A column that is good enough must not ask for more.
        scored += [(np.maximum(trial, HELD_OUT_TARGET), basis) for trial, basis in tried]
    best = np.min([errors for errors, _ in scored], axis=0)
    if not np.all(np.isfinite(best)):
        return scored[0][1], np.inf
    allowed = max(NEARLY_BEST, min(float(np.max(errors / best)) for errors, _ in scored))
    errors, basis = next(pair for pair in scored if np.max(pair[0] / best) <= allowed)
    return basis, float(np.max(errors))


def _size(basis: CoenergyBasis) -> int:
    return basis.shape[0] * basis.shape[1]


def check_grid(currents: int, distances: int, fewest_distances: int = FEWEST_DISTANCES) -> None:
    """Refuse a grid that is too small for any co-energy.

    Parameters
    ----------
    currents, distances : int
        How many there are.
    fewest_distances : int
        How many distances are needed; by default with flux linkages, as a sweep has them.

    Raises
    ------
    FitError
        If there are too few currents or distances.
    """
    if currents < FEWEST_CURRENTS or distances < fewest_distances:
        raise FitError(
            f"A co-energy needs at least {FEWEST_CURRENTS} currents and {fewest_distances} distances; instead received "
            f"{currents} currents and {distances} distances. Sweep more "
            + ("currents." if currents < FEWEST_CURRENTS else "distances, or fit a law.")
        )


def _fewest_distances(rows: FitRows, cells: int = 1) -> int:
    """Distances that so many cells need: flux linkage tells W' itself beside its slope, so that fewer will do."""
    return FEWEST_DISTANCES - 1 + cells + (2 if rows.flux_linkage is None else 0)


def _current_trials(rows: FitRows) -> list[dict[str, Any]]:
    """Knots and degree in the current: a held-out fold must leave more points than functions."""
    count = len(rows.currents)
    forms = [(2, 1)] if count >= FEWEST_CURRENTS else []
    forms += [(degree, n) for degree in (3, 4) for n in (1, 2, 3, 4, 6) if degree + n + 2 <= count]
    ends = float(rows.currents[0]), float(rows.currents[-1])
    return [
        {"current_knots": _clamped(np.linspace(*ends, n + 1), degree), "current_degree": degree} for degree, n in forms
    ]


def _distance_trials(rows: FitRows) -> list[dict[str, Any]]:
    """d_0, s and knots in u."""
    trials = []
    for part in SHIFTS:
        shift = part * float(np.ptp(rows.distances))
        d = rows.distances + shift
        for n in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20):
            if _fewest_distances(rows, n) > len(d):
                break
            # Breaks that follow the rows leave data in every cell, where uniform ones would not.
            even, following = np.linspace(d[0] / d[-1], 1.0, n + 1), d[0] / np.quantile(d, np.linspace(1.0, 0.0, n + 1))
            trials += [
                {"reference_distance_m": float(d[0]), "distance_shift_m": shift, "u_knots": _clamped(u, U_DEGREE)}
                for u in ((even,) if n == 1 else (even, following))
            ]
    return trials


def _clamped(breaks: FloatArray, degree: int) -> FloatArray:
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])


def _scales(rows: FitRows) -> list[FloatArray]:
    """What an error of each row is measured against: the force, and the flux linkage's change over the distance."""
    scales = [rows.force_scale]
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
