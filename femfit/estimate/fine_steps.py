"""A prediction in fine steps, for a caller that is not in a hurry.

One step a sample holds the inductance and rests a body at a stop; these follow iron that saturates within a sample,
and what a stop does to the body and the current. They are steps of Runge and Kutta, and with eddy currents, whose
fastest would make them many, extrapolated ones.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Stop
from femfit.estimate.constants import UNMOVED_KG
from femfit.estimate.noise import operating_distance
from femfit.estimate.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import blocked_by_diodes
from femfit.model.dynamics import LONGEST_STEP, currents_of_same_flux, extrapolated_step, motion_steps, runge_kutta_step

ROUNDING = 1e-9
"""Numerical: of a whole number of steps, which the last digit of an inductance must not make one more."""


def in_fine_steps(model: ActuatorModel, process: FilterProcess) -> FilterProcess:
    """A process of this model whose prediction takes fine steps."""
    # The one step's Jacobian is another; a filter takes that of this one over the width of its first estimate
    return process.predicting(partial(advance, model, unmoved(model), substeps(model)))


def unmoved(model: ActuatorModel) -> ActuatorModel:
    """The model of a body that nothing moves."""
    still = replace(
        model.require_motion(), mass_kg=UNMOVED_KG, gravity_m_s2=0.0, near_stop=None, far_stop=None, coulomb_N=0.0
    )
    return replace(model, motion=still)


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
    if _extrapolates(model):
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


def _extrapolates(model: ActuatorModel) -> bool:
    return model.eddy is not None


def _stepped(
    model: ActuatorModel, states: FloatArray, voltage: FloatArray, step: FloatArray | float, count: int
) -> FloatArray:
    """States after a step in so many parts; steps of their own have the shape (N, 1)."""
    if not _extrapolates(model):
        return runge_kutta_step(model, states, voltage, step, count)
    if isinstance(step, float) and not step:
        return states.copy()
    for _ in range(count):
        states = extrapolated_step(model, states, voltage, step / count)
    return states


def advance(
    model: ActuatorModel, still: ActuatorModel, count: int, states: FloatArray, voltage: FloatArray
) -> FloatArray:
    """States (N, n) one sample later, by so many steps; a body comes to rest at a stop, or bounces."""
    order, motion = model.order, model.require_motion()
    moved = states.copy()
    states = states.copy()
    states[:, 0] = np.clip(states[:, 0], *motion.ends)  # no body is beyond a stop, though an estimate's points are
    moved[:, :order] = _stepped(model, states[:, :order], voltage, model.sample_time_s, count)
    blocked_by_diodes(model, moved)
    for stop, outward in ((motion.near_stop, -1.0), (motion.far_stop, 1.0)):
        if stop is None:
            continue
        met = np.flatnonzero(outward * (moved[:, 0] - stop.distance_m) > 0.0)
        if len(met):
            after = moved[met, 1]
            moved[met, :order] = _stopped((model, still), count, (states[met, :order], after), voltage[met], stop)
    return moved


def _stopped(
    models: tuple[ActuatorModel, ActuatorModel],
    count: int,
    between: tuple[FloatArray, FloatArray],
    voltage: FloatArray,
    stop: Stop,
) -> FloatArray:
    """The step of bodies that meet a stop: up to it, and from there at rest on it, or back with what it returns.

    A body that lies on its stop stays there all the step: were it let through the stop and put back, the current would
    be that of a way that it does not go. ``between`` holds the states before, and the velocities of a free body after.
    """
    (model, still), (before, after) = models, between
    outward = 1.0 if stop is model.require_motion().far_stop else -1.0
    away, speed = -outward * (before[:, 0] - stop.distance_m), outward * before[:, 1]
    gain = (outward * after - speed) / model.sample_time_s
    with np.errstate(invalid="ignore", divide="ignore"):  # a body at rest on the stop is there at once
        time = 2.0 * away / (speed + np.sqrt(np.maximum(speed**2 + 2.0 * gain * away, 0.0)))
    time = np.clip(np.nan_to_num(time), 0.0, model.sample_time_s)
    met, end, comes = before.copy(), model.windings.end, np.flatnonzero(time)
    if len(comes):
        there = _stepped(model, before[comes], voltage[comes], time[comes, None], count)
        at_stop = np.full(len(comes), stop.distance_m)
        # What the parabola misses of the way, with the flux linkage kept
        there[:, 2:end] = currents_of_same_flux(model, there[:, 2:end], there[:, 0], at_stop)
        met[comes] = there
    met[:, 0] = stop.distance_m
    returned, met[:, 1] = -stop.restitution * outward * np.maximum(outward * met[:, 1], 0.0), 0.0
    rest_time = (model.sample_time_s - time)[:, None]
    result = _stepped(still, met, voltage, rest_time, count)
    result[:, 0], result[:, 1] = stop.distance_m, 0.0
    back = np.flatnonzero(returned)
    if len(back):
        met[back, 1] = returned[back]
        free = _stepped(model, met[back], voltage[back], rest_time[back], count)
        bounced = outward * (free[:, 0] - stop.distance_m) < 0.0  # else what presses it to the stop keeps it there
        result[back[bounced]] = free[bounced]
    return blocked_by_diodes(model, result)
