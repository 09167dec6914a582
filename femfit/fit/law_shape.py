"""A law's nonlinear parameters, found by variable projection: its coefficients are solved for at every trial.

References
----------
G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413.
"""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import least_squares

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError
from femfit.laws.law import ForceLaw

STEPS = (0.0, -0.1, 0.1)
"""Starts beside the law's first guess, as parts of the logarithm of the range between its bounds."""


def search_shape(
    law: ForceLaw, residual: Callable[[Mapping[str, float]], FloatArray], start: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The shape with the least sum of squares of ``residual(shape)``, which is of the order of one a row.

    Starts from ``start``, or from the law's first guess and two further ones; FitError if none reaches a minimum.
    """
    if not law.shape:
        return {}
    lower, upper = np.array([p.lower for p in law.shape]), np.array([p.upper for p in law.shape])

    def named(unit: FloatArray) -> dict[str, float]:
        values = lower * (upper / lower) ** unit
        return {p.name: float(v) for p, v in zip(law.shape, values, strict=True)}

    def misfit(unit: FloatArray) -> FloatArray:
        return residual(named(unit))

    first = np.array([p.start if start is None else start[p.name] for p in law.shape])
    unit = np.log(first / lower) / np.log(upper / lower)
    found = [
        least_squares(
            misfit,
            np.clip(unit + step, 1e-3, 1.0 - 1e-3),
            bounds=(0.0, 1.0),
            xtol=1e-10,
            ftol=1e-10,
            gtol=1e-10,
        )
        for step in (STEPS if start is None else STEPS[:1])
    ]
    best = min(found, key=lambda r: float(r.cost))
    if not best.success:
        raise FitError(f"The shape of law {law.name} was not found: {best.message} Try another law.")
    return named(best.x)
