"""A prediction in steps of Runge and Kutta, for a caller that is not in a hurry.

One step a sample holds the inductance and rests a body at a stop; these follow iron that saturates within a sample,
and what a stop does to the body and the current.
"""

from functools import partial

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.levitation import blocked_by_diodes, fastest_time_constant, kept_between_stops
from femfit.filters.noise import operating_distance
from femfit.filters.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import LONGEST_STEP, currents_of_same_flux, runge_kutta_step


def in_fine_steps(model: ActuatorModel, process: FilterProcess) -> FilterProcess:
    """A process of this model whose prediction takes steps of Runge and Kutta."""
    # The one step's Jacobian is another; a filter takes that of this one over the width of its first estimate
    return process.predicting(partial(advance, model, substeps(model)))


def substeps(model: ActuatorModel) -> int:
    """Steps in a sample, so that none is longer than the fastest coil's time constant."""
    if not model.circuits:
        return 1
    fastest = fastest_time_constant(model, operating_distance(model))
    return max(1, int(np.ceil(model.sample_time_s / fastest / LONGEST_STEP)))


def advance(model: ActuatorModel, count: int, states: FloatArray, voltage: FloatArray) -> FloatArray:
    """States (N, n) one sample later, by so many steps; a body comes to rest at a stop, or bounces."""
    order, ends = model.order, model.require_motion().ends
    moved = runge_kutta_step(model, states[:, :order], voltage, model.sample_time_s, count)
    blocked_by_diodes(model, moved)
    moved = np.concatenate([moved, states[:, order:]], axis=1)
    if ends == (-np.inf, np.inf):
        return moved
    beyond = moved[:, 0].copy()
    kept = kept_between_stops(model, _rebounding(model, states, moved))
    turned = np.flatnonzero(kept[:, 0] != beyond)
    if len(turned):  # the flux linkage goes on at U - R i, wherever within the step the body was stopped
        end = 2 + len(model.circuits)
        kept[turned, 2:end] = currents_of_same_flux(model, kept[turned, 2:end], beyond[turned], kept[turned, 0])
    return blocked_by_diodes(model, kept)


def _rebounding(model: ActuatorModel, before: FloatArray, after: FloatArray) -> FloatArray:
    """What arrives at a stop goes back with the part of its speed that the stop returns; changes ``after``.

    Not where it would be back within the step: what presses it to the stop then keeps it there.
    """
    motion = model.require_motion()
    for stop, outward in ((motion.near_stop, -1.0), (motion.far_stop, 1.0)):
        if stop is None or not stop.restitution:
            continue
        beyond = outward * (after[:, 0] - stop.distance_m)
        gained = outward * (after[:, 1] - before[:, 1])
        hits = (beyond >= 0.0) & (outward * (before[:, 0] - stop.distance_m) < 0.0)
        hits &= 2.0 * stop.restitution * outward * after[:, 1] > gained
        after[:, 0] = np.where(hits, stop.distance_m - outward * stop.restitution * beyond, after[:, 0])
        after[:, 1] = np.where(hits, -stop.restitution * after[:, 1], after[:, 1])
    return after
