"""The co-energy of several circuits as one linear least squares: force, flux linkages and inductances together.

W' = sum of c_af N_a(u(d)) f(i), with splines N_a in a coordinate of the distance and functions f of all currents. Every
row counts relative to itself, so that a small force is met as well as a large one. What no row determines takes the
smoothest coefficients, by penalties far below the data's weight. The fit is a projection: one factorisation gives what
is missed at rows left out, too.

References
----------
P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89: difference penalties on the coefficients of B-splines.
R. D. Cook and S. Weisberg, Residuals and Influence in Regression (Chapman and Hall, 1982), section 2.2: cases left out.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from femfit.core.arrays import BoolArray, FloatArray
from femfit.fit.circuit_rows import CircuitRows
from femfit.fit.constants import INDUCTANCE_SIGMA, SMOOTH_DISTANCE, SMOOTHNESS, U_DEGREE
from femfit.fit.rows import rms
from femfit.model.bspline import basis_matrix
from femfit.model.coordinate import DistanceCoordinate

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
        missed, part = self.missed[:, out], self.projection[:, out]
        part = part.reshape(-1, part.shape[2])
        left, vectors = np.linalg.eigh(np.eye(len(part)) - part @ part.T)
        if left[0] < _UNDETERMINED:
            return np.full(missed.shape, np.inf)
        return np.asarray(vectors @ ((vectors.T @ missed.ravel()) / left)).reshape(missed.shape)

    def left_out_in_turn(self, folds: Iterable[BoolArray]) -> float:
        """Rms of what is missed at rows left out, over its scale: the larger of force and each flux linkage."""
        errors = [self.left_out(out)[: 1 + self.circuits] for out in folds]
        return max(map(rms, np.concatenate(errors, axis=1))) if errors else np.inf


def solve_circuits(
    rows: CircuitRows, coordinate: DistanceCoordinate, knots: FloatArray, functions: CurrentFunctions
) -> CircuitSolution | None:
    """The least squares; None where the rows do not determine it."""
    u, slope, _ = coordinate.with_slopes(rows.distance)
    along, rising = basis_matrix(u, knots, U_DEGREE), -slope[:, None] * basis_matrix(u, knots, U_DEGREE, 1)

    def columns(first: FloatArray, scale: FloatArray, *circuits: int) -> FloatArray:
        products = first[:, :, None] * functions.columns(rows.currents, *circuits)[:, None, :]
        return np.asarray(products.reshape(len(u), -1) / np.where(scale > 0.0, scale, 1.0)[:, None])

    n, flux_scale = len(rows.names), rows.relative_flux_scale
    blocks = [columns(rising, rows.force_scale), *(columns(along, flux_scale[:, k], k) for k in range(n))]
    measured = np.concatenate([rows.force[None], rows.flux_linkage.T])
    data = measured / np.maximum(np.concatenate([rows.force_scale[None], flux_scale.T]), np.finfo(float).tiny)
    if rows.inductance is not None:
        # (L L^T)^-1 times the inductances is 1 where they are met: the least of them counts as much as the largest
        whitening = np.linalg.inv(np.linalg.cholesky(rows.inductance))
        each = {(j, k): columns(along, np.ones(len(u)), j, k) for j, k in combinations_with_replacement(range(n), 2)}
        for a, b in each:
            parts = (
                (whitening[:, a, j] * whitening[:, b, k])[:, None] * each[min(j, k), max(j, k)]
                for j, k in product(range(n), repeat=2)
            )
            blocks.append(sum(parts) / INDUCTANCE_SIGMA)
            data = np.concatenate([data, np.full((1, len(u)), float(a == b) / INDUCTANCE_SIGMA)])
    matrix, values = np.concatenate(blocks), data.ravel()
    free = np.ones(matrix.shape[1], dtype=np.bool_)
    if functions.constant:
        free[0 if coordinate.inverse else -functions.count] = False
    penalties = [
        np.kron(np.eye(along.shape[1]), functions.roughness()),
        np.kron(np.diff(np.eye(along.shape[1]), U_DEGREE, axis=0), np.eye(functions.count)),
    ]
    size = np.linalg.norm(matrix)
    stacked = [matrix[:, free]]
    for penalty, weight in zip(penalties, (SMOOTHNESS, SMOOTH_DISTANCE), strict=True):
        if len(penalty):
            stacked.append(weight * size / np.linalg.norm(penalty) * penalty[:, free])
    whole = np.concatenate(stacked)
    norms = np.linalg.norm(whole, axis=0)
    if len(whole) < whole.shape[1] or not np.all(norms > 0.0):
        return None
    orthonormal, triangle = np.linalg.qr(whole / norms)
    if np.abs(np.diag(triangle)).min() < _UNDETERMINED:
        return None
    projection = orthonormal[: len(values)]
    coefficients = np.zeros(len(free))
    coefficients[free] = solve_triangular(triangle, projection.T @ values) / norms
    missed = (matrix @ coefficients - values).reshape(len(blocks), -1)
    return CircuitSolution(
        len(rows.names),
        coordinate,
        knots,
        coefficients.reshape(-1, functions.count),
        missed,
        projection.reshape(*missed.shape, -1),
    )
