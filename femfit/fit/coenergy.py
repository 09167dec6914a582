"""One co-energy W'(d, i) fitted to force and flux linkage together.

W' is a tensor B-spline in u = d_0 / d and i; F = -dW'/dd and flux linkage = dW'/di are linear in its coefficients,
so both columns of the sweep enter one bounded QP, and reciprocity holds exactly in the result.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import FitError
from femfit.fit.bounded_qp import Inequalities, QPSolution, solve_bounded_qp
from femfit.fit.rows import FitRows
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.magnetics import CoenergySpline

U_DEGREE = 4
RELATIVE_SIGMA = 1e-4
"""Rows are weighted for this error relative to their value ..."""

FLOOR = 0.003
"""... and to this fraction of the column's largest value, where the value itself vanishes."""

HELD_OUT_TARGET = 5e-5
"""The smallest basis whose held-out force error is below this fraction is taken: below a good sweep's own error."""

NEARLY_BEST = 1.1
"""Where none reaches the target (noisy rows), the smallest within this factor of the least held-out error."""

SHAPES: dict[str, str] = {
    "inductance": "inductance >= 0 (co-energy convex in the current)",
    "decreasing": "force does not grow with distance",
    "attracting": "force does not fall with current (k_m >= 0)",
}
"""Shape constraints by name."""


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


@dataclass(frozen=True, eq=False)
class CoenergyFit:
    """A fitted co-energy.

    Parameters
    ----------
    magnetics : CoenergySpline
        With W'(d_max, 0) = 0.
    basis : CoenergyBasis
        What held-out rows chose.
    held_out : float
        Force error of the chosen basis on held-out rows, rms over the larger of |F| and the floor.
    constraints : tuple of str
        Shape constraints in force.
    active : tuple of str
        Where they act: one sentence a place.
    qp : QPSolution
        The solved programme.
    """

    magnetics: CoenergySpline
    basis: CoenergyBasis
    held_out: float
    constraints: tuple[str, ...]
    active: tuple[str, ...]
    qp: QPSolution


def fit_coenergy(
    rows: FitRows, constraints: Sequence[str] | None = None, inductance_at_largest_distance: float = 0.0
) -> CoenergyFit:
    """Fit the co-energy.

    Parameters
    ----------
    rows : FitRows
        With or without flux linkage.
    constraints : sequence of str or None
        Names of :data:`SHAPES`; None: those that the raw data obey everywhere.
    inductance_at_largest_distance : float
        L_0 in H of a sweep without flux linkage, which the force leaves open; not used where flux linkage is given.

    Returns
    -------
    CoenergyFit
        The smallest basis that predicts held-out rows well enough.

    Raises
    ------
    FitError
        If the rows do not determine a co-energy.
    """
    names = tuple(obeyed_shapes(rows) if constraints is None else constraints)
    unknown = [name for name in names if name not in SHAPES]
    if unknown:
        raise FitError(f"Shape constraints must be among {', '.join(SHAPES)}; instead received {', '.join(unknown)}.")
    basis, held_out = choose_basis(rows)
    matrix, y, sigma = _system(basis, rows)
    keep = _determined(basis, rows)
    shape = _shape_inequalities(basis, rows, names, inductance_at_largest_distance)
    reduced = Inequalities(shape.matrix[:, keep], shape.right, shape.labels)
    qp = solve_bounded_qp(matrix[:, keep], y, sigma, inequalities=reduced if len(reduced.right) else None)
    coefficients = np.zeros(basis.shape[0] * basis.shape[1])
    coefficients[keep] = qp.x
    table = coefficients.reshape(basis.shape)
    if rows.flux_linkage is None and inductance_at_largest_distance:
        table = table + 0.5 * inductance_at_largest_distance * _square_of_current(basis)[None, :]
    return CoenergyFit(
        magnetics=_gauged(basis, table, rows),
        basis=basis,
        held_out=held_out,
        constraints=names,
        active=tuple(label for label, hit in zip(reduced.labels, qp.active_inequalities, strict=False) if hit),
        qp=qp,
    )


