"""A stop that gives way: a spring with a damper that can push and not pull.

With w^2 = k/m and the damping ratio z = c/(2 m w), a body without other forces leaves again when the stop's force is
zero, and its speed is then e times that of its arrival:

    z = sin a < 1:   ln e = -(pi - 2 a) tan a,        z = cosh b >= 1:   ln e = -2 b / tanh b.

References
----------
T. Schwager and T. Poeschel, Granular Matter 9 (2007) 465: coefficient of restitution of the damped spring that does not
pull.
"""

import math
from functools import cache

from femfit.device.mechanics import Stop

LEAST_RESTITUTION = 0.01
"""Conventional: a stop that gives way and returns nothing would need infinite damping; it returns a ten thousandth of
the energy."""


@cache
def damping(stop: Stop, mass: float) -> float:
    """Damping in N s/m that gives a stop with a stiffness its restitution."""
    if stop.stiffness_N_per_m is None:
        return 0.0
    wanted = math.log(min(max(stop.restitution, LEAST_RESTITUTION), 1.0))
    low, high = -0.5 * math.pi, 10.0  # a - pi/2 below zero, b above
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _log_restitution(middle) > wanted else (low, middle)
    ratio = math.cos(low) if low < 0.0 else math.cosh(low)
    return 2.0 * ratio * math.sqrt(stop.stiffness_N_per_m * mass)


def _log_restitution(angle: float) -> float:
    """Of a - pi/2 < 0, or of b >= 0; falling throughout."""
    if abs(angle) < 1e-8:
        return -2.0
    return 2.0 * angle / math.tan(-angle) if angle < 0.0 else -2.0 * angle / math.tanh(angle)


def push(stop: Stop, damper: float, depth: float, speed: float) -> float:
    """Force in N away from the stop, at a depth in m and a speed in m/s into it."""
    return max(0.0, (stop.stiffness_N_per_m or 0.0) * depth + damper * speed)
