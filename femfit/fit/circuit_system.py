"""The co-energy of several circuits as one linear least squares: force, flux linkages and inductances together.

W' = sum of c_af N_a(u(d)) f(i), with splines N_a in a coordinate of the distance and functions f of all currents. Every
row counts relative to itself, so that a small force is met as well as a large one. What no row determines takes the
smoothest coefficients, by penalties far below the data's weight. The fit is a projection: one factorisation gives what
is missed at rows left out, too.

Rows of a sweep of several circuits, and the splines of the distance that fit them.

References
----------
P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89: difference penalties on the coefficients of B-splines.
R. D. Cook and S. Weisberg, Residuals and Influence in Regression (Chapman and Hall, 1982), section 2.2: cases left out.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from femfit.core.errors import FitError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.fit.coenergy_choice import distance_coordinates
from femfit.fit.constants import (
    CIRCUIT_CELLS,
    FEWEST_CURRENTS,
    HELD_OUT_TARGET,
    INDUCTANCE_SIGMA,
    NEARLY_BEST,
    SMALL_FLUX,
    SMOOTH_DISTANCE,
    SMOOTHNESS,
    TWO_GAPS,
    U_DEGREE,
)
from femfit.fit.rows import FitRows, rms
from femfit.fit.splines import clamped_knots, row_products
from femfit.model.bspline import basis_matrix
from femfit.model.coordinate import DistanceCoordinate


def flux_scale(rows: FitRows) -> FloatArray:
    """What an error of each flux linkage is a part of: its size, or a part of the circuit's largest; (rows, n)."""
    flux = np.abs(rows.linked)
    return np.asarray(np.maximum(flux, SMALL_FLUX * flux.max(axis=0)))


def require_currents(rows: FitRows, why: str) -> None:
    """Refuse two currents of a circuit whose iron bends: a quadratic form would meet both, however it bends."""
    few = [name for name, axis in zip(rows.names, rows.axes, strict=True) if len(axis) < FEWEST_CURRENTS]
    if few:
        raise FitError(
            f"{why}, and each circuit then needs {FEWEST_CURRENTS} currents or more to show how it bends; "
            f"{' and '.join(few)} {'has' if len(few) == 1 else 'have'} fewer. Sweep more of them, together with all of "
            "the others'."
        )


Along = tuple[DistanceCoordinate, FloatArray]
"""A coordinate of the distance, and the knots in it."""


def choose_along_distance(
    distances: FloatArray, held_out: Callable[[DistanceCoordinate, FloatArray], float]
) -> tuple[Along, float]:
    """The fewest cells below the target on distances left out, or the fewest that are nearly the best, and the error.

    Parameters
    ----------
    distances : array, shape (n,)
        Ascending, in m.
    held_out : callable
        Coordinate and knots -> rms error on distances left out.

    Raises
    ------
    FitError
        If there are fewer distances than one cell needs.
    """
    if len(distances) < U_DEGREE + 1:
        raise FitError(
            f"Several circuits need a sweep of at least {U_DEGREE + 1} distances; instead received {len(distances)}. "
            "Sweep more distances."
        )
    middle, width = float(distances[[0, -1]].mean()), float(np.ptp(distances))
    between = [DistanceCoordinate(middle, inverse=False, stretch_m=share * width) for share in TWO_GAPS]
    coordinates = [*distance_coordinates(distances), *between]
    scored: list[tuple[float, Along]] = []
    for cells in CIRCUIT_CELLS:
        if U_DEGREE + cells > len(distances):
            break
        alike: list[tuple[float, Along]] = []
        for coordinate in coordinates:
            ends = np.sort(coordinate.of(distances[[0, -1]]))
            knots = clamped_knots(np.linspace(ends[0], ends[1], cells + 1), U_DEGREE)
            alike.append((held_out(coordinate, knots), (coordinate, knots)))
        error, along = min(alike, key=lambda pair: pair[0])
        if error < HELD_OUT_TARGET:
            return along, error
        scored += sorted(alike, key=lambda pair: pair[0])
    least = min(error for error, _ in scored)
    error, along = next(pair for pair in scored if pair[0] <= NEARLY_BEST * least)
    return along, error


_UNDETERMINED = 1e-11
"""Numerical: what is left of a column beside those before it, or of its square beside rows left out, next to rounding.
"""


class CurrentFunctions(Protocol):
    """Functions of all currents."""

    @property
    def count(self) -> int:
        """How many there are."""

    @property
    def constant(self) -> bool:
        """Whether a constant in W', which no row determines, is among their sums."""

    def columns(self, currents: FloatArray, *circuits: int) -> FloatArray:
        """Each function at currents (rows, n), differentiated once along each circuit named; (rows, count)."""

    def roughness(self) -> FloatArray:
        """Which sums of their coefficients are penalised, (penalties, count)."""


