"""Steps of a model's equations by other methods than the package's, as a reference."""

import numpy as np

from femfit.model.dynamics import evaluated, state_derivative


def exponential_step(model, state, voltage, step, *, free=True):
    """States (..., order) one step of the equations later; steps of their own have the shape (..., 1)."""
    length = None if isinstance(step, np.ndarray) else float(step)
    return evaluated(model, model.equations.step(length), state, voltage, step=step, free=free)


def runge_kutta_step(model, state, voltage, step, substeps=1, *, free=True):
    """Advance by classical fourth-order Runge-Kutta with equal substeps; steps of their own have the shape (..., 1)."""
    h = step / substeps
    for _ in range(substeps):
        k1 = state_derivative(model, state, voltage, free=free)
        k2 = state_derivative(model, state + 0.5 * h * k1, voltage, free=free)
        k3 = state_derivative(model, state + 0.5 * h * k2, voltage, free=free)
        k4 = state_derivative(model, state + h * k3, voltage, free=free)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def between_rigid_stops(model, state, voltage, step, count):
    """States (N, order) after so many short steps of Runge and Kutta, none of which ends beyond the two stops."""
    near, far = model.motion.ends
    for _ in range(count):
        free = runge_kutta_step(model, state, voltage, step)
        met = (free[:, 0] <= near) | (free[:, 0] >= far)
        reached = np.clip(free[:, 0], near, far)
        going = np.column_stack([state[:, 0], (reached - state[:, 0]) / step, state[:, 2:]])
        held = runge_kutta_step(model, going, voltage, step, free=False)
        stops = model.motion.near_stop, model.motion.far_stop
        restitution = np.where(free[:, 0] <= near, *(stop.restitution for stop in stops))
        stopped = np.column_stack([reached, -restitution * free[:, 1], held[:, 2:]])
        state = np.where(met[:, None], stopped, free)
    return state


def fastest_time_constant(model, distance):
    """Smallest L/R of all windings without current, in s."""
    windings = model.windings
    inductance = windings.magnetics.inductance(np.array(distance), np.zeros(windings.count)) + windings.series_H
    return 1.0 / np.linalg.eigvals(np.linalg.solve(inductance, np.diag(windings.resistances_ohm))).real.max()
