"""The stepping interface that every filter shares.

Classes are abstract (this one) or final: a filter supplies its two moment computations; bookkeeping of outcomes and
innovations is here, once.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from math import isnan
from typing import ClassVar, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from femfit.core.errors import FilterError
from femfit.core.graph import Memo
from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Printed
from femfit.core.text import amount
from femfit.estimate.cholesky import cholesky
from femfit.estimate.constants import BAND_99_9, DIVERGENCE_STEPS
from femfit.estimate.process import FilterOutcome, FilterProcess, FilterState, Output
from femfit.estimate.process_graph import ProcessGraph
from femfit.estimate.single_step import SingleStep, StepFunction

DOUBLE = np.dtype(np.float64)

RUNNING = int(FilterOutcome.RUNNING)  # a member of an enumeration is slow to look up


class Moments(NamedTuple):
    """Means of shape (runs, n) and covariances of shape (runs, n, n), symmetric up to rounding."""

    mean: FloatArray
    covariance: FloatArray


class Correction(NamedTuple):
    """What an update gives; innovation and variance have the shape (runs,)."""

    moments: Moments
    innovation: FloatArray
    innovation_variance: FloatArray


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

    def __str__(self) -> str:
        process = self.process
        noise = np.sqrt(np.diag(process.process_covariance))
        return "\n".join(
            [
                f"{self.title} with a step of {amount(process.step_s, 's')}",
                *(
                    f"  {name}, process noise {deviation:.2g} a step"
                    for name, deviation in zip(process.names, noise, strict=True)
                ),
                *(
                    f"noise of one reading {amount(output.variance**0.5, output.unit)}"
                    + (f" ({output.name})" if len(process.outputs) > 1 else "")
                    for output in process.outputs
                ),
            ]
        )

    @abstractmethod
    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        """Moments one step later."""

    @abstractmethod
    def _corrected(self, state: FilterState, measurement: FloatArray, output: Output) -> Correction:
        """Moments given one sensor's reading."""

    @final
    def start(self, mean: ArrayLike, covariance: ArrayLike | None = None, runs: int = 1) -> FilterState:
        """Initial state.

        Parameters
        ----------
        mean : array, shape (n,) or (runs, n)
            First estimate; states that are left out at the end (of effects, the Hall offset) are zero.
        covariance : array, shape (n, n) or (runs, n, n), or None
            Of its error; the process's own where None.
        runs : int
            Size of the batch where ``mean`` has the shape (n,).

        Raises
        ------
        FilterError
            If shapes do not fit, or the covariance is not positive definite.
        """
        mean = np.asarray(mean)
        dtype = mean.dtype if mean.dtype == np.float32 else np.dtype(np.float64)
        order = self.process.order
        if covariance is None:
            covariance = self.process.require_start_covariance()
            delayed = self.process.delayed
            base = order if delayed is None else delayed.base
            missing = base - mean.shape[-1] if mean.ndim else 0
            if 0 < missing < base:
                mean = np.concatenate([mean, np.zeros((*mean.shape[:-1], missing), dtype)], axis=-1)
            if delayed is not None and mean.shape[-1:] == (base,):
                mean = delayed.from_rest(mean)
        if mean.shape[-1:] != (order,) or np.shape(covariance)[-2:] != (order, order):
            raise FilterError(
                f"Initial mean and covariance must have the shapes ({order},) and ({order}, {order}) for the states "
                f"{', '.join(self.process.names)}; instead received {mean.shape} and {np.shape(covariance)}."
            )
        runs = len(mean) if mean.ndim == 2 else runs
        mean = np.array(np.broadcast_to(mean, (runs, order)), dtype, order="F")
        matrices = np.empty((order, order, runs), dtype).transpose(2, 0, 1)
        matrices[:] = covariance
        factor, definite = cholesky(matrices)
        if not (np.all(definite) and np.all(np.isfinite(mean))):
            raise FilterError(
                "The initial covariance must be positive definite and the initial mean finite; give every state an "
                "uncertainty > 0."
            )
        unknown = np.full(runs, np.nan, dtype=dtype)
        return FilterState(
            mean=mean,
            covariance=matrices,
            factor=factor,
            innovation=unknown,
            innovation_variance=unknown,
            out_of_band=np.zeros(runs, dtype=dtype),
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
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            # A non-finite result is not repaired: it becomes the run's named outcome.
            moments = self._predicted(state, _inputs(state, voltage, self.process.inputs))
            innovations = state.innovation, state.innovation_variance, state.out_of_band
            return self._next(moments, innovations, state.outcome)

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
        outputs = self.process.outputs
        if len(outputs) == 1:
            return self._update_one(state, _per_run(state, measurement), outputs[0])
        needed = f"A measurement must hold {len(outputs)} readings for each of {state.runs} runs, one a sensor"
        readings, judged = _rows(state, measurement, len(outputs), needed), []
        for k, output in enumerate(outputs):
            state = self._update_one(state, readings[:, k], output)
            judged.append((state.innovation, state.innovation_variance))
        innovation, variance = (np.stack(values, axis=1) for values in zip(*judged, strict=True))
        return replace(state, innovation=innovation, innovation_variance=variance)

    def _update_one(self, state: FilterState, measurement: FloatArray, output: Output) -> FilterState:
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            (mean, covariance), innovation, variance = self._corrected(state, measurement, output)
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
            fraction = fraction.astype(state.mean.dtype, copy=False)
            return self._next(Moments(mean, covariance), (innovation, variance, fraction), outcome)

    @final
    def step(self, state: FilterState, voltage: FloatArray | float, measurement: ArrayLike) -> FilterState:
        """Predict with the voltage held since the last sample, then update with this sample's readings."""
        graph = self.process.own_graph
        if graph is not None and len(state.mean) == 1 and state.mean.dtype == DOUBLE and not state.outcome.item():
            known = self._known
            if "step" not in known:
                known["step"] = self.single(graph)
            readings = _numbers(measurement, len(self.process.outputs))
            plain = isinstance(voltage, float) and self.process.inputs == 1
            inputs = voltage if plain else _inputs(state, voltage, self.process.inputs)[0]
            step = known["step"](state.mean[0], self._matrix(state), inputs, readings)
            if (alone := self._next_alone(state, step)) is not None:
                return alone
        return self.update(self.predict(state, voltage), measurement)

    @abstractmethod
    def single(self, graph: ProcessGraph) -> StepFunction:
        """One step of one run as one function."""

    @abstractmethod
    def _matrix(self, state: FilterState) -> FloatArray:
        """What that takes of one run's covariance."""

    @cached_property
    def _known(self) -> Memo:
        return Memo()

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
        self, moments: Moments, innovations: tuple[FloatArray, FloatArray, FloatArray], outcome: IntArray
    ) -> FilterState:
        """Name what went wrong; the first name of a run stays. ``known`` is what a state holds of innovations."""
        mean, covariance = moments
        factor, definite = cholesky(covariance)
        if not (definite.all() and np.isfinite(mean).all()):
            finite = np.isfinite(mean).all(axis=1)
            healthy = finite & definite
            code = np.where(finite, FilterOutcome.COVARIANCE_LOST, FilterOutcome.NOT_FINITE)
            outcome = np.where((outcome == RUNNING) & ~healthy, code, outcome)
            mean = np.where(healthy[:, None], mean, np.nan).astype(mean.dtype, copy=False)
        plausible = self.process.plausible(mean)
        if not plausible.all():
            # A run that broke down has its name already
            outcome = np.where((outcome == RUNNING) & ~plausible, FilterOutcome.LEFT_MODEL, outcome)
        return FilterState(mean, covariance, factor, *innovations, outcome)


