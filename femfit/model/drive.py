"""What a driver does to a command: the limits that it keeps, and the voltage that the winding sees.

A voltage source gives what is commanded, within its limits. With a freewheel diode it gives positive voltages alone,
and for a command of zero the diode's while a current goes on. A current amplifier gives the voltage, within its
limits, that brings the current to

    i(t + h) = command + (i(t) - command) exp(-w h)

for its bandwidth w, or to the command itself without one. Commands have the shape (..., n), one a circuit.
"""

from functools import cache
from math import pi

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.device.circuit import Circuit
from femfit.model.actuator_model import ActuatorModel
from femfit.model.decay import decay_of


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


def commands_currents(model: ActuatorModel) -> BoolArray:
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
    model: ActuatorModel, distance: FloatArray, currents: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Force (...), motional constants (..., n) and inductances (..., n, n) for any number of circuits."""
    at = model.magnetics.state_of_circuits(distance, currents)
    return at.force, at.motional_constant, at.inductance + model.series_inductances_H


def current_targets(model: ActuatorModel, currents: FloatArray, command: FloatArray, step: float) -> FloatArray:
    """Currents in A that amplifiers would reach after a step in s; NaN for circuits that are fed by a voltage."""
    kept, limits = _amplifiers(model.circuits, step)
    wanted = np.clip(command, limits[0], limits[1])
    return np.asarray(wanted + kept * (currents - wanted))


@cache
def _amplifiers(circuits: tuple[Circuit, ...], step: float) -> tuple[FloatArray, FloatArray]:
    """Part of a deviation that is left after a step, NaN for voltage sources, (n,), and the limits (2, n)."""
    kept = [
        np.nan
        if one.drive.kind == "voltage"
        else 0.0
        if one.drive.bandwidth_Hz is None
        else np.exp(-2.0 * pi * one.drive.bandwidth_Hz * step)
        for one in circuits
    ]
    return np.array(kept), np.array([command_limits(one) for one in circuits]).T


def winding_voltage(model: ActuatorModel, state: FloatArray, command: FloatArray, step: float) -> FloatArray:
    """Voltage across each winding in V, held over a step in s, for which amplifiers come to their targets.

    As one of :mod:`femfit.model.exponential_step` takes it: an exact plant corrects it by what is left.

    Parameters
    ----------
    state : array, shape (..., 2 + n or more)
    command : array, shape (..., n)
    """
    circuits, n = model.circuits, len(model.circuits)
    if is_plain(circuits):
        return command
    distance, velocity, currents = state[..., 0], state[..., 1], state[..., 2 : 2 + n]
    volts = np.array(np.broadcast_to(command, currents.shape))
    for k, circuit in enumerate(circuits):
        diode = circuit.drive.diode_V
        if circuit.drive.kind == "voltage" and diode is not None:
            idle = np.where(currents[..., k] > 0.0, -diode, 0.0)
            volts[..., k] = np.where(volts[..., k] > 0.0, volts[..., k], idle)
    amplified = commands_currents(model)
    if amplified.any():
        _, motional, inductance = circuit_terms(model, distance, currents)
        against = model.resistances_ohm * currents - motional * velocity[..., None]
        drives, others = np.flatnonzero(amplified), np.flatnonzero(~amplified)
        gain = decay_of(inductance, model.resistances_ohm, step).applied(np.asarray(np.linalg.inv(inductance)))[
            0
        ]  # di/dt by U
        rate = (current_targets(model, currents, command, step) - currents)[..., drives] / step
        if len(others):  # what the voltage sources beside it bring about
            own = (volts - against)[..., others]
            rate = rate - np.einsum("...jk,...k->...j", gain[..., drives[:, None], others], own)
        left = np.linalg.solve(gain[..., drives[:, None], drives], rate[..., None])[..., 0]
        low, high = voltage_limits(circuits)[:, drives]
        volts[..., drives] = np.clip(against[..., drives] + left, low, high)
    return volts
