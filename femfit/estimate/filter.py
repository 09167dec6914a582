"""The stepping interface that every filter shares.

Classes are abstract (this one) or final: a filter supplies its two moment computations; bookkeeping of outcomes and
innovations is here, once.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from math import isnan
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import ArrayLike

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Printed
from femfit.core.text import counted
from femfit.estimate.constants import BAND_99_9, DIVERGENCE_STEPS
from femfit.estimate.process import FilterOutcome, FilterProcess, FilterState, cholesky
from femfit.estimate.single_step import SingleStep, StepFunction, Terms, in_arrays
from femfit.estimate.words import sentence

VOLTAGES, READINGS = ("voltage", "circuit"), ("reading", "sensor")

Moments = tuple[Any, Any, Any]  # Mean, covariance and its factor
Corrected = tuple[Any, Any, Any, Any]  # Mean, covariance, innovation and the variance of that

RUNNING = int(FilterOutcome.RUNNING)  # a member of an enumeration is slow to look up


@dataclass(frozen=True, eq=False, repr=False)
class Filter(Printed, ABC):
    """A recursive estimator for a :class:`FilterProcess`, batched over runs.

    Parameters
    ----------
    divergence_steps : int
        A run is named INNOVATIONS_OUT_OF_BAND once more than half of its last (exponentially weighted) so many
        innovations left their 99.9 % band; a true filter leaves it once in a thousand steps.

    Examples
    --------
    >>> import femfit as ff
    >>> filter_ = ff.kalman_filter("model.json", "ekf", hall_bias=False)
    >>> state = filter_.update(filter_.start([0.022, 0.0, 0.4]), 2.7)
    >>> state.mean.shape, state.covariance.shape
    ((1, 3), (1, 3, 3))
    """

    process: FilterProcess
    divergence_steps: int = DIVERGENCE_STEPS

    title: ClassVar[str]
    is_unscented: ClassVar[bool] = False

    def __str__(self) -> str:
        return sentence("filter", "filter", self)

    @abstractmethod
    def predicted(self, of: Terms, mean: Any, factor: Any, inputs: Any) -> tuple[Any, Any]:
        """Mean and covariance one step later."""

    @abstractmethod
    def corrected(self, of: Terms, sensor: int, before: Moments, reading: Any, noise: Any) -> Corrected:
        """Mean and covariance given one sensor's reading, its innovation and the variance of that."""

    @final
    def start(self, mean: ArrayLike, covariance: ArrayLike | None = None, runs: int = 1) -> FilterState:
        """Initial state.

        Parameters
        ----------
        mean : array, shape (n,) or (runs, n)
            First estimate; where no covariance is given, states may be left out at the end: those of effects and biases
            are zero then, samples that were sensed before are those of a body at rest.
        covariance : array, shape (n, n) or (runs, n, n), or None
            Of its error; the process's own where None.
        runs : int
            Size of the batch where ``mean`` has the shape (n,).

        Raises
        ------
        FilterError
            If shapes do not fit, or the covariance is not positive definite.
        """
        mean, order = np.asarray(mean, dtype=np.float64), self.process.order
        if covariance is None:
            covariance, mean = self.process.start_covariance, self.process.first_estimate(mean)
        count = len(mean) if mean.ndim == 2 else runs
        fitting = {(order, order), (1, order, order), (count, order, order)}
        if mean.shape not in {(order,), (count, order)} or np.shape(covariance) not in fitting:
            raise FilterError(
                f"Initial mean and covariance must have the shapes ({order},) and ({order}, {order}) for the states "
                f"{', '.join(self.process.names)}; instead received {mean.shape} and {np.shape(covariance)}."
            )
        if count < 1:
            raise FilterError(f"A filter needs at least one run to start; instead received runs={count}.")
        runs = count
        mean = np.array(np.broadcast_to(mean, (runs, order)), order="F")
        matrices = np.empty((order, order, runs)).transpose(2, 0, 1)
        matrices[:] = covariance
        factor, definite = cholesky(matrices)
        if not (np.all(definite) and np.all(np.isfinite(mean))):
            raise FilterError(
                "The initial covariance must be positive definite and the initial mean finite; give every state an "
                "uncertainty > 0."
            )
        unknown = np.full(runs, np.nan)
        return FilterState(
            mean=mean,
            covariance=matrices,
            factor=factor,
            innovation=unknown,
            innovation_variance=unknown,
            out_of_band=np.zeros(runs),
            outcome=np.zeros(runs, dtype=np.intp),
        )

    @final
    def predict(self, state: FilterState, voltage: FloatArray | float) -> FilterState:
        """The state one sample later, before its measurement.

        Parameters
        ----------
        voltage : array, shape (runs,), or float
            Input u held from this sample to the next; of a process with n inputs of shape (runs, n) or (n,).
        """
        inputs = _given(state, voltage, self.process.inputs, VOLTAGES)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            # A non-finite result is not repaired: it becomes the run's named outcome.
            factor = state.factor.transpose(1, 2, 0)
            mean, covariance = self.predicted(self._terms, state.mean.T[:, None], factor, inputs)
            innovations = state.innovation, state.innovation_variance, state.out_of_band
            return self._next((mean[:, 0].T, covariance.transpose(2, 0, 1)), innovations, state.outcome)

    @final
    def update(self, state: FilterState, measurement: ArrayLike) -> FilterState:
        """The state given this sample's readings; one that is NaN is missing, and passed over.

        The readings of several sensors are taken one after the other, which their independent noises allow. For linear
        sensors that is exactly the update with all of them at once; for others each update is taken about the estimate
        that the one before has improved.

        Parameters
        ----------
        measurement : array, shape (runs,), or float
            z; with several sensors of shape (runs, sensors) or (sensors,), in the order of ``process.outputs``.
        """
        readings, judged = _given(state, measurement, len(self.process.outputs), READINGS), []
        for sensor in range(len(self.process.outputs)):
            state = self._update_one(state, readings[:, sensor], sensor)
            judged.append((state.innovation, state.innovation_variance))
        if len(judged) == 1:
            return state
        innovation, variance = (np.stack(values, axis=1) for values in zip(*judged, strict=True))
        return replace(state, innovation=innovation, innovation_variance=variance)

    def _update_one(self, state: FilterState, measurement: FloatArray, sensor: int) -> FilterState:
        before = state.mean.T[:, None], state.covariance.transpose(1, 2, 0), state.factor.transpose(1, 2, 0)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            noise = self.process.outputs[sensor].variance
            after = self.corrected(self._terms, sensor, before, measurement, noise)
            mean, covariance = after[0][:, 0].T, after[1].transpose(2, 0, 1)
            innovation, variance = after[2][0, 0], after[3][0, 0]
            outside = innovation**2 > BAND_99_9 * variance
            fraction = state.out_of_band + (outside - state.out_of_band) / self.divergence_steps
            if (missing := np.isnan(measurement)).any():
                mean = np.where(missing[:, None], state.mean, mean)
                covariance = np.where(missing[:, None, None], state.covariance, covariance)
                innovation, variance = (np.where(missing, np.nan, values) for values in (innovation, variance))
                fraction = np.where(missing, state.out_of_band, fraction)
            outcome = state.outcome
            if (out := (fraction > 0.5) & (outcome == RUNNING)).any():
                outcome = np.where(out, FilterOutcome.INNOVATIONS_OUT_OF_BAND, outcome)
            return self._next((mean, covariance), (innovation, variance, fraction), outcome)

    @final
    def step(self, state: FilterState, voltage: FloatArray | float, measurement: ArrayLike) -> FilterState:
        """Predict with the voltage held since the last sample, then update with this sample's readings."""
        process = self.process
        if len(state.mean) == 1 and not state.outcome.item() and process.light:
            plain = isinstance(voltage, float) and process.inputs == 1
            inputs = voltage if plain else _given(state, voltage, process.inputs, VOLTAGES)[0]
            readings = _given(state, measurement, len(process.outputs), READINGS)[0]
            after = self._next_alone(state, self.single(state.mean[0], state.factor[0].T, inputs, readings))
            if after is not None:
                return after
        return self.update(self.predict(state, voltage), measurement)

    @cached_property
    def single(self) -> StepFunction:
        """One step of one run as one function, by the process's graph."""
        return StepFunction(self)

    @cached_property
    def _terms(self) -> Terms:
        return in_arrays(self.process)

    def __getstate__(self) -> dict[str, Any]:
        """What is worked out again on demand is not pickled."""
        return {name: value for name, value in vars(self).items() if name not in {"single", "_terms"}}

    @final
    def _next_alone(self, state: FilterState, step: SingleStep) -> FilterState | None:
        """The state of one run that stays healthy; None where anything must be named."""
        process, fraction = self.process, state.out_of_band.item()
        for innovation, variance in zip(step.innovations.tolist(), step.variances.tolist(), strict=True):
            if not isnan(innovation):  # as of a missing sample
                fraction += ((innovation * innovation > BAND_99_9 * variance) - fraction) / self.divergence_steps
        plausible = process.is_plausible(step.predicted.tolist()) and process.is_plausible(step.mean.tolist())
        if fraction > 0.5 or not plausible or not step.factor[-1, -1] > 0.0:
            return None
        single = len(process.outputs) == 1
        return FilterState(
            mean=step.mean[None],
            covariance=step.covariance[None],
            factor=step.factor[None],
            innovation=step.innovations if single else step.innovations[None],
            innovation_variance=step.variances if single else step.variances[None],
            out_of_band=np.array([fraction]),
            outcome=state.outcome,
        )

    def _next(
        self,
        moments: tuple[FloatArray, FloatArray],
        innovations: tuple[FloatArray, FloatArray, FloatArray],
        outcome: IntArray,
    ) -> FilterState:
        """Name what went wrong; the first name of a run stays."""
        mean, covariance = moments
        factor, definite = cholesky(covariance)
        if not (definite.all() and np.isfinite(mean).all()):
            finite = np.isfinite(mean).all(axis=1)
            healthy = finite & definite
            code = np.where(finite, FilterOutcome.COVARIANCE_LOST, FilterOutcome.NOT_FINITE)
            outcome = np.where((outcome == RUNNING) & ~healthy, code, outcome)
            mean = np.where(healthy[:, None], mean, np.nan)
        plausible = self.process.plausible(mean)
        if not plausible.all():
            # A run that broke down has its name already
            outcome = np.where((outcome == RUNNING) & ~plausible, FilterOutcome.LEFT_MODEL, outcome)
        return FilterState(mean, covariance, factor, *innovations, outcome)


def _given(state: FilterState, value: ArrayLike, width: int, what: tuple[str, str]) -> FloatArray:
    """Numbers of shape (runs, width), of one row for all or one each.

    A single number of each run may be given without an axis of its own.
    """
    numbers, runs = np.asarray(value, dtype=np.float64), state.runs
    if numbers.shape == (runs, width) or (width == 1 and numbers.shape == (runs,)):
        return numbers.reshape(runs, width)
    if numbers.size != width:
        raise FilterError(
            f"A step takes {counted(width, what[0])} for each of {counted(runs, 'run')}, one a {what[1]}; instead "
            f"received the shape {numbers.shape}."
        )
    return np.repeat(numbers.reshape(1, width), runs, axis=0)
