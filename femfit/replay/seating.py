"""When a body seats on a stop, told by what the filter reads, and how certain that is.

Where the estimate arrives at a stop, the filter is run again over a short stretch under rival hypotheses, side by side:
that the body seats at each of its samples, that it goes on, and that it lies on the stop all the time and the estimate
alone comes there, as one does that finds the body again once a current flows. A body that seats at a sample is free up
to it, lies on the stop there (its distance is read as that of the stop, without noise) with the part of its speed that
the stop returns and an unchanged flux linkage, and is kept by the stop from then on. The likelihood of the readings
weighs the hypotheses; that of an arrival within one sample is the density of the distance at the stop times |v| h.

References
----------
A. S. Willsky and H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108: likelihood ratios over the time of a jump.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.amount import amount, amount_range
from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.device.mechanics import Stop
from femfit.filters.cholesky import cholesky
from femfit.filters.error_bound import without_stops
from femfit.filters.filter import Filter
from femfit.filters.filter_state import FilterState
from femfit.filters.fine_steps import in_fine_steps
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import currents_of_same_flux
from femfit.replay.constants import APART, AT_REST, BEYOND, CERTAIN, LEAST_CONFIDENCE, LEAST_UNSEATED, SEAT_BEFORE
from femfit.replay.prepare import Prepared
from femfit.replay.run_filter import Replayed

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

    def __str__(self) -> str:
        speed = amount(abs(self.velocity_m_s), "m/s")
        if self.confidence < LEAST_CONFIDENCE:
            at = amount(self.time_s, "s", 3)
            return f"The estimate reaches the {self.stop} stop at {at}; the record does not tell whether the body does."
        sure = "more than 99.9 %" if self.confidence > CERTAIN else amount(self.confidence, "", 3)
        span = amount_range(self.low_s, self.high_s, "s", 4)
        return f"Seats on the {self.stop} stop at {span} with {speed}, {sure} certain."


def find_seatings(prepared: Prepared, built: Filter, replayed: Replayed) -> tuple[Seating, ...]:
    """Every arrival of the estimate at a stop, in order of time."""
    motion, found = prepared.model.require_motion(), []
    sides: tuple[tuple[Side, Stop | None], ...] = (("near", motion.near_stop), ("far", motion.far_stop))
    for side, stop in sides:
        if stop is not None and stop.stiffness_N_per_m is None:
            outward = -1.0 if side == "near" else 1.0
            for row in _arrivals(prepared, replayed, stop.distance_m, outward):
                one = _judged(prepared, built, replayed, row, (side, stop, outward))
                found += [] if one is None else [one]
    return tuple(sorted(found, key=lambda one: one.time_s))


def _arrivals(prepared: Prepared, replayed: Replayed, stop: float, outward: float) -> Iterator[int]:
    """Rows at which the estimate first is at a stop, to within a sample's way, after it was away from it."""
    box = prepared.model.validity
    stroke = box.distance_max_m - box.distance_min_m
    off = -outward * (replayed.mean[:, 0] - stop)
    way = np.maximum(LEAST_UNSEATED * stroke, np.abs(replayed.mean[:, 1]) * prepared.model.sample_time_s)
    near = off <= np.maximum(way, np.r_[0.0, way[:-1]])
    away = False
    begins = set(prepared.log.begins.tolist())
    for row, (distance, there) in enumerate(zip(off.tolist(), near.tolist(), strict=True)):
        away = (away and row not in begins) or distance > APART * stroke
        if away and there:
            yield row
            away = False


@dataclass
class _Rivals:
    """The hypotheses of a stretch side by side: the first lies on the stop, the last never seats."""

    seats: IntArray  # Row at which each seats, before all rows where it lies there
    likelihood: FloatArray
    overshoot_s: FloatArray  # By which the stop was passed before its sample
    velocity: FloatArray


def _judged(
    prepared: Prepared, built: Filter, replayed: Replayed, row: int, at: tuple[Side, Stop, float]
) -> Seating | None:
    side, stop, outward = at
    step, log = prepared.model.sample_time_s, prepared.log
    recent = np.arange(max(row - SEAT_BEFORE, 0), row)
    before = int(recent[np.argmax(outward * replayed.mean[recent, 1])]) if len(recent) else row
    speed = outward * replayed.mean[before, 1]
    box = prepared.model.validity
    if not speed > 0.0:
        return None
    beyond = max(2, int(np.ceil(BEYOND * (box.distance_max_m - box.distance_min_m) / (speed * step))))
    spread = int(np.ceil(3.0 * replayed.deviation[before, 0] / (speed * step)))
    begin = int(log.begins[log.begins <= row].max())
    first, last = max(begin + 1, row - SEAT_BEFORE - spread), min(row + spread + beyond, len(prepared.time_s) - 1)
    start = max(begin, first - 5 * SEAT_BEFORE)
    candidates = np.arange(first, min(row + spread + 1, last - 1) + 1)
    if len(candidates) < 2:
        return None
    rivals = run_rivals(prepared, built, (start, last), candidates, (stop, outward, replayed))
    if not np.isfinite(rivals.likelihood).any():
        return None
    weight = np.exp(rivals.likelihood - np.nanmax(rivals.likelihood))
    weight = np.nan_to_num(weight)
    if weight[0] > LEAST_CONFIDENCE * weight.sum():
        return None
    confidence = weight[1:-1].sum() / weight.sum()
    if not weight[1:-1].sum() > 0.0:
        return Seating(side, float(prepared.time_s[row]), np.nan, np.nan, outward * speed, float(confidence))
    share = weight[1:-1] / weight[1:-1].sum()
    times = prepared.time_s[candidates] - rivals.overshoot_s[1:-1]
    mean = float(share @ times)
    # A sample is seen as a whole: the time within it comes from the speed alone
    deviation = float(np.sqrt(share @ (times - mean) ** 2 + step**2 / 12.0))
    velocity = float(share @ rivals.velocity[1:-1])
    return Seating(side, mean, mean - 1.96 * deviation, mean + 1.96 * deviation, velocity, float(confidence))


