"""Whether a table's inductance is the slope of its flux linkage, as a co-energy's second derivative must be."""

import numpy as np

from femfit.core.arrays import FloatArray

TOLERANCE = 0.1
"""Part of the flux linkage's change over the currents that the integral of the inductance may miss: what the
trapezoidal rule loses at a bend between a few currents."""

STRAIGHT = 1e-3
"""An inductance that changes with the current by less than this part adds nothing to the flux linkage."""


def incremental_inductance(
    distance: FloatArray, current: FloatArray, flux_linkage: FloatArray, inductance: FloatArray | None
) -> FloatArray | None:
    """The inductance where it changes with the current and is the flux linkage's slope, not their quotient; else None.

    Programs give either d(flux linkage)/di or flux linkage / i under this name. Over each distance's currents, the
    integral of the former is the change of the flux linkage. NaN in rows without an inductance.
    """
    if inductance is None:
        return None
    slope_misses, quotient_misses, changes, bends = [], [], [], []
    for d in np.unique(distance):
        at = np.flatnonzero((distance == d) & np.isfinite(inductance))
        if len(at) < 2:
            continue
        at = at[np.argsort(current[at])]
        i, flux, slope = current[at], flux_linkage[at], inductance[at]
        change = np.diff(flux)
        slope_misses.append(np.sum(0.5 * (slope[1:] + slope[:-1]) * np.diff(i)) - np.sum(change))
        quotient_misses.append(np.max(np.abs(slope * i - flux)))
        changes.append(np.sum(np.abs(change)))
        bends.append(np.ptp(slope))
    if not bends or max(bends) < STRAIGHT * float(np.nanmax(np.abs(inductance))):
        return None
    slope_miss, quotient_miss = (
        float(np.linalg.norm(misses) / np.linalg.norm(changes)) for misses in (slope_misses, quotient_misses)
    )
    return inductance if slope_miss <= min(TOLERANCE, 0.5 * quotient_miss) else None
