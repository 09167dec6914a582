"""Repeated settings: which readings are repeats of each other, and what scatter they show.

References
----------
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: lack of fit against pure error.
"""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray, IntArray
from femfit.identify.constants import SAME_SETTING
from femfit.identify.readings.observations import Observations


def repeat_cells(observations: Observations) -> IntArray:
    """A number for each setting that may have been repeated: one level of distance and current, one branch.

    Readings of one channel with the same number are repeats.
    """
    keys = {name: levels(observations.column(name), SAME_SETTING) for name in observations.settings}
    keys["branch"] = observations.column("branch")
    return np.asarray(pd.DataFrame(keys).groupby(list(keys)).ngroup())


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


def pure_error(residual: FloatArray, cells: IntArray, nuisance: FloatArray) -> tuple[float, float]:
    """Sum of squares of one channel's residual within cells beside a nuisance, and its degrees of freedom.

    The nuisance, of shape (n, q), is what else differs between repeats: mounts, runs, temperatures, times.
    """
    _, code, sizes = np.unique(cells, return_inverse=True, return_counts=True)
    repeated = sizes[code] > 1
    free = int(repeated.sum() - np.count_nonzero(sizes > 1))
    if free < 2:
        return 0.0, 0.0
    table = np.column_stack([residual, nuisance])[repeated]
    code = code[repeated]
    sums = np.zeros((len(sizes), table.shape[1]))
    np.add.at(sums, code, table)
    within = table - (sums / np.maximum(sizes, 1)[:, None])[code]
    y, columns = within[:, 0], within[:, 1:]
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > 1e-9 * np.maximum(np.linalg.norm(nuisance[repeated], axis=0), 1e-300)]
    if not columns.shape[1]:
        return float(y @ y), float(free)
    left, singular, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    left = left[:, singular > 1e-8 * singular[0]]
    scatter = y - left @ (left.T @ y)
    return float(scatter @ scatter), float(free - left.shape[1])
