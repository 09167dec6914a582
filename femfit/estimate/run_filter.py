"""A filter over a long record, in pieces that run side by side.

One filter after the other costs hundreds of microseconds a sample; a thousand at once cost little more. The record is
cut into pieces. All of them run from a guess; each then runs again from the end of the one before, until every piece
begins where its neighbour ended. A filter forgets its start, so that some ten turns do for most; where one does not
forget, as of a bias that nothing tells, the pieces run one after the other in the end.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.estimate.filter import Filter, FilterState
from femfit.estimate.prepare import Prepared

SHORTEST_PIECE, LONGEST_PIECE = 250, 2000
"""Conventional: samples of a piece of a record; pieces run side by side, and a filter forgets its start within one."""

JOINED, ROUNDING = 1e-12, 1e-15
"""Numerical: a piece begins where the one before ended if no state differs by more than this of its deviation or this
of itself, and no variance by more than the first of itself: the record is then followed sample by sample."""

TURNS = 25
"""Conventional: a filter that has not forgotten its starts after so many turns runs one piece after the other."""


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


def replay(filter_: Filter, record: Prepared, resting: Filter) -> Replayed:
    """Run a filter over all stretches of a record; where the body is held, ``resting`` predicts in its place."""
    samples, order, sensors = len(record.inputs), filter_.process.order, record.readings.shape[1]
    size = int(np.clip(np.sqrt(samples), SHORTEST_PIECE, LONGEST_PIECE))
    stretches = zip(record.begins, np.append(record.begins[1:], samples), strict=True)
    first = np.concatenate([np.arange(a, b, size) for a, b in stretches])
    follows = np.flatnonzero(~np.isin(first, record.begins))
    shapes = (order,), (order,), (order, order), (sensors,), (sensors,)
    predicted, mean, covariance, innovation, variance = (np.full((samples, *shape), np.nan) for shape in shapes)
    result = Replayed(predicted, mean, covariance, innovation, variance, np.zeros(samples, np.intp), 0)
    used = ends = filter_.start(record.guesses[first])
    todo, turns = np.arange(len(first)), 0
    while len(todo):
        ends = ends.with_runs(todo, _run(filter_, resting, record, first, todo, used.of_runs(todo), result))
        turns += 1
        wanted = used.with_runs(follows, ends.of_runs(follows - 1))
        todo = np.flatnonzero(~_joined(used, wanted))
        if turns > TURNS:
            todo = todo[~np.isin(todo - 1, todo)]
        used = used.with_runs(todo, wanted.of_runs(todo))
    return replace(result, turns=turns)


def _run(
    filter_: Filter,
    resting: Filter,
    record: Prepared,
    firsts: IntArray,
    which: IntArray,
    state: FilterState,
    result: Replayed,
) -> FilterState:
    """Run some of the pieces that begin at ``firsts`` side by side, and write down what they saw; their last states."""
    samples = len(record.inputs)
    first, length = firsts[which], np.diff(np.append(firsts, samples))[which]
    opens, last = np.isin(first, record.begins), state
    for j in range(int(length.max())):
        alive, row = length > j, np.minimum(first + j, samples - 1)
        moved, held = state, record.held[row]
        for predicting, here in ((filter_, np.flatnonzero(~held)), (resting, np.flatnonzero(held))):
            if len(here):
                moved = moved.with_runs(here, predicting.predict(state.of_runs(here), record.inputs[row[here]]))
        if j == 0:  # nothing moves before a stretch's first sample
            moved = moved.with_runs(opens, state.of_runs(opens))
        state = filter_.update(moved, np.where(alive[:, None], record.readings[row], np.nan))
        here, shape = row[alive], (len(which), record.readings.shape[1])
        result.predicted[here], result.mean[here] = moved.mean[alive], state.mean[alive]
        result.covariance[here], result.outcome[here] = state.covariance[alive], state.outcome[alive]
        result.innovation[here] = state.innovation.reshape(shape)[alive]
        result.variance[here] = state.innovation_variance.reshape(shape)[alive]
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
