"""Several circuits whose iron saturates: one spline in the distance and all currents, fitted to a grid of points.

Force and flux linkages are linear in the spline's coefficients, so that one least squares finds them. In each current
the flux linkages take as many functions as there are swept currents, a cubic spline through them without knots of its
own at the ends. Products of functions that vanish at all swept currents are left open by such rows; a penalty on mixed
second differences of the coefficients, far below the data's weight, takes the smoothest. How many cells the distance
takes, and in which coordinate, is what distances left out ask for, one combination of currents beside the other.

References
----------
P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89: difference penalties on the coefficients of B-splines.
"""

from dataclasses import dataclass
from functools import reduce
from itertools import combinations

import numpy as np
from scipy.linalg import lstsq

from femfit.core.amount import amount
from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError
from femfit.fit.circuit_rows import Along, CircuitRows, choose_along_distance
from femfit.fit.constants import (
    DISTANCE_FOLDS,
    FEWER_FUNCTIONS,
    FEWEST_CURRENTS,
    LEAST_OF_GRID,
    LEFT_OUT_EVERY,
    MOST_UNKNOWNS,
    SMOOTHNESS,
    U_DEGREE,
)
from femfit.fit.rows import rms
from femfit.model.bspline import basis_matrix
from femfit.model.coenergy_tensor import CoenergyTensor
from femfit.model.coordinate import DistanceCoordinate


