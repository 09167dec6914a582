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
