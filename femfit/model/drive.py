"""What a driver does to a command: the limits that it keeps, and the current that an amplifier comes to.

A voltage source gives what is commanded, within its limits. With a freewheel diode it gives positive voltages alone,
and for a command of zero the diode's while a current goes on. A current amplifier gives the voltage, within its
limits, that brings the current to

    i(t + h) = command + (i(t) - command) exp(-w h)

for its bandwidth w, or to the command itself without one. Commands have the shape (..., n), one a circuit.
"""

from functools import cache
from math import pi
from typing import TYPE_CHECKING

import numpy as np
from casadi import SX

from femfit.core.numerics import BoolArray, FloatArray
from femfit.device.electrics import Circuit
from femfit.model.contact import between

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


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
    return _amplified(model.circuits)


@cache
def _amplified(circuits: tuple[Circuit, ...]) -> BoolArray:
    return np.array([circuit.drive.kind == "current" for circuit in circuits], dtype=np.bool_)


@cache
def voltage_limits(circuits: tuple[Circuit, ...]) -> FloatArray:
    """Least and largest voltage of each circuit, shape (2, n)."""
    return np.array([(one.voltage_min_V, one.voltage_max_V) for one in circuits]).T


def is_plain(circuits: tuple[Circuit, ...]) -> bool:
    """Whether every winding sees the command itself, as behind a bridge."""
    return all(circuit.drive.kind == "voltage" and circuit.drive.diode_V is None for circuit in circuits)


def circuit_terms(
    model: "ActuatorModel", distance: FloatArray, currents: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Force (...), motional constants (..., n) and inductances (..., n, n) for any number of circuits."""
    at = model.magnetics.state(distance, currents)
    return at.force, at.motional_constant, at.inductance + model.series_inductances_H


def regulated_current(circuit: Circuit, current: SX, command: SX, step: float) -> SX:
    """Current in A that an amplifier would reach after a step in s."""
    wanted, bandwidth = between(command, command_limits(circuit)), circuit.drive.bandwidth_Hz
    return wanted if bandwidth is None else wanted + np.exp(-2.0 * pi * bandwidth * step) * (current - wanted)
