"""Derivatives in the distance of a spline in u = d_0 / (d + s).

du/dd = -u^2 / d_0, and (u^2 d/du)^n = sum_k L(n, k) u^(n + k) d^k/du^k with the Lah numbers
L(n, k) = C(n - 1, k - 1) n! / k!, so that d^n/dd^n = (-1 / d_0)^n sum_k L(n, k) u^(n + k) d^k/du^k.

References
----------
L. Comtet, Advanced Combinatorics (Reidel, 1974), section 3.3, for the Lah numbers.
"""

from functools import cache
from math import comb, factorial

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.bspline import TensorSpline


def partial_derivatives(
    spline: TensorSpline,
    reference_distance: float,
    shifted_distance: FloatArray,
    current: FloatArray,
    orders: tuple[tuple[int, int], ...],
) -> list[FloatArray]:
    """Partial derivatives, of orders (in d, in i), of a spline in (d_0 / (d + s), i) at flat arrays of d + s and i."""
    u = reference_distance / shifted_distance
    wanted = _inner_orders(orders)
    inner = dict(zip(wanted, spline.derivatives(u, current, wanted), strict=True))
    return [_in_distance(inner, u, shifted_distance, a, b) for a, b in orders]


@cache
def _inner_orders(orders: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
    """Orders (in u, in i) that the chain rule needs."""
    return tuple(dict.fromkeys((k, b) for a, b in orders for k in range(min(a, 1), a + 1)))


def _in_distance(
    inner: dict[tuple[int, int], FloatArray], u: FloatArray, shifted: FloatArray, a: int, b: int
) -> FloatArray:
    if a == 0:
        return inner[0, b]
    if a == 1:
        return (-1.0 / shifted) * (u * inner[1, b])
    total = np.zeros_like(u)
    for k in range(1, a + 1):
        total += comb(a - 1, k - 1) * (factorial(a) // factorial(k)) * u**k * inner[k, b]
    return np.asarray((-1.0 / shifted) ** a * total)
