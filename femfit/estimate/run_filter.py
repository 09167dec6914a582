"""A filter over a long record, in pieces that run side by side.

One filter after the other costs hundreds of microseconds a sample; a thousand at once cost little more. The record is
cut into pieces. All of them run from a guess; each then runs again from the end of the one before, until every piece
begins where its neighbour ended. A filter forgets its start, so that some ten turns do for most; where one does not
forget, as of a bias that nothing tells, the pieces run one after the other in the end.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.estimate.filter import Filter, FilterState

SHORTEST_PIECE, LONGEST_PIECE = 250, 2000
"""Conventional: samples of a piece of a record; pieces run side by side, and a filter forgets its start within one."""

JOINED, ROUNDING = 1e-12, 1e-15
"""Numerical: a piece begins where the one before ended if no state differs by more than this of its deviation or this
of itself, and no variance by more than the first of itself: the record is then followed sample by sample."""

TURNS = 25
"""Conventional: a filter that has not forgotten its starts after so many turns runs one piece after the other."""


class Log(NamedTuple):
    """What a filter is fed with: inputs held from the sample before, readings, and where stretches begin."""

    inputs: FloatArray  # (samples, circuits)
    readings: FloatArray  # (samples, sensors); NaN where missing
    begins: IntArray  # Indices of the first samples of stretches without a gap, ascending from 0
    guesses: FloatArray  # First estimate of every sample, of which pieces take theirs; (samples, n)
    held: BoolArray  # Whether the body stands still, whatever the forces say; (samples,)


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
        ends = ends.with_runs(todo, _run((filter_, resting), log, pieces, todo, used.of_runs(todo), result))
        turns += 1
        wanted = used.with_runs(pieces.follows, ends.of_runs(pieces.follows - 1))
        todo = np.flatnonzero(~_joined(used, wanted))
        if turns > TURNS:
            todo = todo[~np.isin(todo - 1, todo)]
        used = used.with_runs(todo, wanted.of_runs(todo))
    return replace(result, turns=turns)


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
                moved = moved.with_runs(here, predicting.predict(state.of_runs(here), log.inputs[row[here]]))
        if j == 0 and opens.any():  # nothing moves before the first sample
            moved = moved.with_runs(np.flatnonzero(opens), state.of_runs(np.flatnonzero(opens)))
        readings = np.where(alive[:, None], log.readings[row], np.nan)
        state = filter_.update(moved, readings)
        here = row[alive]
        result.predicted[here], result.mean[here] = moved.mean[alive], state.mean[alive]
        result.covariance[here] = state.covariance[alive]
        shape = (len(which), readings.shape[1])
        result.innovation[here] = state.innovation.reshape(shape)[alive]
        result.variance[here] = state.innovation_variance.reshape(shape)[alive]
        result.outcome[here] = state.outcome[alive]
        ended = np.flatnonzero(length == j + 1)
        last = last.with_runs(ended, state.of_runs(ended)) if len(ended) else last
    return last


def _joined(used: FilterState, wanted: FilterState) -> BoolArray:
    """Whether two starts of each piece are the same to :data:`JOINED`; what broke down stays as it is."""
    variance = np.diagonal(wanted.covariance, axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        near = np.abs(used.mean - wanted.mean) <= JOINED * np.sqrt(variance) + ROUNDING * np.abs(wanted.mean)
        alike = np.abs(np.diagonal(used.covariance, axis1=1, axis2=2) - variance) <= JOINED * variance
    both = np.isnan(used.mean) & np.isnan(wanted.mean)
    return np.asarray(((near & alike) | both).all(axis=1) & (used.outcome == wanted.outcome))
