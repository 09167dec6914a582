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

from femfit.core.numerics import BoolArray, FloatArray
from femfit.device.electrics import Circuit
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import currents_by_voltages


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
    at = model.magnetics.state(distance, currents)
    return at.force, at.motional_constant, at.inductance + model.series_inductances_H


def blocked_by_diodes(model: ActuatorModel, states: FloatArray) -> FloatArray:
    """States (N, order) whose currents do not turn round where a diode feeds the winding; changes its argument.

    Eddy currents keep the flux that they link.
    """
    before = None if model.eddy is None else states[:, 2 : 2 + len(model.circuits)].copy()
    for k, _ in model.diodes:
        states[:, 2 + k] = np.maximum(states[:, 2 + k], 0.0)
    if before is not None and (change := states[:, 2 : 2 + before.shape[1]] - before).any():
        n, end = before.shape[1], model.windings.end
        linked = model.windings.magnetics.state(states[:, 0], states[:, 2:end]).inductance[:, n:]
        lost = np.einsum("rkj,rj->rk", linked[..., :n], change)
        states[:, 2 + n : end] -= np.linalg.solve(linked[..., n:], lost[..., None])[..., 0]
    return states


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

    As one of :mod:`femfit.model.dynamics` takes it: an exact plant corrects it by what is left.

    Parameters
    ----------
    state : array, shape (..., 2 + n or more)
    command : array, shape (..., n)
    """
    circuits, n, windings = model.circuits, len(model.circuits), model.windings
    if is_plain(circuits):
        return command
    velocity, currents = state[..., 1], state[..., 2 : windings.end]
    volts = np.array(np.broadcast_to(command, (*currents.shape[:-1], n)))
    for k, _ in model.diodes:
        volts[..., k] = np.where(volts[..., k] > 0.0, volts[..., k], 0.0)
    if model.diodes:
        _freewheel(model, state, volts, step)
    amplified = commands_currents(model)
    if amplified.any():
        at = windings.magnetics.state(state[..., 0], currents)
        against = windings.resistances_ohm * currents - at.motional_constant * velocity[..., None]
        drives = np.flatnonzero(amplified)
        others = np.setdiff1d(np.arange(windings.count), drives)
        gain = currents_by_voltages(model, state[..., 0], currents, step) / step
        rate = (current_targets(model, currents[..., :n], command, step) - currents[..., :n])[..., drives] / step
        if len(others):  # what voltage sources and eddy currents beside it bring about
            own = (windings.voltages(volts) - against)[..., others]
            rate = rate - np.einsum("...jk,...k->...j", gain[..., drives[:, None], others], own)
        left = np.linalg.solve(gain[..., drives[:, None], drives], rate[..., None])[..., 0]
        low, high = voltage_limits(circuits)[:, drives]
        volts[..., drives] = np.clip(against[..., drives] + left, low, high)
    return volts


def _freewheel(model: ActuatorModel, state: FloatArray, volts: FloatArray, step: float) -> None:
    """Windings that nothing feeds have their diodes' drops, or the voltage that ends their current with the step.

    Eddy currents and other windings drive a current for long. Changes ``volts``.
    """
    windings = model.windings
    currents = state[..., 2 : windings.end]
    idle = [volts[..., k] <= 0.0 for k, _ in model.diodes]
    if not np.any(idle):
        return
    for (k, drop), off in zip(model.diodes, idle, strict=True):
        volts[..., k] = np.where(off & (currents[..., k] > 0.0), -drop, volts[..., k])
    at = windings.magnetics.state(state[..., 0], currents)
    driving = at.motional_constant * state[..., 1:2] - windings.resistances_ohm * currents
    gain = currents_by_voltages(model, state[..., 0], currents, step)
    for (k, drop), off in zip(model.diodes, idle, strict=True):
        others = windings.voltages(volts) + driving
        others[..., k] = driving[..., k]
        needed = -(currents[..., k] + (gain[..., k, :] * others).sum(axis=-1)) / gain[..., k, k]
        volts[..., k] = np.where(off, np.maximum(needed, -drop), volts[..., k])
