"""Numbers that all rooms share: array types, constants in SI units, scales, differences and ranking.

Ranking leaves what is equal up to rounding in its order, so that no result depends on the processor's last bit.

References
----------
CODATA 2022: mu_0 = 1.25663706127e-6 N/A^2. femfit keeps the pre-2019 exact value 4 pi 1e-7, as every
published reference value and every other field solver does; the two differ by 1.6e-10.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.intp]
ComplexArray: TypeAlias = NDArray[np.complex128]


def evenly_spread(length: int, count: int) -> IntArray:
    """At most so many places of a sequence, its ends among them.

    Examples
    --------
    >>> evenly_spread(10, 4)
    array([0, 3, 6, 9])
    """
    return np.unique(np.linspace(0, length - 1, min(length, count)).round().astype(np.intp))


LARGEST = 1e37
"""No measured quantity is as large; instruments write 9.9E+37 for an overload, and 9.91E+37 for no number (SCPI-99)."""

MU_0 = 4e-7 * math.pi
"""Vacuum permeability in H/m."""

GRAVITY = 9.80665
"""Standard acceleration of free fall in m/s^2 (3rd CGPM, 1901)."""

ABSOLUTE_ZERO_C = -273.15
"""Absolute zero in degC, by the definition of the Celsius scale."""

COPPER_RESISTIVITY_20C = 1.7241e-8
"""Resistivity of annealed copper at 20 degC in ohm m (IEC 60028)."""

COPPER_TEMPERATURE_COEFFICIENT = 0.00393
"""Relative change of copper's resistivity per kelvin at 20 degC (IEC 60028)."""

BIAS_SHARE = 2.0 / 3.0
"""Numerical: of the largest flux linkage, at which eddy currents beside iron that saturates are solved. The pull-ins of
a flat solenoid by 5, 12 and 24 V then end 1.3 % late, 0.1 % and 2.1 % early beside the nonlinear field in time; with a
half 0.0, 1.2 and 3.0 % early, with 0.7 2.8, 2.0 and 0.5 % late."""


_NEAR = 0.1
"""Part of the stroke over which a body that passes the face is near to it; chosen."""


def even_scale(distance: FloatArray) -> FloatArray:
    """The logarithm of distances, counted from before the nearest where a body passes the face.

    Examples
    --------
    >>> even_scale(np.array([1e-3, 1e-2])).round(2).tolist()
    [-6.91, -4.61]
    >>> even_scale(np.array([-1e-3, 9e-3])).round(2).tolist()
    [-6.91, -4.51]
    """
    finite = distance[np.isfinite(distance)]
    if not len(finite) or finite.min() > 0.0:
        return np.log(distance)
    stroke = float(np.ptp(finite)) or 1.0
    return np.log(distance - float(finite.min()) + _NEAR * stroke)


NORMAL_MEDIAN = 0.6745
"""Derived: median magnitude of a standard normal number."""


NORMAL_95 = 1.959963984540054
"""Derived: standard deviations to either side of the mean that hold 95 % of normal numbers."""


def robust_deviation(values: FloatArray, axis: int | None = None) -> Any:
    """Standard deviation of normal numbers about zero, along an axis or of all; up to half of them may be faults.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(10_000)
    >>> round(robust_deviation(np.append(noise, 1e6)), 1)
    1.0
    """
    return np.median(np.abs(values), axis=axis) / NORMAL_MEDIAN


def central_differences(
    function: Callable[[FloatArray], FloatArray], states: FloatArray, scale: FloatArray | None = None
) -> FloatArray:
    """Jacobian of a batched function by central differences.

    Parameters
    ----------
    function : callable
        Points (2 n N, n) -> values (2 n N, k); called once.
    states : array, shape (N, n)
        Where.
    scale : array, shape (n,), or None
        Size of each state over which the function changes, so that a state near 0 has no step near 0. None: the state's
        own size, and 1 where it is 0.

    Returns
    -------
    array, shape (N, k, n)
        With steps of eps^(1/3) relative to the larger of state and scale, whose rounding and truncation errors balance.
    """
    count, order = states.shape
    size = np.where(states == 0.0, 1.0, np.abs(states)) if scale is None else np.maximum(np.abs(states), scale)
    width = np.cbrt(np.finfo(states.dtype).eps) * size
    points = np.broadcast_to(states, (2, order, count, order)).copy()
    for k in range(order):
        points[0, k, :, k] += width[:, k]
        points[1, k, :, k] -= width[:, k]
    values = function(points.reshape(-1, order))
    values = values.reshape(2, order, count, math.prod(values.shape[1:]))
    exact_width = np.stack([points[0, k, :, k] - points[1, k, :, k] for k in range(order)])
    return np.moveaxis((values[0] - values[1]) / exact_width[:, :, None], 0, -1)


def root_beside_one(products: FloatArray) -> FloatArray:
    """L of L L' = 1 + A'A, shape (k, k), with 1e-12 of the products' diagonal more: their rounding may exceed the 1."""
    return np.asarray(np.linalg.cholesky(products + np.diag(1.0 + 1e-12 * np.diag(products))))


Item = TypeVar("Item")

ROUNDING = 1e-6
"""Relative difference below which two computed numbers are one: the last steps of a solver change as much."""


def first_best(values: Sequence[float], least: float = 0.0) -> int:
    """Index of the first value that equals the largest up to rounding."""
    largest = max(values)
    slack = max(ROUNDING * abs(largest), least)
    return next(k for k, value in enumerate(values) if value >= largest - slack)


def ranked(items: Sequence[Item], value: Callable[[Item], float], least: float = 0.0) -> list[Item]:
    """Items with the largest value first; those that are equal up to rounding stay in the order given."""
    waiting, values, result = list(items), [value(item) for item in items], []
    while waiting:
        best = first_best(values, least)
        result.append(waiting.pop(best))
        values.pop(best)
    return result
