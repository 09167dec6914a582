"""The stepping interface that every filter shares.

Classes are abstract (this one) or final: a filter supplies its two moment computations; bookkeeping of outcomes and
innovations is here, once.
"""

from abc import ABC, abstractmethod
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import ArrayLike

from femfit.core.compiled import Compilation
from femfit.core.errors import FilterError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Printed
from femfit.core.tape import Caller
from femfit.core.text import counted
from femfit.estimate.filter_state import FilterOutcome, FilterState
from femfit.estimate.process import FilterProcess
from femfit.estimate.single_step import MISSING, Terms, in_arrays, step_function
from femfit.estimate.words import sentence

BAND_99_9 = 10.828
"""Derived: 99.9 % quantile of chi-square with one degree of freedom."""

DIVERGENCE_STEPS = 200
"""Conventional: innovations of which more than half outside of that band are too many; a true filter leaves it once in
a thousand steps."""


RUNNING = int(FilterOutcome.RUNNING)  # a member of an enumeration is slow to compare with
_GOES_ON = {RUNNING, int(FilterOutcome.INNOVATIONS_OUT_OF_BAND)}


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
    def corrected(
        self, of: Terms, sensor: int, before: tuple[Any, Any, Any], reading: Any, noise: Any
    ) -> tuple[Any, Any, Any, Any]:
        """Mean and covariance given one sensor's reading, its innovation and the variance of that.

        What is before are mean, covariance and its factor.
        """

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
        mean = np.array(np.broadcast_to(mean, (count, order)), order="F")
        matrices = np.empty((order, order, count)).transpose(2, 0, 1)  # as a step leaves them
        matrices[:] = covariance
        factor, definite = cholesky(matrices)
        if not (np.all(definite) and np.all(np.isfinite(mean))):
            raise FilterError(
                "The initial covariance must be positive definite and the initial mean finite; give every state an "
                "uncertainty > 0."
            )
        sensors = len(self.process.outputs)
        unknown = np.full(count if sensors == 1 else (count, sensors), np.nan)
        quiet = np.zeros(count), np.zeros(count, dtype=np.intp)
        return FilterState(mean, mean, matrices, factor, unknown, unknown, *quiet)

    @final
    def predict(self, state: FilterState, voltage: FloatArray | float) -> FilterState:
        """The state one sample later, before its measurement.

        Parameters
        ----------
        voltage : array, shape (runs,), or float
            Input u held from this sample to the next; of a process with n inputs of shape (runs, n) or (n,).
        """
        inputs = _given(state, voltage, self.process.inputs, "voltage", "circuit")
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            # A non-finite result is not repaired: it becomes the run's named outcome.
            factor = state.factor.transpose(1, 2, 0)
            mean, covariance = self.predicted(self._terms, state.mean.T[:, None], factor, inputs)
            judged = state.innovation, state.innovation_variance, state.out_of_band
            return self._next(mean[:, 0].T, covariance.transpose(2, 0, 1), judged, state.outcome)

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
        readings, judged = _given(state, measurement, len(self.process.outputs), "reading", "sensor"), []
        for sensor in range(len(self.process.outputs)):
            state = self._update_one(state, readings[:, sensor], sensor)
            judged.append((state.innovation, state.innovation_variance))
        if len(judged) == 1:
            return state
        innovation, variance = (np.stack(values, axis=1) for values in zip(*judged, strict=True))
        return replace(state, innovation=innovation, innovation_variance=variance)

    def _update_one(self, state: FilterState, measurement: FloatArray, sensor: int) -> FilterState:
        before = state.mean.T[:, None], state.covariance.transpose(1, 2, 0), state.factor.transpose(1, 2, 0)
        read, noise = ~np.isnan(measurement), self.process.outputs[sensor].variance
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            mean, covariance, (row,), (spreads,) = self.corrected(self._terms, sensor, before, measurement, noise)
            innovation, variance, outcome = row[0], spreads[0], state.outcome
            mean, covariance = mean[:, 0].T, covariance.transpose(2, 0, 1)
            outside = innovation**2 > BAND_99_9 * variance
            fraction = state.out_of_band + read * (outside - state.out_of_band) / self.divergence_steps
            if not read.all():
                variance, mean = np.where(read, variance, np.nan), np.where(read[:, None], mean, state.mean)
                covariance = np.where(read[:, None, None], covariance, state.covariance)
            if (out := (fraction > 0.5) & (outcome == RUNNING)).any():
                outcome = np.where(out, FilterOutcome.INNOVATIONS_OUT_OF_BAND, outcome)
            return self._next(mean, covariance, (innovation, variance, fraction), outcome, state.predicted)

    @final
    def step(self, state: FilterState, voltage: FloatArray | float, measurement: ArrayLike) -> FilterState:
        """Predict with the voltage held since the last sample, then update with this sample's readings."""
        process = self.process
        if len(state.mean) == 1 and state.outcome.item() in _GOES_ON and process.light:
            plain = isinstance(voltage, float) and process.inputs == 1
            inputs = voltage if plain else _given(state, voltage, process.inputs, "voltage", "circuit")[0]
            readings = _given(state, measurement, len(process.outputs), "reading", "sensor")[0]
            if (after := self._next_alone(state, inputs, readings)) is not None:
                return after
        return self.update(self.predict(state, voltage), measurement)

    @cached_property
    def _single(self) -> tuple[Caller, FloatArray, list[slice]]:
        """One step of one run as one function, the variances of its readings, and where its results stand."""
        function, n, m = step_function(self), self.process.order, len(self.process.outputs)
        ends = np.cumsum([0, n * n, n * n, n, n, m, m]).tolist()
        variances = np.array([output.variance for output in self.process.outputs])
        return Caller(function, Compilation(lambda: function)), variances, [slice(*pair) for pair in pairwise(ends)]

    @cached_property
    def _terms(self) -> Terms:
        return in_arrays(self.process)

    def __getstate__(self) -> dict[str, Any]:
        """What is worked out again on demand is not pickled."""
        return {name: value for name, value in vars(self).items() if name not in {"_single", "_terms"}}

    @final
    def _next_alone(self, state: FilterState, inputs: Any, readings: FloatArray) -> FilterState | None:
        """The state of one run to which nothing happens; None where anything must be named."""
        process, fraction, n = self.process, state.out_of_band.item(), state.mean.shape[1]
        step, variances, places = self._single
        if (missing := np.isnan(readings)).any():
            readings, variances = np.where(missing, 0.0, readings), np.where(missing, MISSING, variances)
        values = step(state.mean[0], state.factor[0].T.ravel(), inputs, readings, variances)
        covariance, factor, mean, predicted, innovations, spreads = (values[place] for place in places)
        for innovation, spread, unread in zip(innovations.tolist(), spreads.tolist(), missing.tolist(), strict=True):
            if not unread:
                fraction += ((innovation * innovation > BAND_99_9 * spread) - fraction) / self.divergence_steps
        plausible = process.is_plausible(predicted.tolist()) and process.is_plausible(mean.tolist())
        if (fraction > 0.5 and not state.outcome.item()) or not plausible or not factor[-1] > 0.0:
            return None
        if missing.any():
            innovations, spreads = np.where(missing, np.nan, innovations), np.where(missing, np.nan, spreads)
        judged = (innovations, spreads) if len(process.outputs) == 1 else (innovations[None], spreads[None])
        moments = mean[None], covariance.reshape(1, n, n), factor.reshape(n, n).T[None]
        return FilterState(predicted[None], *moments, *judged, np.array([fraction]), state.outcome)

    def _next(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        judged: tuple[FloatArray, FloatArray, FloatArray],
        outcome: IntArray,
        predicted: FloatArray | None = None,
    ) -> FilterState:
        """Name what went wrong; the first name of a run stays. What is not given as predicted is the mean."""
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
        return FilterState(mean if predicted is None else predicted, mean, covariance, factor, *judged, outcome)


