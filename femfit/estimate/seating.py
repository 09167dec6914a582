"""When a body seats on a stop, told by what the filter reads, and how certain that is.

Where the estimate arrives at a stop, the filter is run again over a short stretch under rival hypotheses, side by side:
that the body seats at each of its samples, that it goes on, and that it lies on the stop all the time and the estimate
alone comes there, as one does that finds the body again once a current flows. A body that seats at a sample is free up
to it, lies on the stop there (its distance is read as that of the stop, without noise) with the part of its speed that
the stop returns and an unchanged flux linkage, and is kept by the stop from then on. The likelihood of the readings
weighs the hypotheses; that of an arrival within one sample is the density of the distance at the stop times |v| h.
A weight says which is the best, and not that it is right: a seating is told only where the filter is not lost, the
innovations of the best are as large as the filter says, and the body could have been as fast.

References
----------
A. S. Willsky and H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108: likelihood ratios over the time of a jump.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.device.mechanics import Stop
from femfit.estimate.constants import (
    APART,
    AT_REST,
    BEYOND,
    FOLLOWED,
    LEAST_CONFIDENCE,
    LEAST_UNSEATED,
    SEAT_BEFORE,
    WORK_POINTS,
)
from femfit.estimate.filter import Filter
from femfit.estimate.noise import consistency_band
from femfit.estimate.prepare import Prepared
from femfit.estimate.process import FilterOutcome, FilterState, cholesky
from femfit.estimate.run_filter import Replayed
from femfit.estimate.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import currents_of_same_flux

Side = Literal["near", "far"]


@dataclass(frozen=True)
class Seating:
    """One arrival at a stop."""

    stop: Side
    time_s: float
    low_s: float  # 95 % interval
    high_s: float
    velocity_m_s: float
    confidence: float  # Probability that it seated rather than went on or lay there, all as likely beforehand
    followed: bool = True  # Whether the filter explains the readings there

    def __str__(self) -> str:
        return sentence("observe", "seating", self)


def find_seatings(prepared: Prepared, built: Filter, replayed: Replayed) -> tuple[Seating, ...]:
    """Every arrival of the estimate at a stop, in order of time."""
    motion, seatings = prepared.model.require_motion(), []
    sides: tuple[tuple[Side, Stop | None], ...] = (("near", motion.near_stop), ("far", motion.far_stop))
    for side, stop in sides:
        if stop is not None and stop.stiffness_N_per_m is None:
            outward = -1.0 if side == "near" else 1.0
            for rows in _arrivals(prepared, replayed, stop.distance_m, outward):
                seating = _judged(prepared, built, replayed, rows, (side, stop, outward))
                seatings += [] if seating is None else [seating]
    return tuple(sorted(seatings, key=lambda seating: seating.time_s))


def _arrivals(prepared: Prepared, replayed: Replayed, stop: float, outward: float) -> Iterator[tuple[int, int]]:
    """Rows at which the estimate first is at a stop, to within a sample's way, and last was at it before."""
    box = prepared.model.validity
    stroke = box.distance_max_m - box.distance_min_m
    off = -outward * (replayed.mean[:, 0] - stop)
    way = np.maximum(LEAST_UNSEATED * stroke, np.abs(replayed.mean[:, 1]) * prepared.model.sample_time_s)
    near = off <= np.maximum(way, np.r_[0.0, way[:-1]])
    away, touched = False, -1
    begins = set(prepared.log.begins.tolist())
    for row, (distance, there) in enumerate(zip(off.tolist(), near.tolist(), strict=True)):
        away = (away and row not in begins) or distance > APART * stroke
        if away and there:
            yield row, touched
            away = False
        touched = row if there else touched


def fastest(model: ActuatorModel, outward: float) -> float:
    """The largest speed in m/s at which a body arrives at a stop.

    Force and driver's currents do no more than W, the work over the stroke of the largest force there is towards the
    stop at each distance; the other stop leaves a part e^2 of what the body brings along: m v^2 / 2 <= W / (1 - e^2).
    """
    motion, box = model.require_motion(), model.validity
    distance, currents = box.grid(WORK_POINTS, WORK_POINTS, several=3)
    force = outward * (motion.static_force(distance) - model.magnetics.force(distance, currents))
    places, which = np.unique(distance, return_inverse=True)
    most = np.zeros(len(places))
    np.maximum.at(most, which, force)
    work = float(np.sum(0.5 * (most[1:] + most[:-1]) * np.diff(places)))
    returned = max((stop.restitution for stop in (motion.near_stop, motion.far_stop) if stop is not None), default=0.0)
    lost_share = 1.0 - returned**2
    return float(np.sqrt(2.0 * work / (motion.mass_kg * lost_share))) if lost_share > 0.0 else np.inf


