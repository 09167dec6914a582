"""The motion of plant and filters: :mod:`femfit.model.equations` at many states, and steps made of it.

In all functions ``state`` has the shape (..., order): distance in m, velocity in m/s (positive: falling away), the
currents in A in the order of ``model.circuits``, those of ``model.eddy_names``, and after them ``model.memory_names``.
``voltage``, across each circuit in V, has the shape (..., n), and (...) of one circuit; ``disturbance``, a further
force along growing distance in N, has the shape (...). Both are held over a step. Jacobians have the shape
(..., order, order): row, component of the result; column, component of the state. Where ``free`` is false, bodies go on
at their speed. Stops are left to :mod:`femfit.model.contact`.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), with 1/m, the sign of the current's force and
the back-EMF that their (32) lacks.
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I (Springer, 1993), section II.9:
extrapolation of a method of first order, eqs. (9.2) and (9.10) with the harmonic sequence.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from femfit.core.graph import GraphFunction
from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel

LONGEST_MOTION = 0.5
"""Chosen: extrapolated step times the rate of the motion; where that is fastest, one such step is off by 3e-4 of the
change of speed, and two of half the length by a fifteenth of this."""

LONGEST_STEP = 1.0
"""Derived: step of a Runge-Kutta method of fourth order over a decaying current's time constant; it is stable up to
2.8, and off by 1/120 of the decay's fifth power at one."""

ROUNDING = 1e-9
"""Numerical: of a whole number of steps, which the last digit of an inductance must not make one more."""

FLUX_STEPS, FLUX_CHANGE = 20, 1e-10
"""Numerical: Newton's method on a flux linkage that grows with the current ends within a handful of steps."""


def state_derivative(
    model: ActuatorModel,
    state: FloatArray,
    voltage: FloatArray,
    disturbance: FloatArray | float = 0.0,
    *,
    free: bool = True,
) -> FloatArray:
    """Time derivative of (distance, velocity, currents), and of the states that the model's effects add."""
    return evaluated(model, model.equations.rates, state, voltage, disturbance, free=free)


def state_jacobian(model: ActuatorModel, state: FloatArray, voltage: FloatArray) -> FloatArray:
    """Jacobian of :func:`state_derivative` with respect to the state."""
    columns, order = evaluated(model, model.equations.rates_slope, state, voltage), state.shape[-1]
    return np.swapaxes(columns.reshape(*state.shape[:-1], order, order), -1, -2)


def exponential_step(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: FloatArray | float, *, free: bool = True
) -> FloatArray:
    """States (..., order) one step of :mod:`femfit.model.equations` later; steps of their own have the shape (..., 1).

    Exact for a current that decays at rest, however fast, and of second order in the motion and what it induces.
    """
    length = None if isinstance(step, np.ndarray) else float(step)
    return evaluated(model, model.equations.step(length), state, voltage, step=step, free=free)


def currents_by_voltages(model: ActuatorModel, distance: FloatArray, currents: FloatArray, step: float) -> FloatArray:
    """How far voltages held over a step in s move all windings' currents (..., n + r), in A/V, (..., n + r, n + r)."""
    windings, m = model.windings, model.windings.count
    inductance = windings.magnetics.inductance(distance, currents) + windings.series_H
    # (1 - exp(-h L^-1 R)) R^-1, as the exponential of a matrix of blocks
    blocks = np.zeros((*inductance.shape[:-2], 2 * m, 2 * m))
    blocks[..., :m, :m] = -step * np.linalg.solve(inductance, np.diag(windings.resistances_ohm))
    blocks[..., :m, m:] = step * np.linalg.inv(inductance)
    return np.asarray(expm(blocks)[..., :m, m:])


def evaluated(
    model: ActuatorModel,
    function: GraphFunction,
    state: FloatArray,
    voltage: FloatArray | None = None,
    disturbance: FloatArray | float = 0.0,
    step: FloatArray | float = 0.0,
    time: FloatArray | float = 0.0,
    free: bool = True,
) -> FloatArray:
    """Values (..., entries) of one of the model's equations."""
    n, points = len(model.circuits), state.shape[:-1]
    volts: FloatArray = np.zeros(n)
    if voltage is not None and n:
        given = np.asarray(voltage, dtype=np.float64)[..., None] if n == 1 else np.asarray(voltage, dtype=np.float64)
        volts = np.broadcast_to(given, (*points, n)).reshape(-1, n).T
    step = step[..., 0] if isinstance(step, np.ndarray) and step.ndim else step
    others = np.empty((4, *points))
    others[0], others[1], others[2], others[3] = disturbance, step, time, free
    x = state.reshape(-1, state.shape[-1]).T
    values = function(x, volts, others.reshape(4, -1), model.magnetics.given_values)
    return values.T.reshape(*points, len(values))


