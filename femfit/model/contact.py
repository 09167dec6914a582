"""A body that comes to its stops: within a step it goes no further, and rests there or bounces back.

The voltage that it induces follows its way between the stops. A body that passed a stop and was put back at the end of
the step would leave a wrong current.

References
----------
J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in: Nonsmooth Mechanics and Applications
(Springer, 1988), section 5: a step whose contact is one impulse, and Newton's law of impact.
"""

from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.device.mechanics import Mechanics

_LEAST_SPEED_M_S = 1e-9
"""Numerical: a body at rest on its stop counts as meeting it so fast, where the slope of its speed is finite."""


def between(value: SX, ends: tuple[Any, Any]) -> SX:
    """An expression between two ends, each of which may be infinite; at an end it has the slope that it has inside."""
    low, high = ends
    value = value if endless(low) else ca.if_else(value < low, low, value)
    return value if endless(high) else ca.if_else(value > high, high, value)


def endless(end: Any) -> bool:
    """Whether an end is none."""
    return isinstance(end, float) and not np.isfinite(end)


def met_stops(motion: Mechanics, before: tuple[SX, SX], after: tuple[SX, SX], step: Any) -> tuple[SX, SX]:
    """Distance and velocity after a step in s, from those before it and those of a body without stops.

    A body comes to rest at its stop, or leaves it with the restitution's part of the speed that it met it with and goes
    on for the rest of the step under the same acceleration, unless that presses it back. No further than the stop
    before the step.
    """
    (first, velocity), (last, result) = before, after
    distance, gain = between(last, motion.ends), result - velocity
    for stop, outward in ((motion.near_stop, -1.0), (motion.far_stop, 1.0)):
        if stop is None:
            continue
        beyond = outward * (last - stop.distance_m) >= 0.0
        result = result - outward * (beyond * ca.fmax(0.0, outward * result))
        if stop.restitution:
            way, begun, pressing = outward * (stop.distance_m - first), ca.fmax(0.0, outward * velocity), outward * gain
            met = ca.fmax(_LEAST_SPEED_M_S**2, begun**2 + 2.0 * pressing / step * way) ** 0.5
            left = between(1.0 - 2.0 * way / (step * (begun + met)), (0.0, 1.0))  # part of the step
            speed, pressed = stop.restitution * met, pressing * left
            returned = beyond * (2.0 * speed > pressed)
            distance = distance - outward * returned * left * step * (speed - 0.5 * pressed)
            result = result - outward * returned * (speed - pressed)
    return between(distance, motion.ends), result