def _given(state: FilterState, value: ArrayLike, width: int, what: str, whose: str) -> FloatArray:
    """Numbers of shape (runs, width), of one row for all or one each.

    A single number of each run may be given without an axis of its own.
    """
    numbers, runs = np.asarray(value, dtype=np.float64), len(state.mean)
    if numbers.shape == (runs, width) or (width == 1 and numbers.shape == (runs,)):
        return numbers.reshape(runs, width)
    if numbers.size != width:
        raise FilterError(
            f"A step takes {counted(width, what)} for each of {counted(runs, 'run')}, one a {whose}; instead "
            f"received the shape {numbers.shape}."
        )
    return np.repeat(numbers.reshape(1, width), runs, axis=0)


def cholesky(matrices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Lower factors L with L L^T = M.

    Parameters
    ----------
    matrices : array, shape (runs, n, n)
        Symmetric; only the lower triangle is read.

    Returns
    -------
    factor : array, shape (runs, n, n)
        NaN where the matrix is not positive definite.

    References
    ----------
    G. H. Golub and C. F. Van Loan, Matrix Computations (Johns Hopkins, 2013), section 4.2.5.
    """
    runs, order, _ = matrices.shape
    if runs < order**3:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(matrices), np.float64), np.ones(runs, dtype=np.bool_)
    factor = np.zeros((order, order, runs))  # each entry's values of all runs are neighbours
    with np.errstate(invalid="ignore", divide="ignore", over="ignore", under="ignore"):
        for j in range(order):
            pivot = matrices[:, j, j]
            for k in range(j):
                pivot = pivot - factor[j, k] ** 2
            root = np.sqrt(pivot, out=factor[j, j])
            for i in range(j + 1, order):
                entry = matrices[:, i, j]
                for k in range(j):
                    entry = entry - factor[i, k] * factor[j, k]
                np.divide(entry, root, out=factor[i, j])
        definite = factor[-1, -1] > 0.0  # a pivot that is not positive makes all later ones NaN
    factor = factor.transpose(2, 0, 1)
    if not definite.all():
        factor[~definite] = np.nan
    return factor, definite
