"""Where a model may be compared with a bench."""

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.identify.readings.plausible import suspect_units
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import CoenergySpline
from femfit.tables.measurement import BenchTable

_REACH = 0.02
"""By how much of its width a validity box may be left: a stage's zero error at the border of the sweep."""


def within_reach(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> BoolArray:
    """Where a model may be compared with a bench: its validity box, a little beyond, and what is exact beyond.

    The co-energy of linear iron is a polynomial of second degree in the current, which holds at any current; there only
    the distances are limited.

    Parameters
    ----------
    distance, current : array, shape (n,)
        In m and A.

    Returns
    -------
    array of bool, shape (n,)
        False where either is not a number.
    """
    base = model.without_effects
    box, magnetics = base.validity, base.magnetics
    slack = _REACH * (box.distance_max_m - box.distance_min_m)
    inside = (distance >= box.distance_min_m - slack) & (distance <= box.distance_max_m + slack)
    linear = isinstance(magnetics, CoenergySpline) and (
        magnetics.spline.y_degree <= 2 and len(np.unique(magnetics.spline.y_knots)) == 2
    )
    if linear:
        return np.asarray(inside & np.isfinite(current))
    slack = _REACH * (box.current_max_A - box.current_min_A)
    return np.asarray(inside & (current >= box.current_min_A - slack) & (current <= box.current_max_A + slack))


def nothing_in_reach(model: ActuatorModel, table: BenchTable) -> str:
    """Say where the model holds, where the rows of a table outside of it are, and what their units may be."""
    box = model.without_effects.validity
    d, i = table.rows["distance_m"], table.rows["current_A"]
    where = (
        f"{table.source} must have rows within the model's box, {box.distance_min_m:g} to {box.distance_max_m:g} m and "
        f"{box.current_min_A:g} to {box.current_max_A:g} A; its distances are {d.min():g} to {d.max():g} m and its "
        f"currents {i.min():g} to {i.max():g} A."
    )
    suspected = suspect_units(model, table)
    remedy = [str(one) for one in suspected] or ["Convert the columns, or sweep and fit a wider range."]
    return " ".join([where, *remedy])
