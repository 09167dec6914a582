"""Magnitudes that no actuator has: the usual sign of a unit that was not named."""

from typing import Literal

import numpy as np
import pandas as pd

from femfit.core.finding import Finding
from femfit.tables.foreign.check_cells import rows_of
from femfit.tables.foreign.quantities import QUANTITIES

# Largest plausible magnitude in SI and what the number usually is when it is larger. 0.5 m: no reluctance or magnet
# actuator works over more; 3 T: above iron's saturation.
_LARGEST: dict[str, tuple[float, str]] = {
    "distance": (0.5, "millimetres (--distance-unit mm) or inches"),
    "current": (2e3, "milliamperes (--current-unit mA) or ampere-turns (give --current-unit 1/turns as a number)"),
    "force": (1e5, "millinewtons (--force-unit mN) or grams"),
    "flux_linkage": (1e2, "milliwebers (--flux-linkage-unit mWb)"),
    "inductance": (1e2, "millihenries (--inductance-unit mH) or microhenries"),
    "hall": (3.0, "millitesla or gauss (--hall-unit mT, --hall-unit G)"),
}
_LARGEST_DISTANCE_AT_LEAST_M = 5e-5


def check_units(points: pd.DataFrame) -> list[Finding]:
    """Compare the largest magnitude of each column with what an actuator can have.

    Returns
    -------
    list of Finding
        ``units`` (error for current and distance, on which all else depends, warning for the others) and ``distance``
        (error: not all > 0).
    """
    findings = []
    for quantity, (limit, hint) in _LARGEST.items():
        if quantity not in points:
            continue
        largest = float(np.nanmax(np.abs(points[quantity].to_numpy(dtype=float)), initial=0.0))
        if largest > limit:
            severity: Literal["error", "warning"] = "error" if quantity in {"distance", "current"} else "warning"
            si_unit = QUANTITIES[quantity].si_unit
            findings.append(
                Finding(
                    "units",
                    severity,
                    f"The {quantity.replace('_', ' ')} goes up to {largest:g} {si_unit}, beyond {limit:g} {si_unit}.",
                    f"If the numbers are {hint}, say so.",
                    largest,
                )
            )
    distance = points["distance"].to_numpy(dtype=float)
    if 0 < float(np.max(distance)) < _LARGEST_DISTANCE_AT_LEAST_M:
        findings.append(
            Finding(
                "units",
                "error",
                f"The largest distance is {np.max(distance) * 1e6:g} micrometres.",
                "Name the unit of the numbers with --distance-unit.",
                float(np.max(distance)),
            )
        )
    if (distance <= 0).any():
        where = points[distance <= 0]
        findings.append(
            Finding(
                "distance",
                "error",
                f"Distances must be > 0 (from the electromagnet's face); they go down to {np.min(distance):g} m: "
                f"{rows_of(where)}.",
                "If the positions count towards the electromagnet give --flip-distance; if they start elsewhere give "
                "--distance-start-mm (distance of position zero).",
                float(np.min(distance)),
            )
        )
    return findings
