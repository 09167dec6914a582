r"""From what was solved at a distance to its rows of the table, with the force's error.

A linear actuator's distance is a polynomial in the current: F = F_0 + F_1 i + F_2 i^2, flux linkage = flux_0 + L i,
W' = W_0 + flux_0 i + L i^2 / 2, B = B_0 + B_1 i. A saturating one's is solved current by current.

No single body is always safe, so the force is also had from the reaction on the fixed parts and by virtual work
(:mod:`femfit.field.force`). The estimate is the larger of the change from one order lower, with its factor,
and of the disagreement of the three. With the fields' own stresses removed the bodies mostly differ by far less than
the orders do: what is left is the error of the magnetisation, which they share.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyval

from femfit.core.arrays import FloatArray

DISAGREEMENT = "force_disagreement_N"
"""How far reaction or virtual work are from the force: no column of the table, but part of its ``force_error_N``."""

ERROR_SAFETY = 3.0
"""Factor on the force's change between two polynomial orders. At re-entrant corners the error falls algebraically with
the order, by a factor q = 0.5..0.75 each time, so the true error is q / (1 - q) = 1..3 times the last change."""

BEYOND_CURVE = "beyond_bh_curve"
"""Not a column of the table; the sweep's manifest counts it."""


@dataclass(frozen=True, eq=False)
class DistanceSolution:
    """One distance: three coefficients of forces, two of flux linkage and Hall field, W_0; in N, Wb, T, J and A."""

    force: FloatArray
    # Change of the force from one polynomial order lower, where that was solved; shape (3,)
    force_change: FloatArray | None
    # The force by reaction and by virtual work (:class:`femfit.field.force.OtherForces`); shape (3,)
    reaction: FloatArray
    work: FloatArray
    flux_linkage: FloatArray
    coenergy: float
    hall: FloatArray | None
    self_force: FloatArray  # The stress of the moving part's own field, as subtracted from the force; shape (3,)


def superpose(currents: FloatArray, solution: DistanceSolution) -> dict[str, FloatArray]:
    """Table columns at n currents in A.

    The terms of the change between the orders add in magnitude, so that no cancellation flatters the error, which is
    absent where the change is unknown.
    """
    flux, inductance = solution.flux_linkage
    disagreement = np.maximum(
        *(np.abs(polyval(currents, solution.force - other)) for other in (solution.reaction, solution.work))
    )
    columns = {
        "force_N": polyval(currents, solution.force),
        DISAGREEMENT: disagreement,
        "flux_linkage_Wb": polyval(currents, [flux, inductance]),
        "inductance_H": np.full(len(currents), inductance),
        "coenergy_J": polyval(currents, [solution.coenergy, flux, 0.5 * inductance]),
    }
    if solution.force_change is not None:
        change = ERROR_SAFETY * polyval(np.abs(currents), np.abs(solution.force_change))
        columns["force_error_N"] = np.maximum(change, disagreement)
    if solution.hall is not None:
        columns["hall_T"] = polyval(currents, solution.hall)
    return columns


@dataclass(frozen=True, eq=False)
class PointSolution:
    """One current at one distance, in SI units.

    Parameters
    ----------
    force, reaction, work, coarse_force : float
        By the layer round the moving part, by the reaction on the fixed parts, by virtual work, and by the layer one
        order lower.
    self_force : float
        As subtracted from the force.
    beyond_curve : bool
        Whether a B-H curve had to be extrapolated.
    state : array, shape (unknowns,)
        Of the finer order.
    """

    force: float
    reaction: float
    work: float
    coarse_force: float
    self_force: float
    flux_linkage: float
    inductance: float
    coenergy: float
    hall: float | None
    beyond_curve: bool
    state: FloatArray


@dataclass(frozen=True)
class NonlinearPoint:
    """How a point was solved; it has no solution where the iteration did not converge."""

    iterations: int
    residual: float
    status: str
    solution: PointSolution | None


def table_rows(points: list[NonlinearPoint], currents: tuple[float, ...]) -> dict[str, list[Any]]:
    """Columns of the sweep table, one value a current; one that did not converge has its ``status`` and no field."""
    weakest = points[int(np.argmin(np.abs(currents)))].solution
    least_change = _least_change([point.solution for point in points if point.solution], weakest)
    rows = [_columns(point, least_change) for point in points]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name, False if name == BEYOND_CURVE else np.nan) for row in rows] for name in names}


def _least_change(solutions: list[PointSolution], weakest: PointSolution | None) -> Callable[[float], float]:
    """A lower bound on the force's change between the orders, for a force.

    At single currents the change passes through zero, so it counts at least with its mean relative to the force; and
    where the coil cancels the magnet's force, relative to that of the weakest current.
    """
    total = sum(abs(one.force) for one in solutions)
    share = sum(abs(one.force - one.coarse_force) for one in solutions) / total if total else 0.0
    floor = abs(weakest.force) if weakest else 0.0
    return lambda force: share * max(abs(force), floor)


def _disagreement(solution: PointSolution) -> float:
    """The disagreement of reaction and virtual work with the force, in N."""
    return max(abs(solution.force - other) for other in (solution.reaction, solution.work))


def _force_error(solution: PointSolution, least_change: Callable[[float], float]) -> float:
    """Estimated discretisation error in N."""
    change = max(abs(solution.force - solution.coarse_force), least_change(solution.force))
    return max(ERROR_SAFETY * change, _disagreement(solution))


def _columns(point: NonlinearPoint, least_change: Callable[[float], float]) -> dict[str, Any]:
    columns = {
        "newton_iterations": point.iterations,
        "newton_residual": point.residual,
        "status": point.status,
    }
    solution = point.solution
    if solution is None:
        return columns
    columns |= {
        "force_N": solution.force,
        "flux_linkage_Wb": solution.flux_linkage,
        "inductance_H": solution.inductance,
        "coenergy_J": solution.coenergy,
        "force_error_N": _force_error(solution, least_change),
        DISAGREEMENT: _disagreement(solution),
        BEYOND_CURVE: solution.beyond_curve,
    }
    return columns if solution.hall is None else columns | {"hall_T": solution.hall}
