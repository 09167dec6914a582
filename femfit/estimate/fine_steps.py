"""A prediction in fine steps, for a caller that is not in a hurry.

One step a sample holds the inductance; these follow iron that saturates within a sample. They are steps of Runge and
Kutta, and with eddy currents, whose fastest would make them many, extrapolated ones.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.estimate.noise import operating_distance
from femfit.estimate.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.contact import step_between_stops
from femfit.model.drive import blocked_by_diodes
from femfit.model.dynamics import LONGEST_STEP, accurate_step, motion_steps

ROUNDING = 1e-9
"""Numerical: of a whole number of steps, which the last digit of an inductance must not make one more."""


def in_fine_steps(model: ActuatorModel, process: FilterProcess) -> FilterProcess:
    """A process of this model whose prediction takes fine steps."""
    # The one step's Jacobian is another; a filter takes that of this one over the width of its first estimate
    return process.predicting(partial(advance, model, substeps(model)))


def substeps(model: ActuatorModel, distances: Sequence[float] = ()) -> int:
    """Steps in a sample: none is longer than the fastest coil's time constant, or too long for the motion.

    With eddy currents, whose steps are exact for the fastest decay, the motion sets their length.

    Parameters
    ----------
    distances : sequence of float
        Where, in m; at the operating point where empty.
    """
    if not model.windings.count:
        return 1
    if model.eddy is not None:
        return motion_steps(model)
    fastest = min(fastest_time_constant(model, distance) for distance in distances or [operating_distance(model)])
    steps = model.sample_time_s / fastest / LONGEST_STEP
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


def advance(model: ActuatorModel, count: int, states: FloatArray, voltage: FloatArray) -> FloatArray:
    """States (N, n) one sample later, by so many steps; a body comes to rest at a stop, or bounces."""
    step, moved = model.sample_time_s / count, states.copy()
    within = moved[:, : model.order]
    for _ in range(count):
        within = step_between_stops(
            model, within, step, lambda begun, free: accurate_step(model, begun, voltage, step, free=free)
        )
    moved[:, : model.order] = blocked_by_diodes(model, within)
    return moved


def stay(model: ActuatorModel, count: int, states: FloatArray, voltage: FloatArray) -> FloatArray:
    """The same of bodies that stand where they are."""
    step, still = model.sample_time_s / count, states.copy()
    still[:, 1] = 0.0
    for _ in range(count):
        still[:, : model.order] = accurate_step(model, still[:, : model.order], voltage, step, free=False)
    blocked_by_diodes(model, still)
    return still
