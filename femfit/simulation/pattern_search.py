"""The search by patterns for gains.

References
----------
R. Hooke and T. A. Jeeves, J. ACM 8 (1961) 212.
"""

from collections.abc import Callable

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.simulation.constants import FIRST_FACTOR, LAST_FACTOR


def pattern_search(
    score: Callable[[FloatArray], float], start: FloatArray, highest: FloatArray, enough: float
) -> FloatArray:
    """Climb by one coordinate after the other, and along what the last round changed, with steps that shrink."""
    values, best, step = start, score(start), np.log(FIRST_FACTOR)
    while step > np.log(LAST_FACTOR) and best < enough:
        before = values
        for k in range(len(values)):
            for sign in (1.0, -1.0):
                tried = values.copy()
                tried[k] = min(tried[k] + sign * step, highest[k])
                if (reached := score(tried)) > best + 1e-9:
                    values, best = tried, reached
                    break
        if np.array_equal(values, before):
            step *= 0.5
            continue
        tried = np.minimum(2.0 * values - before, highest)
        if (reached := score(tried)) > best:
            values, best = tried, reached
    return values