def _per_run(state: FilterState, value: ArrayLike) -> FloatArray:
    """A number for each run, given as (runs,), (runs, 1) or one for all, in the state's precision."""
    result = np.empty(state.runs, state.mean.dtype)
    result[:] = value if np.ndim(value) < 2 else np.ravel(value)
    return result


def _inputs(state: FilterState, voltage: FloatArray | float, inputs: int) -> FloatArray:
    """Voltages of shape (runs,), or (runs, inputs) where there is not one input, in the state's precision."""
    if inputs == 1:
        return _per_run(state, voltage)
    return _rows(
        state, voltage, inputs, f"This filter takes {inputs} voltages for each of {state.runs} runs, one a circuit"
    )


def _rows(state: FilterState, value: ArrayLike, width: int, needed: str) -> FloatArray:
    """Numbers of shape (runs, width), in the state's precision; refused with what is needed where they are others."""
    numbers = np.asarray(value, state.mean.dtype)
    if numbers.shape not in {(width,), (state.runs, width), (1, width)}:
        raise FilterError(f"{needed}; instead received the shape {numbers.shape}.")
    return np.broadcast_to(numbers, (state.runs, width))


def _numbers(value: ArrayLike | float, sensors: int) -> FloatArray:
    """The readings of one run."""
    numbers = np.array(value, np.float64, ndmin=1).reshape(-1)
    if len(numbers) != sensors:
        raise FilterError(f"A measurement must hold {sensors} readings, one a sensor; instead received {len(numbers)}.")
    return numbers
