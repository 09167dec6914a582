"""Which states a set of sensors can tell, and how well: the Cramer-Rao bound along a trajectory.

The information matrix follows J+ = (Q + F J^-1 F^T)^-1 + sum over the sensors of H^T H / R, with the Jacobians F and H
along the true trajectory; no unbiased estimator has an error covariance below J^-1. With additive Gaussian noise and a
given trajectory this is the covariance recursion of an extended filter that knows where it is.

References
----------
P. Tichavsky, C. H. Muravchik and A. Nehorai, Posterior Cramer-Rao bounds for discrete-time nonlinear filtering, IEEE
Trans. Signal Processing 46 (1998) 1386, eqs. (21) and (34) to (36).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.noise import FilterNoise
from femfit.estimate.process import FilterProcess
from femfit.estimate.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of

OBSERVED_SHARE = 0.5
"""Conventional: a state counts as told by the sensors where its error falls below this share of the first one."""

SETTLING_STEPS = 2000
"""Conventional: samples after which the bound of a body held still is stated."""


@dataclass(frozen=True, eq=False, repr=False)
class ErrorBound(Printed):
    """Least standard deviations that any unbiased filter can reach where its process noises act.

    Examples
    --------
    >>> import femfit as ff
    >>> bound = ff.error_bound("model.json")
    >>> bound.deviations.shape == (len(bound.places), len(bound.names))
    True
    """

    names: tuple[str, ...]
    sensors: tuple[str, ...]
    places: FloatArray  # States of the body held still, shape (places, n)
    deviations: FloatArray  # Of each state's error, once it has settled; shape (places, n)
    first: FloatArray  # Of the first estimate's error; shape (n,)

    @property
    def observed(self) -> FloatArray:
        """Which states the sensors tell at each place: the deviation falls below a half of the first."""
        return np.asarray(self.deviations < OBSERVED_SHARE * self.first)

    def __str__(self) -> str:
        return sentence("filter", "bound", self)


def error_bound(
    model: ActuatorModel | str | Path,
    *,
    sensors: Sequence[str] | None = None,
    biases: Sequence[str] = (),
    noise: FilterNoise | None = None,
    distances_m: Sequence[float] | None = None,
    currents_A: Sequence[float] | Sequence[Sequence[float]] | None = None,
) -> ErrorBound:
    """How well sensors tell the states of a body held still, before any filter starts.

    Parameters
    ----------
    sensors, biases, noise : optional
        As for :func:`femfit.kalman_filter`.
    distances_m, currents_A : sequence of float or None
        Where; a quarter, a half and three quarters of the travel, without current and with half of the
        largest, where None. With n circuits each entry of the currents has n numbers.

    Raises
    ------
    MissingPartError
        If the model lacks a sensor, circuit or motion.
    FilterError
        If a sensor has no noise.

    Examples
    --------
    >>> import femfit as ff
    >>> bound = ff.error_bound("model.json", distances_m=(0.022,), currents_A=(0.4,))
    >>> bool(bound.observed[0, 0])
    True
    """
    model = model_of(model)
    box = model.validity
    if distances_m is None:
        ends = np.clip(model.require_motion().ends, box.distance_min_m, box.distance_max_m)
        distances_m = (ends[0] + np.array([0.25, 0.5, 0.75]) * (ends[1] - ends[0])).tolist()
    process = kalman_filter(without_stops(model), sensors=sensors, biases=biases, noise=noise).process
    circuits = len(model.circuits)
    limits = box.current_limits_A[:circuits]
    # No current, or the nearest to it, and half of the largest
    currents = np.stack([np.clip(0.0, *limits.T), 0.5 * limits[:, 1]]) if circuits else np.zeros((1, 0))
    if currents_A is not None:
        currents = np.asarray(currents_A, dtype=np.float64)
        if currents.shape[1:] != (() if circuits == 1 else (circuits,)):
            raise FilterError(
                f"currents_A must hold {circuits} currents for each point, one a circuit; instead received the shape "
                f"{currents.shape}."
            )
        currents = currents.reshape(len(currents), circuits)
    places = np.zeros((len(distances_m) * len(currents), process.order))
    places[:, 0] = np.repeat(distances_m, len(currents))
    places[:, 2 : 2 + circuits] = np.tile(currents, (len(distances_m), 1))
    model.validity.require(places[:, 0], places[:, 2 : 2 + circuits])
    volts = model.resistances_ohm * places[:, 2 : 2 + circuits]
    slope = process.with_slopes(places, volts)[1]
    outputs = [process.gradient(output.name, places) for output in process.outputs]
    covariance = np.broadcast_to(process.start_covariance, slope.shape)
    for _ in range(SETTLING_STEPS):
        covariance = slope @ covariance @ slope.swapaxes(1, 2) + process.process_covariance
        covariance = _informed(process, covariance, outputs)
    return ErrorBound(
        names=process.names,
        sensors=tuple(output.name for output in process.outputs),
        places=places,
        deviations=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        first=np.sqrt(np.diag(process.start_covariance)),
    )


def bound_along(process: FilterProcess, states: FloatArray, inputs: FloatArray) -> FloatArray:
    """Covariances J^-1 along a trajectory, after each sample's readings.

    Parameters
    ----------
    states : array, shape (samples, n)
        The true ones.
    inputs : array, shape (samples,), or (samples, circuits) where there is not one
        Held from the sample before to each one; the first is not used.

    Returns
    -------
    array, shape (samples, n, n)
    """
    if len(states) != len(inputs):
        raise FilterError(
            f"A trajectory needs an input for each state; instead received {len(states)} states and {len(inputs)} "
            "inputs."
        )
    slopes = process.with_slopes(states[:-1], inputs[1:])[1]
    outputs = np.stack([process.gradient(output.name, states) for output in process.outputs])
    result, covariance = np.empty((len(states), process.order, process.order)), process.start_covariance
    for k in range(len(states)):
        if k > 0:
            covariance = slopes[k - 1] @ covariance @ slopes[k - 1].T + process.process_covariance
        result[k] = covariance = _informed(process, covariance[None], outputs[:, k : k + 1])[0]
    return result


def _informed(process: FilterProcess, covariance: FloatArray, outputs: Iterable[FloatArray]) -> FloatArray:
    """(P^-1 + sum H^T H / R)^-1, one sensor after the other by the matrix inversion lemma."""
    for output, slope in zip(process.outputs, outputs, strict=True):
        cross = np.einsum("rij,rj->ri", covariance, slope)
        # A sensor that is read at every p-th sample alone tells as much as one of p times the variance at each
        variance = np.einsum("ri,ri->r", cross, slope) + output.variance * output.period
        covariance = covariance - cross[:, :, None] * cross[:, None, :] / variance[:, None, None]
    return 0.5 * (covariance + covariance.swapaxes(1, 2))


def without_stops(model: ActuatorModel) -> ActuatorModel:
    """A model whose body may go on: who does not know that it lies on a stop, cannot take the distance from there."""
    return replace(model, motion=replace(model.require_motion(), near_stop=None, far_stop=None))
