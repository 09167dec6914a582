"""Magnitudes that no actuator has: the usual sign of a unit that was not named."""

from typing import Literal

import numpy as np
import pandas as pd

from femfit.core.finding import Finding
from femfit.tables.foreign.check_cells import rows_of
from femfit.tables.foreign.options import QUANTITIES, si_unit
from femfit.tables.suspected_units import LIMITS

_HINTS = {
    "distance": " or inches",
    "current": ", or ampere-turns (then give one over the number of turns as a number)",
    "force": " or grams",
    "inductance": " or microhenries",
    "hall": " or gauss",
}
_LARGEST_DISTANCE_AT_LEAST_M = 5e-5


def check_units(points: pd.DataFrame) -> list[Finding]:
    """Compare the largest magnitude of each column with what an actuator can have.

    Current and distance, on which all else depends, are errors; the others are warnings.
    """
    findings = []
    for quantity, column in QUANTITIES.items():
        if quantity not in points or column not in LIMITS:
            continue
        largest = float(np.nanmax(np.abs(points[quantity].to_numpy(dtype=float)), initial=0.0))
        limit, unit = LIMITS[column].possible, LIMITS[column].unit
        if largest > limit:
            severity: Literal["error", "warning"] = "error" if quantity in {"distance", "current"} else "warning"
            name = quantity.replace("_", " ")
            text = f"The {name} goes up to {largest:g} {si_unit(quantity)}, beyond {limit:g} {si_unit(quantity)}."
            option = f"--{quantity.replace('_', '-')}-unit {unit}"
            remedy = f"If the numbers are in {unit} give {option}{_HINTS.get(quantity, '')}."
            findings.append(Finding("units", severity, text, remedy, largest, column))
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