@dataclass(frozen=True, eq=False)
class _Basis:
    coordinate: DistanceCoordinate
    u_knots: FloatArray
    current_knots: tuple[FloatArray, ...]
    current_degrees: tuple[int, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Functions along each axis."""
        currents = zip(self.current_knots, self.current_degrees, strict=True)
        return len(self.u_knots) - U_DEGREE - 1, *(len(knots) - degree - 1 for knots, degree in currents)

    def equations(self, rows: CircuitRows) -> tuple[FloatArray, FloatArray]:
        """Matrix and data of the force and of each flux linkage, each over its rms."""
        u, slope, _ = self.coordinate.with_slopes(rows.distance)
        along = basis_matrix(u, self.u_knots, U_DEGREE), basis_matrix(u, self.u_knots, U_DEGREE, 1)
        axes = list(enumerate(zip(self.current_knots, self.current_degrees, strict=True)))

        def columns(first: FloatArray, risen: int | None) -> FloatArray:
            parts = [basis_matrix(rows.currents[:, k], *axis, int(k == risen)) for k, axis in axes]
            return reduce(lambda a, b: (a[:, :, None] * b[:, None, :]).reshape(len(a), -1), parts, first)

        force, flux = rms(rows.force), rows.flux_scale
        blocks = [columns(-slope[:, None] * along[1], None) / force]
        blocks += [columns(along[0], k) / flux[k] for k, _ in axes]
        return np.concatenate(blocks), np.concatenate([rows.force / force, (rows.flux_linkage / flux).T.ravel()])

    def penalty(self) -> FloatArray:
        """Mixed second differences of the coefficients along each two currents, as rows beside the equations'."""
        along = [np.eye(count) for count in self.shape]
        blocks: list[FloatArray] = []
        for pair in combinations(range(1, len(self.shape)), 2):
            parts = [np.diff(one, 2, axis=0) if k in pair else one for k, one in enumerate(along)]
            blocks.append(reduce(lambda a, b: np.asarray(np.kron(a, b)), parts))
        return np.concatenate(blocks)


def fit_saturating(rows: CircuitRows) -> tuple[CoenergyTensor, float]:
    """The spline, and its error on rows left out: the larger of force and flux linkages, each over its rms.

    Raises
    ------
    FitError
        If a circuit has fewer than three currents, the rows are no grid or do not determine the spline, or the
        inductances are not positive definite everywhere.
    """
    axes = [np.unique(column) for column in rows.currents.T]
    for name, axis in zip(rows.names, axes, strict=True):
        if len(axis) < FEWEST_CURRENTS:
            raise FitError(
                f"The iron saturates, and each circuit then needs {FEWEST_CURRENTS} currents or more; circuit {name!r} "
                f"has {len(axis)}. Sweep more of its currents, together with all of the others'."
            )
    points = len(rows.distances) * int(np.prod([len(axis) for axis in axes]))
    if len(rows.distance) < LEAST_OF_GRID * points:
        raise FitError(
            f"The iron saturates, and the rows are {len(rows.distance)} of the {points} points of their grid. Sweep "
            "every combination of the currents at every distance."
        )
    coordinate, knots = _along_distance(rows)
    bases = []
    for fewer in range(FEWER_FUNCTIONS):
        currents = [_current_knots(axis, fewer) for axis in axes]
        bases.append(_Basis(coordinate, knots, tuple(k for k, _ in currents), tuple(degree for _, degree in currents)))
    unknowns = int(np.prod(bases[0].shape))
    if unknowns > MOST_UNKNOWNS:
        raise FitError(
            f"The spline over the distance and {len(axes)} currents would have {unknowns} coefficients; femfit fits at "
            f"most {MOST_UNKNOWNS}. Sweep fewer currents or distances."
        )
    out = _inner(rows, axes)
    tried = [(_left_out(basis, rows, out), basis) for basis in bases]
    indefinite: list[str] = []
    for error, basis in sorted(tried, key=lambda pair: pair[0]):
        magnetics = _tensor(basis, _solve(basis, rows, np.ones(len(out), dtype=np.bool_)), rows)
        indefinite.append(_indefinite(magnetics, rows, axes))
        if not indefinite[-1]:
            return magnetics, error
    raise FitError(
        f"The inductances of {', '.join(rows.names)} must be positive definite; {indefinite[0]}. Sweep more currents, "
        "where the iron begins to saturate above all."
    )


def _left_out(basis: _Basis, rows: CircuitRows, out: BoolArray) -> float:
    return _error(_tensor(basis, _solve(basis, rows, ~out), rows), rows, out) if out.any() else np.inf


def _current_knots(currents: FloatArray, fewer: int) -> tuple[FloatArray, int]:
    """Knots and degree of one function more than there are currents, for the derivative loses one, less ``fewer``."""
    functions = max(len(currents) + 1 - fewer, FEWEST_CURRENTS)
    degree = min(U_DEGREE, functions - 1)
    inner = np.quantile(currents[1:-1], np.linspace(0.0, 1.0, functions - degree + 1)[1:-1])
    if not fewer and len(currents) > U_DEGREE:
        inner = currents[2:-2]
    return np.concatenate([np.repeat(currents[0], degree + 1), inner, np.repeat(currents[-1], degree + 1)]), degree


def _along_distance(rows: CircuitRows) -> Along:
    """Coordinate and knots of the distance, each combination of currents with coefficients of its own."""
    values = np.column_stack([rows.force / rms(rows.force), rows.flux_linkage / rows.flux_scale])
    order = np.lexsort((rows.distance, *rows.currents.T))
    _, starts, counts = np.unique(rows.currents[order], axis=0, return_index=True, return_counts=True)
    whole = [order[s : s + c] for s, c in zip(starts, counts, strict=True) if c == len(rows.distances)]
    if not whole:
        raise FitError(
            "The iron saturates, and no combination of currents was solved at every distance. Sweep again, so that the "
            "points that failed are tried once more."
        )
    curves = np.stack([values[rows_of] for rows_of in whole], axis=1)  # (distances, combinations, 1 + n)

    def held_out(coordinate: DistanceCoordinate, knots: FloatArray) -> float:
        return _curves_left_out(coordinate, knots, rows.distances, curves)

    return choose_along_distance(rows.distances, held_out)[0]


def _curves_left_out(
    coordinate: DistanceCoordinate, knots: FloatArray, distances: FloatArray, curves: FloatArray
) -> float:
    """Rms of force and flux linkages at distances left out, the larger; each curve is a spline of its own."""
    u, slope, _ = coordinate.with_slopes(distances)
    inner = np.arange(1, len(distances) - 1)
    errors = []
    for matrix, values in (
        (-slope[:, None] * basis_matrix(u, knots, U_DEGREE, 1), curves[:, :, 0]),
        (basis_matrix(u, knots, U_DEGREE), curves[:, :, 1:].reshape(len(distances), -1)),
    ):
        missed = []
        for fold in range(min(DISTANCE_FOLDS, len(inner))):
            out = np.isin(np.arange(len(distances)), inner[fold::DISTANCE_FOLDS])
            found = np.linalg.lstsq(matrix[~out], values[~out], rcond=1e-11)[0]
            missed.append(matrix[out] @ found - values[out])
        errors.append(rms(np.concatenate(missed)))
    return max(errors)


def _inner(rows: CircuitRows, axes: list[FloatArray]) -> BoolArray:
    """Every so many-th of the rows that lie within the grid on every axis."""
    within = (rows.distance > rows.distances[0]) & (rows.distance < rows.distances[-1])
    for column, axis in zip(rows.currents.T, axes, strict=True):
        within &= (column > axis[0]) & (column < axis[-1])
    out = np.zeros(len(within), dtype=np.bool_)
    out[np.flatnonzero(within)[::LEFT_OUT_EVERY]] = True
    return out


def _solve(basis: _Basis, rows: CircuitRows, kept: BoolArray) -> FloatArray:
    """Coefficients, flat; the first, a constant in W', is zero."""
    matrix, data = basis.equations(rows)
    which = np.tile(kept, 1 + rows.currents.shape[1])
    matrix, data, rough = matrix[which][:, 1:], data[which], basis.penalty()[:, 1:]
    weight = SMOOTHNESS * np.linalg.norm(matrix) / np.linalg.norm(rough)
    stacked, right = np.concatenate([matrix, weight * rough]), np.concatenate([data, np.zeros(len(rough))])
    found = lstsq(stacked, right, cond=1e-12, lapack_driver="gelsy")[0]
    return np.concatenate([[0.0], found])


def _tensor(basis: _Basis, coefficients: FloatArray, rows: CircuitRows) -> CoenergyTensor:
    """The model's magnetics, W' counted from zero current at the farthest distance."""

    def tensor(table: FloatArray) -> CoenergyTensor:
        knots, degrees = basis.current_knots, basis.current_degrees
        return CoenergyTensor(rows.names, basis.coordinate, basis.u_knots, U_DEGREE, knots, degrees, table)

    table = coefficients.reshape(basis.shape)
    origin = np.clip(np.zeros(len(rows.names)), rows.currents.min(axis=0), rows.currents.max(axis=0))
    return tensor(table - tensor(table).coenergy(rows.distances[-1], origin))


def _error(magnetics: CoenergyTensor, rows: CircuitRows, which: BoolArray) -> float:
    at = rows.distance[which], rows.currents[which]
    force = rms(magnetics.force(*at) - rows.force[which]) / rms(rows.force)
    return max(force, rows.worst_flux_share(magnetics.flux_linkage(*at) - rows.flux_linkage[which]))


def _indefinite(magnetics: CoenergyTensor, rows: CircuitRows, axes: list[FloatArray]) -> str:
    """Where between the rows the inductances are not positive definite; empty where they are everywhere."""
    fine = [np.unique(np.concatenate([axis, 0.5 * (axis[1:] + axis[:-1])])) for axis in (rows.distances, *axes)]
    distance, *along = (grid.ravel() for grid in np.meshgrid(*fine, indexing="ij"))
    currents = np.stack(along, axis=-1)
    least = np.linalg.eigvalsh(magnetics.inductance(distance, currents))[:, 0]
    worst = int(np.argmin(least))
    if least[worst] > 0.0:
        return ""
    where = ", ".join(f"{i:.4g} A" for i in currents[worst])
    value = amount(float(least[worst]), "H", 3)
    return f"at {1e3 * distance[worst]:.4g} mm and {where} their least eigenvalue is {value}"