@dataclass(frozen=True, eq=False)
class CircuitSolution:
    """The coefficients, and what they miss."""

    circuits: int  # Number n of them
    coordinate: DistanceCoordinate
    knots: FloatArray
    coefficients: FloatArray  # (functions of u, functions of the currents)
    missed: FloatArray  # (quantities, rows): force, flux linkages and inductances, each over its scale
    projection: FloatArray  # Orthonormal columns, (quantities, rows, unknowns)

    def left_out(self, out: BoolArray) -> FloatArray:
        """What a fit to the other rows misses at these, as ``missed``; infinite where they do not determine it."""
        missed, rows_out = self.missed[:, out], self.projection[:, out]
        rows_out = rows_out.reshape(-1, rows_out.shape[2])
        remainders, vectors = np.linalg.eigh(np.eye(len(rows_out)) - rows_out @ rows_out.T)
        if remainders[0] < _UNDETERMINED:
            return np.full(missed.shape, np.inf)
        return np.asarray(vectors @ ((vectors.T @ missed.ravel()) / remainders)).reshape(missed.shape)

    def left_out_in_turn(self, folds: Iterable[BoolArray]) -> float:
        """Rms of what is missed at rows left out, over its scale: the larger of force and each flux linkage."""
        errors = [self.left_out(out)[: 1 + self.circuits] for out in folds]
        return max(map(rms, np.concatenate(errors, axis=1))) if errors else np.inf


def solve_circuits(
    rows: FitRows, coordinate: DistanceCoordinate, knots: FloatArray, functions: CurrentFunctions
) -> CircuitSolution | None:
    """The least squares; None where the rows do not determine it."""
    u, slope, _ = coordinate.with_slopes(rows.distance)
    along = basis_matrix(u, knots, U_DEGREE)
    rising = -slope[:, None] * basis_matrix(u, knots, U_DEGREE, 1)
    n = len(rows.names)
    blocks = [row_products(rising, functions.columns(rows.circuit_currents)) / _divisor(rows.force_scale)[:, None]]
    data = [rows.force / _divisor(rows.force_scale)]
    for k, scale in enumerate(map(_divisor, flux_scale(rows).T)):
        blocks.append(row_products(along, functions.columns(rows.circuit_currents, k)) / scale[:, None])
        data.append(rows.linked[:, k] / scale)
    if rows.inductance is not None:
        self_inductance = _divisor(np.diagonal(rows.inductance, axis1=1, axis2=2))
        for j, k in combinations_with_replacement(range(n), 2):
            scale = INDUCTANCE_SIGMA * np.sqrt(self_inductance[:, j] * self_inductance[:, k])
            blocks.append(row_products(along, functions.columns(rows.circuit_currents, j, k)) / scale[:, None])
            data.append(rows.inductance[:, j, k] / scale)
    matrix, values = np.concatenate(blocks), np.concatenate(data)
    free = np.ones(matrix.shape[1], dtype=np.bool_)
    if functions.constant:
        free[0 if coordinate.inverse else -functions.count] = False
    penalties = _penalties(along.shape[1], functions, float(np.linalg.norm(matrix)))
    penalised = np.concatenate([matrix, *penalties])[:, free]
    norms = np.linalg.norm(penalised, axis=0)
    if len(penalised) < penalised.shape[1] or not np.all(norms > 0.0):
        return None
    orthonormal, triangle = np.linalg.qr(penalised / norms)
    if np.abs(np.diag(triangle)).min() < _UNDETERMINED:
        return None
    projection = orthonormal[: len(values)]
    coefficients = np.zeros(len(free))
    coefficients[free] = solve_triangular(triangle, projection.T @ values) / norms
    missed = (matrix @ coefficients - values).reshape(len(blocks), -1)
    return CircuitSolution(
        n,
        coordinate,
        knots,
        coefficients.reshape(-1, functions.count),
        missed,
        projection.reshape(*missed.shape, -1),
    )


def best_along_distance(rows: FitRows, functions: CurrentFunctions) -> Along:
    """The coordinate of the distance and the knots that miss least with each inner distance left out."""

    def held_out(coordinate: DistanceCoordinate, knots: FloatArray) -> float:
        solution = solve_circuits(rows, coordinate, knots, functions)
        if solution is None:
            return np.inf
        return solution.left_out_in_turn(rows.distance == d for d in rows.distances[1:-1])

    along, _ = choose_along_distance(rows.distances, held_out)
    return along


def _divisor(scale: FloatArray) -> FloatArray:
    return np.where(scale > 0.0, scale, 1.0)


def _penalties(count: int, functions: CurrentFunctions, size: float) -> Iterator[FloatArray]:
    """What the smoothest coefficients have none of, along the currents and along the distance."""
    bent = np.diff(np.eye(count), U_DEGREE, axis=0)
    for penalty, weight in (
        (np.kron(np.eye(count), functions.roughness()), SMOOTHNESS),
        (np.kron(bent, np.eye(functions.count)), SMOOTH_DISTANCE),
    ):
        if len(penalty):
            yield weight * size / np.linalg.norm(penalty) * penalty