def choose_basis(rows: FitRows) -> tuple[CoenergyBasis, float]:
    """The smallest basis below :data:`HELD_OUT_TARGET` on held-out rows, or else the smallest that is nearly the best.

    Parameters
    ----------
    rows : FitRows
        Of the sweep.

    Returns
    -------
    tuple of CoenergyBasis and float
        The basis and its held-out error.
    """
    scored: list[tuple[float, CoenergyBasis]] = []
    folds = held_out_masks(rows)
    for basis in sorted(_candidate_bases(rows), key=lambda b: b.shape[0] * b.shape[1]):
        error = _held_out_error(basis, rows, folds)
        if error < HELD_OUT_TARGET:
            return basis, error
        scored.append((error, basis))
    if not scored:
        raise FitError(
            f"A co-energy needs at least 3 currents and {U_DEGREE + 3} distances; instead received "
            f"{len(rows.currents)} currents and {len(rows.distances)} distances. Sweep more, or fit a law."
        )
    best = min(error for error, _ in scored)
    error, basis = next(pair for pair in scored if pair[0] <= NEARLY_BEST * best)
    return basis, error


def _candidate_bases(rows: FitRows) -> list[CoenergyBasis]:
    start, end = float(rows.distances[0]), float(rows.distances[-1])
    low, high = float(rows.currents[0]), float(rows.currents[-1])
    bases = []
    for degree in (2, 3, 4):
        for current_cells in (1, 2, 3, 4, 6):
            # In each direction a held-out fold must leave more points than functions.
            if degree + current_cells > len(rows.currents) - (2 if current_cells + degree > 3 else 0):
                continue
            if current_cells > 1 and degree == 2:
                continue
            in_current = _clamped(np.linspace(low, high, current_cells + 1), degree)
            for cells in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20):
                if U_DEGREE + cells + 2 > len(rows.distances):
                    continue
                for spacing in (np.linspace, np.geomspace):
                    breaks = spacing(start / end, 1.0, cells + 1)
                    bases.append(CoenergyBasis(start, _clamped(breaks, U_DEGREE), in_current, degree))
    return bases


def _clamped(breaks: FloatArray, degree: int) -> FloatArray:
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])


def force_sigma(rows: FitRows) -> FloatArray:
    """Standard deviation for which force rows are weighted, N."""
    floor = FLOOR * float(np.max(np.abs(rows.force)))
    return np.hypot(rows.force_error, RELATIVE_SIGMA * np.hypot(rows.force, floor))


def _flux_sigma(rows: FitRows, flux: FloatArray) -> FloatArray:
    """Standard deviation for which flux rows are weighted, Wb: by their change over distance, where k_m is."""
    spread = [np.ptp(flux[rows.current == i]) for i in rows.currents]
    return np.full_like(flux, RELATIVE_SIGMA * max(float(np.median(spread)), 1e-3 * float(np.max(np.abs(flux)))))


def _system(basis: CoenergyBasis, rows: FitRows) -> tuple[FloatArray, FloatArray, FloatArray]:
    blocks = [-basis.columns(rows.distance, rows.current, (1, 0))]
    data, sigma = [rows.force], [force_sigma(rows)]
    if rows.flux_linkage is not None:
        blocks.append(basis.columns(rows.distance, rows.current, (0, 1)))
        data.append(rows.flux_linkage)
        sigma.append(_flux_sigma(rows, rows.flux_linkage))
    return np.concatenate(blocks), np.concatenate(data), np.concatenate(sigma)


def _determined(basis: CoenergyBasis, rows: FitRows) -> IntArray:
    """Indices of the coefficients that the data determine: the rest are the gauge and stay zero.

    Force and flux leave a constant open (one coefficient); force alone leaves any function of the current open (the
    whole first row, which is W' at the largest distance).
    """
    indices = np.arange(basis.shape[0] * basis.shape[1])
    return indices[1:] if rows.flux_linkage is not None else indices[basis.shape[1] :]


