"""A process whose readings are late or differences: earlier samples become states beside its own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.constants import DELAYED_NOISE
from femfit.filters.delayed_samples import DelayedSamples, delayed_variances
from femfit.filters.process import FilterProcess, Output
from femfit.model.actuator_model import ActuatorModel


def with_delayed_samples(process: FilterProcess, delayed: DelayedSamples | None) -> FilterProcess:
    """The process with the states that its sensors ask for; the same where all are prompt.

    Parameters
    ----------
    process : FilterProcess
        With a start covariance, and outputs that know of the delayed samples.
    """
    if delayed is None:
        return process
    base, start = process.order, process.require_start_covariance()
    unlimited = np.full(delayed.order, np.inf)
    added = replace(
        process,
        names=(*process.names, *delayed.names),
        lower=None if process.lower is None else np.concatenate([process.lower, -unlimited]),
        upper=None if process.upper is None else np.concatenate([process.upper, unlimited]),
        start_covariance=_joined(start, delayed_variances(delayed, _places(delayed.model, base))),
        process_covariance=_joined(process.process_covariance, _delayed_noise(delayed, process.outputs)),
        delayed=delayed,
    )
    return added.predicting(process.transition, process.transition_jacobian)


def _places(model: ActuatorModel, base: int) -> FloatArray:
    """Bodies held still all over the validity domain, of shape (N, base)."""
    distance, currents = model.validity.grid(5, 3)
    places, n = np.zeros((distance.size, base)), len(model.circuits)
    places[:, 0], places[:, 2 : 2 + n] = distance, currents.reshape(distance.size, -1)[:, :n]
    return places


def _delayed_noise(delayed: DelayedSamples, outputs: Sequence[Output]) -> FloatArray:
    """Variances that a step adds to remembered values: far below what the readings' noise would make of them."""
    variance = {output.name: output.variance for output in outputs}
    parts = [
        np.full(samples.count, DELAYED_NOISE**2 * variance[samples.name] / np.abs(samples.weights).max() ** 2)
        for samples in delayed.by_sensor
    ]
    return np.concatenate(parts)


def _joined(covariance: FloatArray, variances: FloatArray) -> FloatArray:
    """A covariance with independent states after its own."""
    n = len(covariance)
    result = np.diag(np.concatenate([np.zeros(n), variances]))
    result[:n, :n] = covariance
    return result
