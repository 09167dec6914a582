"""What effects need to know of the readings of a bench table, the path of the current among it."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import Conditions, Nominal
from femfit.tables.measurement_order import STILL_CURRENT

_IN_ORDER = 0.75
"""Part of the current's steps that must agree with the branches where the rows stand in the order of measuring."""


def conditions_of(covariates: pd.DataFrame, nominal: Nominal) -> Conditions:
    """What effects need to know of every row.

    Parameters
    ----------
    covariates : DataFrame
        As in :class:`femfit.identify.readings.observations.Observations`.

    Returns
    -------
    Conditions
        A temperature that was not recorded is NaN.
    """
    cycle = covariates.groupby([covariates["run"], covariates["distance_m"]])["current_A"]
    return Conditions(
        nominal=nominal,
        branch=covariates["branch"].to_numpy(),
        coil_temperature_C=covariates["coil_temperature_C"].to_numpy(),
        magnet_temperature_C=covariates["magnet_temperature_C"].to_numpy(),
        time_s=covariates["order"].to_numpy(),
        elapsed=covariates["elapsed"].to_numpy(),
        current_turn_A=(cycle.transform("min").to_numpy(), cycle.transform("max").to_numpy()),
        recalled=_recalled(covariates, nominal),
    )


def _recalled(covariates: pd.DataFrame, nominal: Nominal) -> Mapping[str, FloatArray]:
    """What the effects recall of the order of measuring; nothing where the branches contradict it."""
    in_order = covariates.sort_values(["run", "order"], kind="stable")
    current, run = in_order["current_A"].to_numpy(), in_order["run"].to_numpy()
    begins = np.append(True, run[1:] != run[:-1])
    path, still = current.copy(), STILL_CURRENT * np.ptp(current)
    for k in np.flatnonzero(~begins):
        if abs(current[k] - path[k - 1]) <= still:
            path[k] = path[k - 1]
    step, branch = np.where(begins, 0.0, np.diff(path, prepend=path[0])), in_order["branch"].to_numpy()
    same_place = np.append(False, np.diff(in_order["distance_m"].to_numpy()) == 0.0)
    # A branch that changes while the current stands still contradicts the order, but for a turning point read twice
    told = same_place & (branch != 0.0) & ((step != 0.0) | np.append(False, branch[1:] != branch[:-1]))
    if not told.any() or np.mean(np.sign(step[told]) == branch[told]) < _IN_ORDER:
        return {}
    place = np.argsort(in_order.index.to_numpy())
    return {
        name: values[place]
        for effect in all_effects().values()
        if effect.memory is not None and effect.memory.recall is not None
        for name, values in effect.memory.recall(path, begins, nominal).items()
    }