def _held_out_error(basis: CoenergyBasis, rows: FitRows, folds: Sequence[BoolArray]) -> float:
    """Rms force error, relative to the larger of |F| and the floor, on rows left out; infinite if undetermined.

    One factorisation serves all folds: leaving out the rows B turns their residual r_B into (1 - Q_B Q_B^T)^-1 r_B.
    """
    keep = _determined(basis, rows)
    matrix, y, sigma = _system(basis, rows)
    weighted = matrix[:, keep] / sigma[:, None]
    norms = np.linalg.norm(weighted, axis=0)
    if not np.all(norms > 0):
        return np.inf
    q_factor, triangle = np.linalg.qr(weighted / norms)
    if np.min(np.abs(np.diag(triangle))) < 1e-10:
        return np.inf
    target = y / sigma
    residual = target - q_factor @ (q_factor.T @ target)
    squares = []
    for out in folds:
        removed = np.tile(out, len(y) // len(out))
        part = q_factor[removed]
        inner = np.eye(part.shape[1]) - part.T @ part
        if np.linalg.cond(inner) > 1e12:
            return np.inf
        left_out = residual[removed] + part @ np.linalg.solve(inner, part.T @ residual[removed])
        squares.append((RELATIVE_SIGMA * left_out[: int(out.sum())]) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


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


def obeyed_shapes(rows: FitRows) -> list[str]:
    """The shape constraints that the raw data obey between all neighbouring rows.

    Parameters
    ----------
    rows : FitRows
        Of the sweep.

    Returns
    -------
    list of str
        Names of :data:`SHAPES`; ``inductance`` always, since a passive winding's co-energy is convex.
    """
    names = ["inductance"] if rows.flux_linkage is not None else []
    if all(np.all(np.diff(_along(rows, rows.current == i, rows.distance)) < 0) for i in rows.currents):
        names.append("decreasing")
    if all(np.all(np.diff(_along(rows, rows.distance == d, rows.current)) > 0) for d in rows.distances):
        names.append("attracting")
    return names


def _along(rows: FitRows, which: BoolArray, axis: FloatArray) -> FloatArray:
    return np.asarray(rows.force[which][np.argsort(axis[which])])


def _shape_inequalities(
    basis: CoenergyBasis, rows: FitRows, names: Sequence[str], open_inductance: float
) -> Inequalities:
    """The shapes at three points a cell, in each direction."""
    cells_u, cells_i = basis.cells
    u = np.linspace(basis.u_knots[0], basis.u_knots[-1], 3 * cells_u + 1)
    i = np.linspace(basis.current_knots[0], basis.current_knots[-1], 3 * cells_i + 1 if basis.current_degree > 2 else 3)
    grid_u, grid_i = (axis.ravel() for axis in np.meshgrid(u, i, indexing="ij"))
    d = basis.reference_distance_m / grid_u
    orders = {"inductance": (0, 2), "decreasing": (2, 0), "attracting": (1, 1)}
    signs = {"inductance": 1.0, "decreasing": 1.0, "attracting": -1.0}
    blocks, right, labels = [np.zeros((0, basis.shape[0] * basis.shape[1]))], [np.zeros(0)], []
    for name in names:
        blocks.append(signs[name] * basis.columns(d, grid_i, orders[name]))
        offset = open_inductance if name == "inductance" and rows.flux_linkage is None else 0.0
        right.append(np.full(len(d), -offset))
        labels += [f"{SHAPES[name]} at {1e3 * a:.4g} mm, {b:.4g} A" for a, b in zip(d, grid_i, strict=True)]
    return Inequalities(np.concatenate(blocks), np.concatenate(right), tuple(labels))


def _square_of_current(basis: CoenergyBasis) -> FloatArray:
    """Coefficients of i^2 in the current's B-splines (exact, their degree is at least 2)."""
    points = np.linspace(basis.current_knots[0], basis.current_knots[-1], 4 * basis.shape[1])
    columns = basis_matrix(points, basis.current_knots, basis.current_degree)
    return np.asarray(np.linalg.lstsq(columns, points**2, rcond=None)[0])


def _gauged(basis: CoenergyBasis, table: FloatArray, rows: FitRows) -> CoenergySpline:
    def spline(coefficients: FloatArray) -> CoenergySpline:
        inner = TensorSpline(basis.u_knots, basis.current_knots, U_DEGREE, basis.current_degree, coefficients)
        return CoenergySpline(basis.reference_distance_m, inner)

    origin = np.clip(0.0, rows.currents[0], rows.currents[-1])
    return spline(table - spline(table).coenergy(rows.distances[-1:], np.array([origin])))
