"""A printed force law, F = sum c d^p i^q: its value, slopes, and the current and voltage that hold a body."""

from collections.abc import Sequence

import numpy as np
from papers.parameter_audit.parameters import Term

from femfit.core.arrays import FloatArray


def force(terms: Sequence[Term], distance: FloatArray | float, current: FloatArray | float) -> FloatArray:
    """F in N."""
    d, i = np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
    return np.asarray(sum(t.value * d**t.distance_power * i**t.current_power for t in terms))


def current_slope(terms: Sequence[Term], distance: float, current: float) -> float:
    """dF/di = k_m in N/A.

    Returns
    -------
    float
        Also the back-EMF per velocity, in V s/m.
    """
    return float(
        sum(
            t.current_power * t.value * distance**t.distance_power * current ** (t.current_power - 1)
            for t in terms
            if t.current_power
        )
    )


def holding_current(terms: Sequence[Term], distance: FloatArray | float, weight: float) -> FloatArray:
    """Current at which a law that is linear in it carries a weight."""
    passive = force(terms, distance, 0.0)
    return np.asarray((weight - passive) / (force(terms, distance, 1.0) - passive))
