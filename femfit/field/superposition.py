"""From a distance's coefficients to its rows: everything is a polynomial in the current.

F = F_0 + F_1 i + F_2 i^2, flux linkage = flux_0 + L i, W' = W_0 + flux_0 i + L i^2 / 2, B = B_0 + B_1 i.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray

DISAGREEMENT = "force_disagreement_N"
"""How far reaction or virtual work are from the force: no column of the table, but part of its ``force_error_N``."""

ERROR_SAFETY = 3.0
"""Factor on the force's change between two polynomial orders. At re-entrant corners the error falls algebraically with
the order, by a factor q = 0.5..0.75 each time, so the true error is q / (1 - q) = 1..3 times the last change."""


@dataclass(frozen=True)
class DistanceSolution:
    """The coefficients of one distance.

    Parameters
    ----------
    force : array, shape (3,)
        F_0 in N, F_1 in N/A, F_2 in N/A^2.
    force_change : array, shape (3,), or None
        Its change from one polynomial order lower, where that was solved.
    reaction, work : array, shape (3,)
        The force's coefficients by :class:`femfit.field.other_forces.OtherForces`.
    flux_linkage : array, shape (2,)
        In Wb and H.
    coenergy : float
        W_0 in J.
    hall : array, shape (2,) or None
        In T and T/A.
    self_force : array, shape (3,)
        The stress of the moving part's own field, as subtracted from the force.
    """

    force: FloatArray
    force_change: FloatArray | None
    reaction: FloatArray
    work: FloatArray
    flux_linkage: FloatArray
    coenergy: float
    hall: FloatArray | None
    self_force: FloatArray


def superpose(currents: FloatArray, solution: DistanceSolution) -> dict[str, FloatArray]:
    """Table columns at currents.

    Parameters
    ----------
    currents : array, shape (n,)
        In A.

    Returns
    -------
    dict of array, shape (n,)
        By column name. The error is the larger of the change between the orders and of the disagreement of the bodies;
        the change's terms add in magnitude, so that no cancellation flatters it. It is absent where the change is
        unknown.
    """
    flux, inductance = solution.flux_linkage
    disagreement = np.maximum(
        *(np.abs(_polynomial(currents, solution.force - other)) for other in (solution.reaction, solution.work))
    )
    columns = {
        "force_N": _polynomial(currents, solution.force),
        DISAGREEMENT: disagreement,
        "flux_linkage_Wb": _polynomial(currents, [flux, inductance]),
        "inductance_H": np.full(len(currents), inductance),
        "coenergy_J": _polynomial(currents, [solution.coenergy, flux, 0.5 * inductance]),
    }
    if solution.force_change is not None:
        change = ERROR_SAFETY * _polynomial(np.abs(currents), np.abs(solution.force_change))
        columns["force_error_N"] = np.maximum(change, disagreement)
    if solution.hall is not None:
        columns["hall_T"] = _polynomial(currents, solution.hall)
    return columns


def _polynomial(currents: FloatArray, coefficients: Any) -> FloatArray:
    return np.asarray(np.polynomial.polynomial.polyval(currents, np.asarray(coefficients, dtype=np.float64)))
