"""From a distance's coefficients to its rows: everything is a polynomial in the current.

F = F_0 + F_1 i + F_2 i^2, flux linkage = flux_0 + L i, W' = W_0 + flux_0 i + L i^2 / 2, B = B_0 + B_1 i.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray

ERROR_SAFETY = 3.0
"""Factor on the force's change between two polynomial orders. At re-entrant corners the error falls algebraically with
the order, by a factor q = 0.5..0.75 each time, so the true error is q / (1 - q) = 1..3 times the last change."""


def superpose(currents: FloatArray, result: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Table columns at currents.

    Parameters
    ----------
    currents : array, shape (n,)
        In A.
    result : mapping
        ``force`` and ``force_change`` (3), ``flux_linkage`` (2), ``coenergy`` (1), ``hall`` (2 or None).

    Returns
    -------
    dict of array, shape (n,)
        By column name. The error's terms add in magnitude, so that no cancellation flatters it.
    """
    flux, inductance = result["flux_linkage"]
    change = np.abs(result["force_change"])
    columns = {
        "force_N": _polynomial(currents, result["force"]),
        "flux_linkage_Wb": _polynomial(currents, [flux, inductance]),
        "inductance_H": np.full(len(currents), inductance),
        "coenergy_J": _polynomial(currents, [result["coenergy"], flux, 0.5 * inductance]),
        "force_error_N": ERROR_SAFETY * _polynomial(np.abs(currents), change),
    }
    if result["hall"] is not None:
        columns["hall_T"] = _polynomial(currents, result["hall"])
    return columns


def _polynomial(currents: FloatArray, coefficients: Any) -> FloatArray:
    return np.asarray(np.polynomial.polynomial.polyval(currents, np.asarray(coefficients, dtype=np.float64)))