@dataclass
class _Rivals:
    """The hypotheses of a stretch side by side: the first lies on the stop, the last never seats."""

    seats: IntArray  # Row at which each seats, before all rows where it lies there
    likelihood: FloatArray
    overshoot_s: FloatArray  # By which the stop was passed before its sample
    velocity: FloatArray
    squares: FloatArray  # Sum of the normalised innovations' squares
    count: int = 0  # Of these innovations


def _judged(
    prepared: Prepared, built: Filter, replayed: Replayed, rows: tuple[int, int], place: tuple[Side, Stop, float]
) -> Seating | None:
    (side, stop, outward), (row, touched) = place, rows
    step, log = prepared.model.sample_time_s, prepared.log
    recent = np.arange(max(row - SEAT_BEFORE, 0), row)
    before = int(recent[np.argmax(outward * replayed.mean[recent, 1])]) if len(recent) else row
    speed = outward * replayed.mean[before, 1]
    box = prepared.model.validity
    if not speed > 0.0:
        return None
    unknown = Seating(side, float(prepared.time_s[row]), np.nan, np.nan, outward * speed, 0.0, followed=False)
    if replayed.outcome[row] != FilterOutcome.RUNNING:
        return unknown
    beyond = max(2, int(np.ceil(BEYOND * (box.distance_max_m - box.distance_min_m) / (speed * step))))
    spread = int(np.ceil(3.0 * replayed.deviation[before, 0] / (speed * step)))
    begin = int(log.begins[log.begins <= row].max())
    first, last = max(begin + 1, row - SEAT_BEFORE - spread), min(row + spread + beyond, len(prepared.time_s) - 1)
    first = max(first, touched + 2)
    start = max(begin, touched + 1, first - 5 * SEAT_BEFORE)
    candidates = np.arange(first, min(row + spread + 1, last - 1) + 1)
    if len(candidates) < 2:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # a rival that breaks down is set aside
        rivals = run_rivals(prepared, built, (start, last), candidates, (stop, outward, replayed))
    return _weighed(prepared, rivals, prepared.time_s[candidates], outward, unknown)


def _weighed(
    prepared: Prepared, rivals: _Rivals, times: FloatArray, outward: float, unknown: Seating
) -> Seating | None:
    """What the likelihoods say of an arrival; ``unknown`` where the filter explains the readings by none of them."""
    if not np.isfinite(rivals.likelihood).any():
        return unknown
    weight = np.exp(rivals.likelihood - rivals.likelihood.max())
    if weight[0] > LEAST_CONFIDENCE * weight.sum():
        return None
    best, seated = int(np.argmax(weight)), weight[1:-1].sum()
    if rivals.count and rivals.squares[best] > rivals.count * consistency_band(rivals.count, FOLLOWED).upper:
        return unknown
    if not seated > 0.0:
        return replace(unknown, followed=True)
    share, times = weight[1:-1] / seated, times - rivals.overshoot_s[1:-1]
    mean, velocity = float(share @ times), float(share @ rivals.velocity[1:-1])
    if abs(velocity) > fastest(prepared.model, outward):
        return unknown
    # A sample is seen as a whole: the time within it comes from the speed alone
    deviation = float(np.sqrt(share @ (times - mean) ** 2 + prepared.model.sample_time_s**2 / 12.0))
    low, high = mean - 1.96 * deviation, mean + 1.96 * deviation
    return Seating(unknown.stop, mean, low, high, velocity, float(seated / weight.sum()))


