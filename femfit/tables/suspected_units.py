"""Numbers that no actuator has: the usual sign of a unit that was not named.

The largest values are conventional: 0.5 m, because no reluctance or magnet actuator works over more; 3 T, above iron's
saturation; the others far above what benches record.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.finding import Finding
from femfit.tables.units import UNITS, column_unit

LEAST_TRAVEL_M = 5e-5
"""Assumed: the distances of an imported table go further; smaller ones were taken for another unit."""

_KELVIN = (200.0, 400.0)
"""Assumed: temperatures between these are more likely kelvins than degrees."""

_LARGEST_STEP_S = 0.5
"""Assumed: a usual step of a record's clock above it is more likely milliseconds."""

_LEAST_SHARE = 0.05
"""Assumed: part of the model's largest distance or current that a converted column must reach: zero always fits."""

LEAST_READINGS = 8
"""Assumed: fewer readings are no ground for a suspicion."""

OTHER_SIGN = "of the other sign"


class Limit(NamedTuple):
    """Median above which a column is suspected, size above which it is impossible, and units that it is often in.

    The first of these is the one that it is likelier in where it is too large.
    """

    usual: float
    possible: float
    units: tuple[str, ...]


LIMITS: dict[str, Limit] = {
    "distance_m": Limit(0.5, 0.5, ("mm", "cm", "um", "inch")),
    "current_A": Limit(1e2, 2e3, ("mA",)),
    "force_N": Limit(1e4, 1e5, ("mN", "uN", "kgf", "gf", "lbf", "ozf")),
    "flux_linkage_Wb": Limit(1e2, 1e2, ("mWb", "uWb", "Mx")),
    "inductance_H": Limit(1e2, 1e2, ("mH", "uH")),
    "hall_T": Limit(3.0, 3.0, ("mT",)),
    "hall_V": Limit(1e2, 1e3, ("mV",)),
    "voltage_V": Limit(1e3, 1e4, ("mV",)),
    "resistance_ohm": Limit(1e5, 1e6, ("mohm", "kohm")),
}


def common_factors(column: str) -> dict[str, float]:
    """Units that a column is often in without saying so, each with the factor to SI; nothing for one without."""
    return {unit: UNITS[column_unit(column)[1]][unit] for unit in LIMITS[column].units} if column in LIMITS else {}


def suspicion(column: str, unit: str, why: str, remedy: str = "") -> Finding:
    """Say that a column seems to be in another unit than its name says: what a reader must know before any number."""
    remedy = remedy or f"Name the unit in the header, or give --unit {column}={unit}."
    return Finding("suspected-unit", "warning", f"{column} seems to be in {unit}: {why}.", remedy, column=column)


def suspicion_of_rows(column: str, unit: str, rows: BoolArray, why: str) -> Finding:
    """Say that some rows of a column seem to be in another unit than the others."""
    text = f"{int(rows.sum())} of {len(rows)} rows of {column} seem to be in {unit}: {why}."
    remedy = "Convert these rows alone, or leave them out."
    return Finding("suspected-unit", "warning", text, remedy, size=float(rows.sum()), column=column)


def _apart(size: FloatArray, beyond: BoolArray, factor: float) -> bool:
    """Whether impossible sizes are a group of their own: half of a unit's factor or more away from the possible ones.

    Half on a scale of ratios; the sizes of one column in one unit have smaller steps.
    """
    within = size[~beyond & (size > 0.0)]
    if min(len(within), int(beyond.sum())) < LEAST_READINGS:
        return False
    return bool(size[beyond].min() > within.max() / np.sqrt(factor))


def suspected_by_size(rows: pd.DataFrame, *, solved: bool = False) -> list[Finding]:
    """Suspect the units of columns from the sizes of their numbers alone.

    In a table that was computed (``solved``) one impossible number is enough: it is no outlier.
    """
    findings = []
    for name in (str(name) for name in rows if name in LIMITS):
        size = np.abs(rows[name].to_numpy(dtype=np.float64))
        size, limit = size[np.isfinite(size)], LIMITS[name]
        unit, factor = next(iter(common_factors(name).items()))
        beyond = size > limit.usual
        if beyond.any() and _apart(size, beyond, factor):
            findings.append(suspicion_of_rows(name, unit, beyond, f"they are up to {size.max():.3g}"))
        elif len(size) and limit.usual < np.median(size) <= limit.usual / factor:
            findings.append(suspicion(name, unit, f"it is {np.median(size):.3g} in the median"))
        elif solved and len(size) and size.max() > limit.possible:
            findings.append(suspicion(name, unit, f"it goes up to {size.max():.3g}"))
    for name in (name for name in ("coil_temperature_C", "magnet_temperature_C") if name in rows):
        temperature = rows[name].dropna()
        if len(temperature) and _KELVIN[0] < temperature.min() and temperature.max() < _KELVIN[1]:
            why = f"it lies between {temperature.min():.4g} and {temperature.max():.4g}"
            findings.append(suspicion(name, "K", why, "Subtract 273.15."))
    if "time_s" in rows:
        steps = np.abs(np.diff(rows["time_s"].to_numpy(dtype=np.float64)))
        steps = steps[np.isfinite(steps)]
        if len(steps) and float(np.median(steps)) > _LARGEST_STEP_S:
            findings.append(suspicion("time_s", "ms", f"its usual step is {np.median(steps):.4g}"))
    return findings


def suspected_by_range(name: str, values: FloatArray, low: float, high: float) -> Finding | None:
    """Suspect a setting that lies outside of a model's range, and inside once its unit or sign is taken for another."""
    slack, values = 0.05 * (high - low), values[np.isfinite(values)]
    factors = common_factors(name) | {OTHER_SIGN: -1.0}
    now = (values >= low - slack) & (values <= high + slack)
    for unit, factor in factors.items():
        converted = factor * values
        then = (converted >= low - slack) & (converted <= high + slack)
        few = now[~(now & then)].sum() < 0.2 * len(values)  # no current is none in any unit
        reaches = float(np.nanmax(np.abs(converted), initial=0.0)) >= _LEAST_SHARE * max(abs(low), abs(high))
        if reaches and few and (then & ~now).sum() >= LEAST_READINGS and then.mean() > 0.8:
            why = "few rows lie in the model's range, but then they would"
            return other_sign(why, name) if unit == OTHER_SIGN else suspicion(name, unit, why)
    return None


def other_sign(why: str, name: str = "current_A") -> Finding:
    """Say that a column, the current where none is named, seems to count the other way round."""
    convention = "" if name == "distance_m" else " (positive current attracts)"
    text = f"{name} seems to be {OTHER_SIGN}{convention}: {why}."
    return Finding("suspected-sign", "warning", text, "Convert the column.", column=name)
