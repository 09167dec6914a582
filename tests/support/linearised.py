"""Small sinusoidal currents of all windings about a bias, by the linearised equations of motion, the body held."""

import numpy as np

from femfit.model.dynamics import state_jacobian


def by_volt(model, distance, bias, frequency):
    """Currents (windings, circuits) in A for a volt at each circuit."""
    n, windings = len(model.circuits), model.windings
    state = np.zeros((1, model.order))
    state[0, 0], state[0, 2 : 2 + n] = distance, bias
    volts = (model.resistances_ohm * bias)[None]
    slopes = state_jacobian(model, state, volts if n > 1 else volts[:, 0])[0, 2:, 2:]
    inductance = windings.magnetics.inductance(np.asarray(distance), state[0, 2:]) + windings.series_H
    return np.linalg.solve(2j * np.pi * frequency * np.eye(windings.count) - slopes, np.linalg.inv(inductance)[:, :n])