def run_rivals(
    prepared: Prepared,
    built: Filter,
    rows: tuple[int, int],
    candidates: IntArray,
    place: tuple[Stop, float, Replayed],
) -> _Rivals:
    """The likelihood of the readings for a body that lies on the stop, that seats at each candidate, or goes on."""
    stop, outward, replayed = place
    model, log = prepared.model, prepared.log
    # An impact at the other stop may lie in the stretch
    motion = model.require_motion()
    motion = replace(motion, near_stop=None) if outward < 0.0 else replace(motion, far_stop=None)
    without = replace(model, motion=motion)
    free = replace(built, process=built.process.predicting(model=without))
    start, last = rows
    seats = np.concatenate([[start], candidates, [last + 1]])
    runs = len(seats)
    state = built.start(np.tile(replayed.mean[start], (runs, 1)), replayed.covariance[start])
    rivals = _Rivals(seats, np.zeros(runs), np.zeros(runs), np.zeros(runs), np.zeros(runs))
    # The less likely, the less the estimate allows for it
    rivals.likelihood[0] = -0.5 * (stop.distance_m - state.mean[0, 0]) ** 2 / state.covariance[0, 0, 0]
    state = _lying(state, stop)
    for row in range(start + 1, last + 1):
        volts = np.repeat(log.inputs[row][None], runs, axis=0)
        seated, now = rivals.seats < row, rivals.seats == row
        state = _lying(free.predict(state, volts).with_runs(seated, built.predict(state, volts).of_runs(seated)), stop)
        if now.any():
            state = _seat(model, state, now, (stop, outward), rivals)
        readings = np.tile(log.readings[row], (runs, 1))
        state = built.update(state, readings)
        innovation, variance = state.innovation.reshape(runs, -1), state.innovation_variance.reshape(runs, -1)
        read = np.isfinite(log.readings[row])
        squares = (innovation[:, read] ** 2 / variance[:, read]).sum(axis=1)
        rivals.likelihood -= 0.5 * (squares + np.log(variance[:, read]).sum(axis=1))
        rivals.squares += squares
        rivals.count += int(read.sum())
    broken = ~np.isfinite(rivals.likelihood) | ~np.isfinite(state.mean).all(axis=1)
    rivals.likelihood[broken] = -np.inf
    return rivals


def _lying(state: FilterState, stop: Stop) -> FilterState:
    """The states with that of the first run at rest on the stop."""
    mean, covariance = state.mean.copy(), state.covariance.copy()
    mean[0, :2] = stop.distance_m, 0.0
    scale = np.ones(mean.shape[1])
    scale[:2] = AT_REST
    covariance[0] *= np.outer(scale, scale)
    return replace(state, mean=mean, covariance=covariance, factor=cholesky(covariance)[0])


def _seat(
    model: ActuatorModel, state: FilterState, now: BoolArray, place: tuple[Stop, float], rivals: _Rivals
) -> FilterState:
    """The state of the runs that seat: the distance read as the stop's, the speed returned, the flux linkage kept."""
    stop, outward = place
    mean, covariance = state.mean.copy(), state.covariance.copy()
    variance = covariance[now, 0, 0]
    gap = stop.distance_m - mean[now, 0]
    moves = outward * mean[now, 1] > 0.0  # a body that moves away does not arrive
    speed = np.where(moves, outward * mean[now, 1], 1.0)
    rivals.overshoot_s[now] = np.where(moves, np.clip(-outward * gap / speed, 0.0, model.sample_time_s), 0.0)
    rivals.velocity[now] = np.where(moves, mean[now, 1], 0.0)
    density = -0.5 * (gap**2 / variance + np.log(2.0 * np.pi * variance))
    rivals.likelihood[now] += np.where(moves, density + np.log(speed * model.sample_time_s), -np.inf)
    passed = outward * np.maximum(-outward * gap, 0.0)
    d = np.full(int(now.sum()), stop.distance_m)
    end = model.windings.end
    mean[now, 2:end] = currents_of_same_flux(model, mean[now, 2:end], d + passed, d)
    mean[now, 0], mean[now, 1] = stop.distance_m, -stop.restitution * mean[now, 1]
    # What is left of the distance is nothing beside a step; the speed's deviation is returned with it
    scale = np.ones(mean.shape[1])
    scale[0], scale[1] = AT_REST, max(stop.restitution, 0.1)
    covariance[now] = covariance[now] * np.outer(scale, scale)
    return replace(state, mean=mean, covariance=covariance, factor=cholesky(covariance)[0])
