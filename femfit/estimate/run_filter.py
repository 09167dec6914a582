"""A filter over a long record, in pieces that run side by side.

One filter after the other costs hundreds of microseconds a sample; a thousand at once cost little more. The record is
cut into pieces. All of them run from a guess; each then runs again from the end of the one before, until every piece
begins where its neighbour ended. A filter forgets its start, so that two or three turns do for most; a piece that has
not forgotten is run again until it is the sequential result.

A prediction in fine steps, for a caller that is not in a hurry.

One step a sample holds the inductance and rests a body at a stop; these follow iron that saturates within a sample,
and what a stop does to the body and the current. They are steps of Runge and Kutta, and with eddy currents, whose
fastest would make them many, extrapolated ones.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.device.mechanics import Stop
from femfit.estimate.constants import JOINED, LONGEST_PIECE, SHORTEST_PIECE, UNMOVED_KG
from femfit.estimate.filter import Filter
from femfit.estimate.levitation import fastest_time_constant
from femfit.estimate.noise import operating_distance
from femfit.estimate.process import FilterProcess, FilterState
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import blocked_by_diodes
from femfit.model.dynamics import LONGEST_STEP, currents_of_same_flux, extrapolated_step, motion_steps, runge_kutta_step


class Log(NamedTuple):
    """What a filter is fed with: inputs held from the sample before, readings, and where stretches begin."""

    inputs: FloatArray  # (samples,)
    readings: FloatArray  # (samples, sensors); NaN where missing
    begins: IntArray  # Indices of the first samples of stretches without a gap, ascending from 0
    guesses: FloatArray  # First estimate of every sample, of which pieces take theirs; (samples, n)
    held: BoolArray  # Whether the body stands still, whatever the forces say; (samples,)
    limits: FloatArray  # The end of the range at which a reading is clipped; (samples, sensors), NaN where it is not
    side: FloatArray  # 1 where what is clipped lies above that end, -1 where below


@dataclass(frozen=True, eq=False)
class Replayed:
    """A record as a filter saw it; arrays have one row a sample."""

    predicted: FloatArray  # Before the sample's readings; (samples, n)
    mean: FloatArray  # After them; (samples, n)
    covariance: FloatArray  # (samples, n, n)
    innovation: FloatArray  # (samples, sensors)
    variance: FloatArray  # (samples, sensors)
    outcome: IntArray  # (samples,), a :class:`FilterOutcome` each
    turns: int  # How often pieces were run until they joined

    @cached_property
    def deviation(self) -> FloatArray:
        """Standard deviations, (samples, n)."""
        with np.errstate(invalid="ignore"):  # of a run that has lost its covariance
            return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def replay(filter_: Filter, log: Log, resting: Filter | None = None) -> Replayed:
    """Run a filter over all stretches of a record; where the body is held, ``resting`` predicts in its place."""
    pieces = _cut(log)
    order, sensors, samples = filter_.process.order, log.readings.shape[1], len(log.inputs)
    states = [np.full((samples, *shape), np.nan) for shape in ((order,), (order,), (order, order))]
    innovations = [np.full((samples, sensors), np.nan) for _ in range(2)]
    result = Replayed(states[0], states[1], states[2], innovations[0], innovations[1], np.zeros(samples, np.intp), 0)
    start = filter_.start(log.guesses[pieces.first])
    used, ends, todo, turns = start, start, np.arange(len(pieces.first)), 0
    while len(todo):
        ends = _put(ends, todo, _run((filter_, resting), log, pieces, todo, _take(used, todo), result))
        turns += 1
        wanted = _put(used, pieces.follows, _take(ends, pieces.follows - 1))
        todo = np.flatnonzero(~_joined(used, wanted))
        used = _put(used, todo, _take(wanted, todo))
    clipped = np.isfinite(log.limits)  # a bound is no reading, and says nothing of the noise
    innovation, variance = (np.where(clipped, np.nan, values) for values in (result.innovation, result.variance))
    return replace(result, innovation=innovation, variance=variance, turns=turns)


class _Pieces(NamedTuple):
    first: IntArray
    length: IntArray
    opens: BoolArray  # Whether it begins a stretch
    follows: IntArray  # Numbers of those that do not


def _cut(log: Log) -> _Pieces:
    samples = len(log.inputs)
    size = int(np.clip(np.sqrt(samples), SHORTEST_PIECE, LONGEST_PIECE))
    ends = np.append(log.begins[1:], samples)
    first = np.concatenate([np.arange(a, b, size) for a, b in zip(log.begins, ends, strict=True)])
    length = np.diff(np.append(first, samples))
    opens = np.isin(first, log.begins)
    return _Pieces(first, length, opens, np.flatnonzero(~opens))


def _run(
    filters: tuple[Filter, Filter | None],
    log: Log,
    pieces: _Pieces,
    which: IntArray,
    state: FilterState,
    result: Replayed,
) -> FilterState:
    """Run some pieces side by side and write down what they saw; returns their last states."""
    filter_, resting = filters
    first, length, opens = pieces.first[which], pieces.length[which], pieces.opens[which]
    last = state
    for j in range(int(length.max())):
        alive = length > j
        row = np.minimum(first + j, len(log.inputs) - 1)
        held = log.held[row] if resting is not None else np.zeros(len(row), dtype=bool)
        moved = state
        for predicting, here in ((filter_, np.flatnonzero(~held)), (resting, np.flatnonzero(held))):
            if predicting is not None and len(here):
                moved = _put(moved, here, predicting.predict(_take(state, here), log.inputs[row[here]]))
        if j == 0 and opens.any():  # nothing moves before the first sample
            moved = _put(moved, np.flatnonzero(opens), _take(state, np.flatnonzero(opens)))
        readings = np.where(alive[:, None], _bounded(filter_, log, row, moved), np.nan)
        state = filter_.update(moved, readings)
        here = row[alive]
        result.predicted[here], result.mean[here] = moved.mean[alive], state.mean[alive]
        result.covariance[here] = state.covariance[alive]
        shape = (len(which), readings.shape[1])
        result.innovation[here] = state.innovation.reshape(shape)[alive]
        result.variance[here] = state.innovation_variance.reshape(shape)[alive]
        result.outcome[here] = state.outcome[alive]
        ended = np.flatnonzero(length == j + 1)
        last = _put(last, ended, _take(state, ended)) if len(ended) else last
    return last


def _bounded(filter_: Filter, log: Log, row: IntArray, moved: FilterState) -> FloatArray:
    """Readings, and the end of the range for a clipped one that is predicted within it: it is no less than that."""
    readings = log.readings[row]
    for k, output in enumerate(filter_.process.outputs):
        limit, side = log.limits[row, k], log.side[row, k]
        if np.isfinite(limit).any():
            inside = side * (limit - output.measure(moved.mean)) > 0.0
            readings[:, k] = np.where(np.isfinite(limit), np.where(inside, limit, np.nan), readings[:, k])
    return readings


def _joined(used: FilterState, wanted: FilterState) -> BoolArray:
    """Whether two starts of each piece are the same to :data:`JOINED`; what broke down stays as it is."""
    variance = np.diagonal(wanted.covariance, axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        near = np.abs(used.mean - wanted.mean) <= JOINED * np.sqrt(variance)
        alike = np.abs(np.diagonal(used.covariance, axis1=1, axis2=2) - variance) <= JOINED * variance
    both = np.isnan(used.mean) & np.isnan(wanted.mean)
    return np.asarray(((near & alike) | both).all(axis=1) & (used.outcome == wanted.outcome))


def _take(state: FilterState, which: IntArray) -> FilterState:
    return FilterState.of_fields(lambda name: getattr(state, name)[which])


def _put(state: FilterState, which: IntArray, changed: FilterState) -> FilterState:
    def value(name: str) -> NDArray[Any]:
        old, new = getattr(state, name), getattr(changed, name)
        result = np.array(old) if old.shape[1:] == new.shape[1:] else np.full((len(old), *new.shape[1:]), np.nan)
        result[which] = new
        return result

    return FilterState.of_fields(value)


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


def substeps(model: ActuatorModel) -> int:
    """Steps in a sample: none is longer than the fastest coil's time constant, or too long for the motion."""
    if not model.windings.count:
        return 1
    if _extrapolates(model):
        return motion_steps(model)
    fastest = fastest_time_constant(model, operating_distance(model))
    steps = model.sample_time_s / fastest / LONGEST_STEP
    return max(1, int(np.ceil(steps * (1.0 - ROUNDING))))


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
