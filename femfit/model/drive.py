"""What keeps a state within limits: drivers, with the current that an amplifier comes to, and a body's stops.

A voltage source gives what is commanded, within its limits. With a freewheel diode it gives positive voltages alone,
and for a command of zero the diode's while a current goes on. A current amplifier gives the voltage, within its
limits, that brings the current to

    i(t + h) = command + (i(t) - command) exp(-w h)

for its bandwidth w, or to the command itself without one. Commands have the shape (..., n), one a circuit.

A body that comes to its stops goes no further within a step, and rests there or bounces back. The voltage that it
induces follows its way between them: one that passed a stop and was put back at the end of the step would leave a wrong
current.

References
----------
J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in: Nonsmooth Mechanics and Applications
(Springer, 1988), section 5: a step whose contact is one impulse, and Newton's law of impact.
"""

from functools import cache
from math import pi
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.numerics import BoolArray, FloatArray
from femfit.device.electrics import Circuit
from femfit.device.mechanics import Mechanics

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

LEAST_SPEED_M_S = 1e-9
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
            met = ca.fmax(LEAST_SPEED_M_S**2, begun**2 + 2.0 * pressing / step * way) ** 0.5
            share = between(1.0 - 2.0 * way / (step * (begun + met)), (0.0, 1.0))  # part of the step
            speed, pressed = stop.restitution * met, pressing * share
            returned = beyond * (2.0 * speed > pressed)
            distance = distance - outward * returned * share * step * (speed - 0.5 * pressed)
            result = result - outward * returned * (speed - pressed)
    return between(distance, motion.ends), result


def command_limits(circuit: Circuit, *, current: bool | None = None) -> tuple[float, float]:
    """Least and largest command that a driver follows, in V, or in A for a current amplifier.

    Parameters
    ----------
    current : bool or None
        Whether a current is commanded; as the circuit's drive says where None.
    """
    drive = circuit.drive
    if drive.kind == "current" if current is None else current:
        low, high = drive.current_min_A, drive.current_max_A
        return -np.inf if low is None else low, np.inf if high is None else high
    return 0.0 if drive.diode_V is not None else circuit.voltage_min_V, circuit.voltage_max_V


def held_limits(circuit: Circuit) -> tuple[float, float]:
    """Least and largest current in A that a driver holds at rest, whatever it is commanded in."""
    low, high = circuit.voltage_min_V / circuit.resistance_ohm, circuit.voltage_max_V / circuit.resistance_ohm
    if circuit.drive.diode_V is not None:
        low = max(low, 0.0)
    if circuit.drive.kind == "current":
        least, most = command_limits(circuit)
        low, high = max(low, least), min(high, most)
    return low, high


def commands_currents(model: "ActuatorModel") -> BoolArray:
    """Which circuits are commanded in A, shape (n,)."""
    return np.array([circuit.drive.kind == "current" for circuit in model.circuits], dtype=np.bool_)


@cache
def voltage_limits(circuits: tuple[Circuit, ...]) -> FloatArray:
    """Least and largest voltage of each circuit, shape (2, n)."""
    return np.array([(circuit.voltage_min_V, circuit.voltage_max_V) for circuit in circuits]).T


def regulated_current(circuit: Circuit, current: SX, command: SX, step: float) -> SX:
    """Current in A that an amplifier would reach after a step in s."""
    wanted, bandwidth = between(command, command_limits(circuit)), circuit.drive.bandwidth_Hz
    return wanted if bandwidth is None else wanted + np.exp(-2.0 * pi * bandwidth * step) * (current - wanted)
