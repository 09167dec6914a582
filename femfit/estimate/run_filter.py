"""A filter over a long record: one step after the other, and what it saw at each."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.estimate.filter import Filter
from femfit.estimate.prepare import Prepared


@dataclass(frozen=True, eq=False)
class Replayed:
    """A record as a filter saw it; arrays have one row a sample."""

    predicted: FloatArray  # Before the sample's readings; (samples, n)
    mean: FloatArray  # After them; (samples, n)
    covariance: FloatArray  # (samples, n, n)
    innovation: FloatArray  # (samples, sensors)
    variance: FloatArray  # (samples, sensors)
    outcome: IntArray  # (samples,), a :class:`FilterOutcome` each

    @cached_property
    def deviation(self) -> FloatArray:
        """Standard deviations, (samples, n)."""
        with np.errstate(invalid="ignore"):  # of a run that has lost its covariance
            return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def replay(filter_: Filter, record: Prepared, resting: Filter) -> Replayed:
    """Run a filter over all stretches of a record; where the body is held, ``resting`` steps in its place."""
    (samples, sensors), order = record.readings.shape, filter_.process.order
    shapes = (order,), (order,), (order, order), (sensors,), (sensors,)
    predicted, mean, covariance, innovation, variance = (np.empty((samples, *shape)) for shape in shapes)
    result = Replayed(predicted, mean, covariance, innovation, variance, np.empty(samples, np.intp))
    for first, rows in zip(record.first, np.split(np.arange(samples), record.begins[1:]), strict=True):
        state = filter_.update(filter_.start(first), record.readings[rows[0]])
        for k in rows.tolist():
            if k > rows[0]:  # nothing moves before a stretch's first sample
                step = resting.step if record.held[k] else filter_.step
                state = step(state, record.inputs[k], record.readings[k])
            predicted[k], mean[k], covariance[k] = state.predicted[0], state.mean[0], state.covariance[0]
            innovation[k], variance[k] = state.innovation[0], state.innovation_variance[0]
            result.outcome[k] = state.outcome[0]
    return result