def run_rivals(
    prepared: Prepared,
    built: Filter,
    rows: tuple[int, int],
    candidates: IntArray,
    at: tuple[Stop, float, Replayed],
) -> _Rivals:
    """The likelihood of the readings for a body that lies on the stop, that seats at each candidate, or goes on."""
    stop, outward, replayed = at
    model, log = prepared.model, prepared.log
    free = replace(built, process=in_fine_steps(without_stops(model), built.process))
    start, last = rows
    seats = np.concatenate([[start], candidates, [last + 1]])
    runs = len(seats)
    state = built.start(np.tile(replayed.mean[start], (runs, 1)), replayed.covariance[start])
    rivals = _Rivals(seats, np.zeros(runs), np.zeros(runs), np.zeros(runs))
    # The less likely, the less the estimate allows for it
    rivals.likelihood[0] = -0.5 * (stop.distance_m - state.mean[0, 0]) ** 2 / state.covariance[0, 0, 0]
    state = _lying(state, stop)
    for row in range(start + 1, last + 1):
        volts = np.full(runs, log.inputs[row])
        seated, now = rivals.seats < row, rivals.seats == row
        state = _lying(_either(free.predict(state, volts), built.predict(state, volts), seated), stop)
        if now.any():
            state = _seat(model, state, now, (stop, outward), rivals)
        readings = np.tile(log.readings[row], (runs, 1))
        state = built.update(state, readings[:, 0] if readings.shape[1] == 1 else readings)
        innovation, variance = state.innovation.reshape(runs, -1), state.innovation_variance.reshape(runs, -1)
        each = np.where(np.isfinite(innovation), innovation**2 / variance + np.log(variance), 0.0)
        rivals.likelihood -= 0.5 * each.sum(axis=1)
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
    model: ActuatorModel, state: FilterState, now: BoolArray, at: tuple[Stop, float], rivals: _Rivals
) -> FilterState:
    """The state of the runs that seat: the distance read as the stop's, the speed returned, the flux linkage kept."""
    stop, outward = at
    mean, covariance = state.mean.copy(), state.covariance.copy()
    variance = covariance[now, 0, 0]
    gap = stop.distance_m - mean[now, 0]
    speed = np.maximum(outward * mean[now, 1], np.finfo(float).tiny)
    rivals.overshoot_s[now] = np.clip(-outward * gap / speed, 0.0, model.sample_time_s)
    rivals.velocity[now] = mean[now, 1]
    density = -0.5 * (gap**2 / variance + np.log(2.0 * np.pi * variance))
    rivals.likelihood[now] += density + np.log(speed * model.sample_time_s)
    passed = outward * np.maximum(-outward * gap, 0.0)
    d = np.full(int(now.sum()), stop.distance_m)
    end = 2 + len(model.circuits)
    mean[now, 2:end] = currents_of_same_flux(model, mean[now, 2:end], d + passed, d)
    mean[now, 0], mean[now, 1] = stop.distance_m, -stop.restitution * mean[now, 1]
    # What is left of the distance is nothing beside a step; the speed's deviation is returned with it
    scale = np.ones(mean.shape[1])
    scale[0], scale[1] = AT_REST, max(stop.restitution, 0.1)
    covariance[now] = covariance[now] * np.outer(scale, scale)
    return replace(state, mean=mean, covariance=covariance, factor=cholesky(covariance)[0])


def _either(free: FilterState, kept: FilterState, seated: BoolArray) -> FilterState:
    """The prediction of each run: of a free body, or of one that its stop keeps."""
    names = ("mean", "covariance", "factor", "innovation", "innovation_variance", "out_of_band", "outcome")
    values = {}
    for name in names:
        one, other = getattr(free, name), getattr(kept, name)
        values[name] = np.where(seated.reshape(-1, *([1] * (one.ndim - 1))), other, one)
    return FilterState(**values)
