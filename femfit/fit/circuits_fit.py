"""Several circuits: force and all flux linkages of a sweep fitted with one quadratic form in the currents.

Both are linear in the splines of M(d), so that one weighted least squares finds them together. How many cells the
splines take, and in which coordinate, is what distances left out ask for.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError
from femfit.fit.circuit_rows import CircuitRows, choose_along_distance
from femfit.fit.constants import (
    DISTANCE_FOLDS,
    NOT_QUADRATIC,
    POOR_CIRCUIT,
    U_DEGREE,
)
from femfit.fit.rows import rms
from femfit.fit.saturating_circuits import fit_saturating
from femfit.model.bspline import basis_matrix
from femfit.model.coenergy_matrix import CoenergyMatrix
from femfit.model.coenergy_tensor import CoenergyTensor
from femfit.model.coordinate import DistanceCoordinate


@dataclass(frozen=True, eq=False)
class CircuitsFit:
    """A fitted matrix and its errors."""

    magnetics: CoenergyMatrix | CoenergyTensor
    # Larger of force and flux linkage on distances, or points of a grid, left out, each over its rms
    held_out: float
    force_share: float
    flux_linkage_share: float

    def lines(self) -> list[str]:
        """What ``femfit fit`` prints of it."""
        names, saturates = ", ".join(self.magnetics.names), isinstance(self.magnetics, CoenergyTensor)
        form = "spline in the distance and" if saturates else "quadratic form in"
        what = "points" if saturates else "distances"
        text = f"{form} the currents of {names}"
        if not np.isfinite(self.held_out):
            return [f"{text}; the sweep has too few points to leave {what} out and see what the model misses there"]
        missed = f"misses force and flux linkages by {amount(self.held_out, '')} of their rms"
        return [f"{text}; with {what} left out it {missed}"]


@dataclass(frozen=True, eq=False)
class _Basis:
    coordinate: DistanceCoordinate
    knots: FloatArray

    @property
    def count(self) -> int:
        return len(self.knots) - U_DEGREE - 1

    def equations(self, rows: CircuitRows) -> tuple[FloatArray, FloatArray]:
        """Matrix and data of force and flux linkages, each over its rms; unknowns (functions, entries), flat."""
        n = rows.currents.shape[1]
        v = np.concatenate([np.ones((len(rows.distance), 1)), rows.currents], axis=1)
        a, b = np.triu_indices(n + 1)
        u, slope, _ = self.coordinate.with_slopes(rows.distance)
        value, rate = basis_matrix(u, self.knots, U_DEGREE), basis_matrix(u, self.knots, U_DEGREE, 1)
        square = np.where(a == b, 0.5, 1.0) * v[:, a] * v[:, b]
        force_scale = rms(rows.force)
        blocks = [-(slope[:, None] * rate)[:, :, None] * square[:, None, :] / force_scale]
        data = [rows.force / force_scale]
        for k in range(1, n + 1):
            # flux linkage_k = sum_b M_kb v_b
            factor = np.where(a == k, v[:, b], np.where(b == k, v[:, a], 0.0))
            blocks.append(value[:, :, None] * factor[:, None, :] / rows.flux_scale[k - 1])
            data.append(rows.flux_linkage[:, k - 1] / rows.flux_scale[k - 1])
        matrix = np.concatenate(blocks).reshape(len(blocks) * len(u), -1)
        return matrix, np.concatenate(data)


def fit_circuits(rows: CircuitRows) -> CircuitsFit:
    """Fit M(d), or where the iron saturates a spline in the distance and all currents.

    Raises
    ------
    FitError
        If the rows do not determine the co-energy, if force and flux linkages contradict each other, or if the
        inductances are not positive definite everywhere.
    """
    if _not_quadratic(rows) > NOT_QUADRATIC:
        return _judged(*fit_saturating(rows), rows)
    along, held_out = choose_along_distance(rows.distances, lambda *along: _held_out(_Basis(*along), rows))
    basis = _Basis(*along)
    coefficients = _solve(basis, rows, np.ones(len(rows.distance), dtype=np.bool_))
    if coefficients is None:
        raise FitError(
            f"The rows do not determine the inductances of {', '.join(rows.names)}. Sweep each circuit's current by "
            "itself and at least one point with each two together."
        )
    magnetics = CoenergyMatrix(rows.names, basis.coordinate, basis.knots, U_DEGREE, coefficients)
    _require_definite(magnetics, rows)
    return _judged(magnetics, held_out, rows)


def _judged(magnetics: CoenergyMatrix | CoenergyTensor, held_out: float, rows: CircuitRows) -> CircuitsFit:
    force = rms(magnetics.force(rows.distance, rows.currents) - rows.force) / rms(rows.force)
    flux = magnetics.flux_linkage(rows.distance, rows.currents) - rows.flux_linkage
    fit = CircuitsFit(magnetics, held_out, force, rows.worst_flux_share(flux))
    _require_agreement(fit)
    return fit


def _held_out(basis: _Basis, rows: CircuitRows) -> float:
    """Rms error over the rms, the larger of force and flux linkages, with inner distances left out in turn."""
    inner = rows.distances[1:-1]
    matrix, data = basis.equations(rows)
    errors = []
    for fold in range(min(DISTANCE_FOLDS, len(inner))):
        out = np.isin(rows.distance, inner[fold::DISTANCE_FOLDS])
        found = _solve(basis, rows, ~out)
        if found is None:
            return np.inf
        which = np.tile(out, 1 + rows.currents.shape[1])
        errors.append((matrix[which] @ found.ravel() - data[which]).reshape(-1, int(out.sum())))
    joined = np.concatenate(errors, axis=1)
    return max(map(rms, joined))


def _solve(basis: _Basis, rows: CircuitRows, kept: BoolArray) -> FloatArray | None:
    """Coefficients (functions, entries); None where the rows do not determine them. M_00 is zero at the far end."""
    matrix, data = basis.equations(rows)
    which = np.tile(kept, 1 + rows.currents.shape[1])
    entries = matrix.shape[1] // basis.count
    gauge = 0 if basis.coordinate.inverse else (basis.count - 1) * entries
    free = np.arange(matrix.shape[1]) != gauge
    part = matrix[which][:, free]
    scale = np.linalg.norm(part, axis=0)
    if len(part) < part.shape[1] or not np.all(scale > 0.0):
        return None
    found, _, rank, _ = np.linalg.lstsq(part / scale, data[which], rcond=1e-11)
    if rank < part.shape[1]:
        return None
    coefficients = np.zeros(matrix.shape[1])
    coefficients[free] = found / scale
    return coefficients.reshape(basis.count, entries)


def _not_quadratic(rows: CircuitRows) -> float:
    """What the best quadratic form in the currents misses at each distance by itself, over the rms; the worst share."""
    v = np.concatenate([np.ones((len(rows.distance), 1)), rows.currents], axis=1)
    a, b = np.triu_indices(v.shape[1])
    shares = []
    for columns, values in ((v[:, a] * v[:, b], rows.force[:, None]), (v, rows.flux_linkage)):
        left = np.zeros_like(values)
        for d in rows.distances:
            at = rows.distance == d
            left[at] = columns[at] @ np.linalg.lstsq(columns[at], values[at], rcond=None)[0] - values[at]
        shares.append(np.sqrt(np.mean(left**2, axis=0) / np.mean(values**2, axis=0)))
    return float(np.max(np.concatenate(shares)))


def _require_agreement(fit: CircuitsFit) -> None:
    """Refuse a force and flux linkages that no one co-energy has."""
    worst = max(fit.force_share, fit.flux_linkage_share)
    if worst > POOR_CIRCUIT and isinstance(fit.magnetics, CoenergyTensor):
        raise FitError(
            f"The iron saturates, and the co-energy misses force or flux linkages by {amount(worst, '')} of their rms: "
            "the grid is too coarse. Sweep more currents where the iron begins to saturate, then more distances."
        )
    if worst > POOR_CIRCUIT:
        raise FitError(
            f"No co-energy meets force and flux linkages together: the best one misses them by {amount(worst, '')} of "
            "their rms. Sweep more distances; if it stays, a sign or a unit of these columns is wrong."
        )


def _require_definite(magnetics: CoenergyMatrix, rows: CircuitRows) -> None:
    """Refuse inductances that would store a negative energy at some distance between the rows."""
    d = np.unique(np.concatenate([np.linspace(low, high, 8) for low, high in pairwise(rows.distances)]))
    least = np.linalg.eigvalsh(magnetics.matrix(d)[:, 1:, 1:])[:, 0]
    if not np.all(least > 0.0):
        raise FitError(
            f"The inductances of {', '.join(magnetics.names)} must be positive definite; at "
            f"{1e3 * d[np.argmin(least)]:.4g} mm their least eigenvalue is {amount(float(least.min()), 'H', 3)}. Sweep "
            "more distances, or check the signs of the flux linkages."
        )
