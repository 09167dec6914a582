"""Repeated settings: which readings are repeats of each other, and what scatter they show.

References
----------
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: lack of fit against pure error.
"""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray, IntArray
from femfit.identify.constants import LEAST_GAPS, NEAR_STEPS, SAME_LINE, SAME_READING, SAME_SETTING, WHOLE
from femfit.identify.readings.observations import Observations, once_for_settings


@once_for_settings
def repeat_cells(observations: Observations) -> IntArray:
    """A number for each setting that may have been repeated: one of ``setting_cells`` with one magnetic history.

    The history is the current at which the branch began. Readings of one channel with the same number are repeats.
    """
    keys = {"setting": setting_cells(observations), "turn": _turning_current(observations)}
    return np.asarray(pd.DataFrame(keys).groupby(list(keys)).ngroup())


@once_for_settings
def setting_cells(observations: Observations) -> IntArray:
    """A number for each setting: one level of distance, current and frequency, one branch."""
    keys = {name: levels(observations.setting(name), SAME_SETTING) for name in observations.settings}
    keys["branch"] = observations.column("branch")
    return np.asarray(pd.DataFrame(keys).groupby(list(keys)).ngroup())


def _turning_current(observations: Observations) -> FloatArray:
    """Level of the current at which the branch of each reading began; 0 without branches, or where no order is known.

    A run's stretch of one branch at one distance begins where the current turned.
    """
    at, current, branch = observations.covariates, observations.covariates["current_A"].to_numpy(), "branch"
    if not observations.clocked or not at[branch].to_numpy().any():
        return np.zeros(len(observations.value))
    order = np.lexsort((at["order"], at["run"]))
    place = np.stack([levels(at["distance_m"].to_numpy(), SAME_SETTING), at["run"], at[branch]])[:, order]
    begins = np.append(True, np.any(np.diff(place, axis=1) != 0.0, axis=0))
    turn = np.zeros(len(current))
    turn[order] = levels(current, SAME_LINE)[order[np.flatnonzero(begins)]][np.cumsum(begins) - 1]
    return np.where(at[branch] == 0.0, 0.0, turn)[observations.row]


def levels(x: FloatArray, part: float) -> FloatArray:
    """Numbers of the levels that a setting was brought to, each as wide as a part of the setting's range.

    A stage or a supply that was meant to return to a value is recorded a little beside it; the misfit of a model hardly
    changes over that distance.
    """
    tolerance = part * float(np.ptp(x))
    order = np.argsort(x, kind="stable")
    level, start, numbers = 0, x[order[0]], np.zeros(len(x))
    for k in order:
        if x[k] - start > tolerance:
            level, start = level + 1, x[k]
        numbers[k] = level
    return numbers


def quantisation_step(values: FloatArray) -> float:
    """The step that readings are rounded to: their smallest distance, where nearly equal ones are whole steps apart.

    0 where there is none: five gaps of one to ten steps are whole by chance, to a twentieth, once in 1e5 channels.
    """
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > SAME_READING * float(np.abs(values).max(initial=0.0))]
    if not len(gaps):
        return 0.0
    steps = gaps / gaps.min()
    near = steps[(steps > 1.5) & (steps < NEAR_STEPS)]
    whole = np.abs(near - np.round(near)) < WHOLE
    return float(gaps.min()) if len(near) >= LEAST_GAPS and whole.all() else 0.0