def runge_kutta_step(
    model: ActuatorModel,
    state: FloatArray,
    voltage: FloatArray,
    step: FloatArray | float,
    substeps: int = 1,
    disturbance: FloatArray | float = 0.0,
    *,
    free: bool = True,
) -> FloatArray:
    """Advance by classical fourth-order Runge-Kutta with equal substeps; steps of their own have the shape (..., 1)."""
    h = step / substeps
    for _ in range(substeps):
        k1 = state_derivative(model, state, voltage, disturbance, free=free)
        k2 = state_derivative(model, state + 0.5 * h * k1, voltage, disturbance, free=free)
        k3 = state_derivative(model, state + 0.5 * h * k2, voltage, disturbance, free=free)
        k4 = state_derivative(model, state + h * k3, voltage, disturbance, free=free)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def extrapolated_step(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: FloatArray | float, *, free: bool = True
) -> FloatArray:
    """States one step later with an error of third order, as exact for a current that decays at rest.

    One step holds inductance and motional constant at its first currents, an error of first order where they change.
    From one, two and three steps over the same time follows what infinitely many would come to.
    """
    result = np.zeros_like(state)
    for count, weight in ((1, 0.5), (2, -4.0), (3, 4.5)):
        moved = state
        for _ in range(count):
            moved = exponential_step(model, moved, voltage, step / count, free=free)
        result += weight * moved
    return result


def accurate_step(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: float, *, free: bool = True
) -> FloatArray:
    """States one step later by Runge and Kutta, and by extrapolation where eddy currents decay fast."""
    accurate = runge_kutta_step if model.eddy is None else extrapolated_step
    return accurate(model, state, voltage, step, free=free)


def motion_steps(model: ActuatorModel) -> int:
    """Extrapolated steps in a sample, which follow the body's motion over the validity domain.

    The rate of the motion follows from its stiffness at constant flux: that at held currents, with k_m L^-1 k_m of the
    currents that keep the flux.
    """
    windings, motion = model.windings, model.require_motion()
    d, i = model.validity.grid(5, 5, several=3)
    currents = np.zeros((len(d), windings.count))
    currents[:, : windings.circuits] = i[:, : windings.circuits]
    at = windings.magnetics.slopes(d, currents)
    answers = np.linalg.solve(at.inductance + windings.series_H, at.motional_constant[..., None])[..., 0]
    stiffness = np.abs(motion.static_gradient(d)) + np.abs(at.force_gradient)
    stiffness = stiffness + (at.motional_constant * answers).sum(axis=-1)
    rate = float(np.sqrt(stiffness.max() / motion.mass_kg))
    return max(1, int(np.ceil(model.sample_time_s * rate / LONGEST_MOTION)))


def plant_steps(model: ActuatorModel, distances: Sequence[float]) -> int:
    """Accurate steps in a sample: none is longer than the fastest coil's time constant, or too long for the motion.

    With eddy currents, whose steps are exact for the fastest decay, the motion sets their length.

    Parameters
    ----------
    distances : sequence of float
        Where, in m.
    """
    if not model.windings.count:
        return 1
    if model.eddy is not None:
        return motion_steps(model)
    steps = model.sample_time_s / min(fastest_time_constant(model, distance) for distance in distances) / LONGEST_STEP
    return max(1, int(np.ceil(steps * (1.0 - ROUNDING))))


def fastest_time_constant(model: ActuatorModel, distance: float) -> float:
    """Smallest L/R over the currents of the validity domain in s: the least eigenvalue of R^-1 L of several windings.

    Parameters
    ----------
    distance : float
        In m.
    """
    windings = model.windings
    _, currents = model.validity.grid(1, 5, several=3)
    all_currents = np.zeros((len(currents), windings.count))
    all_currents[:, : windings.circuits] = currents[:, : windings.circuits]
    magnetic = windings.magnetics.state(np.full(len(currents), distance), all_currents)
    inductance = magnetic.inductance + windings.series_H
    if windings.count == 1:
        return float(inductance.min() / windings.resistances_ohm[0])
    root = np.sqrt(windings.resistances_ohm)  # eigenvalues of R^-1 L, made symmetric
    return float(np.linalg.eigvalsh(inductance / (root[:, None] * root)).min())


def half_way(state: FloatArray, step: float) -> FloatArray:
    """States whose bodies have drifted for half a step."""
    middle = np.array(state)
    middle[..., 0] += 0.5 * step * middle[..., 1]
    return middle


def currents_of_same_flux(
    model: ActuatorModel, currents: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """All windings' currents (N, n + r) at other distances that link the same flux, by Newton."""
    windings = model.windings
    if not currents.shape[1]:
        return currents

    def linked(distance: FloatArray, at: FloatArray) -> FloatArray:
        return np.asarray(windings.magnetics.flux_linkage(distance, at) + at @ windings.series_H)

    wanted, result = linked(before, currents), currents
    for _ in range(FLUX_STEPS):
        inductance = windings.magnetics.state(after, result).inductance + windings.series_H
        change = np.linalg.solve(inductance, (wanted - linked(after, result))[..., None])[..., 0]
        result = result + change
        if np.abs(change).max(initial=0.0) <= FLUX_CHANGE * np.abs(result).max(initial=0.0):
            break
    return result


def state_scale(model: ActuatorModel) -> FloatArray:
    """What is large for each state: a body takes some hundred samples through its stroke."""
    box = model.validity
    memory = [one.spread for one in model.memories for _ in one.names]
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
    at = 0.5 * (box.distance_min_m + box.distance_max_m) if distance is None else distance
    middle = np.zeros(windings.count)
    middle[:n] = box.current_limits_A[:n].mean(axis=1)
    there = windings.magnetics.state(np.asarray(at), middle)
    left = np.abs(there.inductance[n:, :n]) @ np.asarray(jumps) / np.diag(there.inductance)[n:]
    return np.hypot(left, there.motional_constant[n:] * speed / windings.resistances_ohm[n:])
