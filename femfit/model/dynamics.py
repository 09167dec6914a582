"""The motion of plant and filters: :mod:`femfit.model.equations` at many states.

In all functions ``state`` has the shape (..., order): distance in m, velocity in m/s (positive: falling away), the
currents in A in the order of ``model.circuits``, those of ``model.eddy_names``, and after them ``model.memory_names``.
``voltage``, across each circuit in V, has the shape (..., n), and (...) of one circuit; it is held over a step.
Jacobians have the shape (..., order, order): row, component of the result; column, component of the state. Where
``free`` is false, bodies go on at their speed. Stops are left to :mod:`femfit.model.drive`.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), with 1/m, the sign of the current's force and
the back-EMF that their (32) lacks.
"""

import numpy as np

from femfit.core.graph import GraphFunction
from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel


def state_derivative(model: ActuatorModel, state: FloatArray, voltage: FloatArray, *, free: bool = True) -> FloatArray:
    """Time derivative of (distance, velocity, currents), and of the states that the model's effects add."""
    return evaluated(model, model.equations.rates, state, voltage, free=free)


def voltages_needed(
    model: ActuatorModel, distance: FloatArray, velocity: FloatArray, currents: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Voltages (..., n) to command so that currents (..., n) stay, and the inductances (..., n, n) of their rates in H.

    What effects make of circuit and driver counts; eddy currents are left aside.
    """
    still, n = model.without_eddies, len(model.circuits)
    state, rates = np.zeros((*np.shape(distance), 1 + n, still.order)), np.vstack([np.zeros(n), np.eye(n)])
    state[..., 0], state[..., 1] = distance[..., None], velocity[..., None]
    state[..., 2 : 2 + n] = currents[..., None, :]
    inputs, flow = rates[:, 0] if n == 1 else rates, still.equations.flow(tuple(range(n)))
    volts = evaluated(still, flow, state, inputs)[..., still.order :]
    return volts[..., 0, :], np.swapaxes(volts[..., 1:, :] - volts[..., :1, :], -1, -2)


def evaluated(
    model: ActuatorModel,
    function: GraphFunction,
    state: FloatArray,
    voltage: FloatArray | None = None,
    step: FloatArray | float = 0.0,
    time: FloatArray | float = 0.0,
    free: bool = True,
) -> FloatArray:
    """Values (..., entries) of one of the model's equations."""
    n, points = len(model.circuits), state.shape[:-1]
    volts: FloatArray = np.zeros(n)
    if voltage is not None and n:
        applied = np.asarray(voltage, dtype=np.float64)[..., None] if n == 1 else np.asarray(voltage, dtype=np.float64)
        volts = np.broadcast_to(applied, (*points, n)).reshape(-1, n).T
    step = step[..., 0] if isinstance(step, np.ndarray) and step.ndim else step
    inputs = np.empty((3, *points))
    inputs[0], inputs[1], inputs[2] = step, time, free
    x = state.reshape(-1, state.shape[-1]).T
    values = function(x, volts, inputs.reshape(3, -1))
    return values.T.reshape(*points, len(values))


def state_scale(model: ActuatorModel) -> FloatArray:
    """What is large for each state: a body takes some hundred samples through its stroke."""
    box = model.validity
    memory = [memory.spread for memory in model.memories for _ in memory.names]
    stroke = box.distance_max_m - box.distance_min_m
    widths = np.ptp(box.current_limits_A, axis=1)[: len(model.circuits)]
    speed = 0.01 * stroke / model.sample_time_s
    return np.array([stroke, speed, *widths, *eddy_currents_of(model, widths, speed), *memory])


def eddy_currents_of(
    model: ActuatorModel, jumps: FloatArray, speed: float, distance: float | None = None
) -> FloatArray:
    """Currents in A that jumps of the circuits' currents leave in the eddy currents' patterns, and a speed drives.

    As if each pattern were alone: its flux linkage stays at a jump, and at a steady speed v it carries k_m v / R.
    """
    windings, n = model.windings, len(model.circuits)
    if model.eddy is None:
        return np.zeros(0)
    box = model.validity
    place = 0.5 * (box.distance_min_m + box.distance_max_m) if distance is None else distance
    middle = np.zeros(windings.count)
    middle[:n] = box.current_limits_A[:n].mean(axis=1)
    there = windings.magnetics.state(np.asarray(place), middle)
    remaining = np.abs(there.inductance[n:, :n]) @ np.asarray(jumps) / np.diag(there.inductance)[n:]
    return np.hypot(remaining, there.motional_constant[n:] * speed / windings.resistances_ohm[n:])
