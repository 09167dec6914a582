"""A body that comes to its stops: within a step it goes no further, and rests there or bounces back.

The voltage that it induces follows its way between the stops. A body that passed a stop and was put back at the end of
the step would leave a wrong current. Distances and velocities are arrays or expressions.

References
----------
J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in: Nonsmooth Mechanics and Applications
(Springer, 1988), section 5: a step whose contact is one impulse, and Newton's law of impact.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.numerics import BoolArray, FloatArray
from femfit.device.mechanics import Mechanics

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

_LEAST_SPEED_M_S = 1e-9
"""Numerical: a body at rest on its stop counts as meeting it so fast, where the slope of its speed is finite."""


def between(value: Any, ends: tuple[Any, Any]) -> Any:
    """A value kept between two ends, each of which may be infinite; at an end it has the slope that it has inside."""
    chosen = ca.if_else if isinstance(value, SX) else np.where
    low, high = ends
    value = value if _endless(low) else chosen(value < low, low, value)
    return value if _endless(high) else chosen(value > high, high, value)


def met_stops(motion: Mechanics, before: tuple[Any, Any], after: tuple[Any, Any], step: Any) -> tuple[Any, Any]:
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
        result = result - outward * (beyond * np.fmax(0.0, outward * result))
        if stop.restitution:
            way, begun, pressing = outward * (stop.distance_m - first), np.fmax(0.0, outward * velocity), outward * gain
            met = np.fmax(_LEAST_SPEED_M_S**2, begun**2 + 2.0 * pressing / step * way) ** 0.5
            left = between(1.0 - 2.0 * way / (step * (begun + met)), (0.0, 1.0))  # part of the step
            speed, pressed = stop.restitution * met, pressing * left
            returned = beyond * (2.0 * speed > pressed)
            distance = distance - outward * returned * left * step * (speed - 0.5 * pressed)
            result = result - outward * returned * (speed - pressed)
    return between(distance, motion.ends), result


def step_between_stops(
    model: "ActuatorModel",
    state: FloatArray,
    step: float,
    moved: Callable[[FloatArray, bool], FloatArray],
    touched: BoolArray | None = None,
) -> FloatArray:
    """States (N, order) one step in s later.

    Parameters
    ----------
    moved : callable
        States one step later of bodies without stops, and where False of bodies that go on at their speed, which is
        then the mean one of their way between the stops.
    touched : array, shape (2, N), or None
        Is made true where a body meets its near stop, or its far one.
    """
    motion = model.require_motion()
    begun = state.copy()
    begun[:, 0] = between(state[:, 0], motion.ends)  # no body is beyond a stop, though an estimate's points are
    after = moved(begun, True)
    distance, velocity = met_stops(motion, (begun[:, 0], begun[:, 1]), (after[:, 0], after[:, 1]), step)
    met: BoolArray = distance != after[:, 0]
    if met.any():
        begun[:, 1] = (distance - begun[:, 0]) / step
        if touched is not None:
            touched |= [after[:, 0] < motion.ends[0], after[:, 0] > motion.ends[1]]
        after = np.where(met[:, None], moved(begun, False), after)
    after[:, 0], after[:, 1] = distance, velocity
    return after


def _endless(end: Any) -> bool:
    return isinstance(end, float) and not np.isfinite(end)
