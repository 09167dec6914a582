"""The stepping interface that every filter shares.

Classes are abstract (this one) or final: a filter supplies its two moment computations; bookkeeping of outcomes and
innovations is here, once.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import FilterError
from femfit.filters.cholesky import cholesky
from femfit.filters.filter_state import FilterState
from femfit.filters.outcome import FilterOutcome
from femfit.filters.process import FilterProcess

BAND_99_9 = 10.828
"""99.9 % quantile of chi-square with one degree of freedom."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean, covariance and its factor of many runs.

    Parameters
    ----------
    mean : array, shape (runs, n)
        Means.
    covariance, factor : array, shape (runs, n, n)
        Covariance P and lower L with L L^T = P.
    definite : array of bool, shape (runs,)
        Where P is positive definite.
    points : array, shape (runs, 2n + 1, n), or None
        Sigma points to keep.
    """

    mean: FloatArray
    covariance: FloatArray
    factor: FloatArray
    definite: BoolArray
    points: FloatArray | None = None


def moments_of(mean: FloatArray, covariance: FloatArray, points: FloatArray | None = None) -> Moments:
    """Moments with the covariance symmetrised and factorised.

    Parameters
    ----------
    mean : array, shape (runs, n)
        Means.
    covariance : array, shape (runs, n, n)
        Symmetric up to rounding.
    points : array, shape (runs, 2n + 1, n), or None
        Sigma points to keep.
    """
    covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
    factor, definite = cholesky(covariance)
    return Moments(mean, covariance, factor, definite, points)


@dataclass(frozen=True, eq=False)
class Correction:
    """Result of an update.

    Parameters
    ----------
    innovation, innovation_variance : array, shape (runs,)
        Measurement minus prediction, and its expected square.
    """

    moments: Moments
    innovation: FloatArray
    innovation_variance: FloatArray


@dataclass(frozen=True, eq=False)
class Filter(ABC):
    """A recursive estimator for a :class:`FilterProcess`, batched over runs.

    Parameters
    ----------
    process : FilterProcess
        The world as told to the filter.
    divergence_steps : int
        A run is named INNOVATIONS_OUT_OF_BAND once more than half of its last (exponentially weighted) so many
        innovations left their 99.9 % band; a true filter leaves it once in a thousand steps.
    """

    process: FilterProcess
    divergence_steps: int = 200

    @abstractmethod
    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        """Moments one step later."""

    @abstractmethod
    def _corrected(self, state: FilterState, measurement: FloatArray) -> Correction:
        """Moments given the measurement."""

    @final
    def start(self, mean: FloatArray, covariance: FloatArray, runs: int = 1) -> FilterState:
        """Initial state, eq. (19) of the paper.

        Parameters
        ----------
        mean : array, shape (n,) or (runs, n)
            First estimate.
        covariance : array, shape (n, n) or (runs, n, n)
            Of its error.
        runs : int
            Size of the batch where ``mean`` has the shape (n,).

        Raises
        ------
        FilterError
            If shapes do not fit, or the covariance is not positive definite.

        References
        ----------
        A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, section 4.1.
        """
        mean = np.asarray(mean)
        dtype = mean.dtype if mean.dtype == np.float32 else np.dtype(np.float64)
        order = self.process.order
        if mean.shape[-1:] != (order,) or np.shape(covariance)[-2:] != (order, order):
            raise FilterError(
                f"Initial mean and covariance must have the shapes ({order},) and ({order}, {order}) for the states "
                f"{', '.join(self.process.names)}; instead received {mean.shape} and {np.shape(covariance)}."
            )
        runs = len(mean) if mean.ndim == 2 else runs
        mean = np.broadcast_to(mean, (runs, order)).astype(dtype)
        covariance = np.broadcast_to(covariance, (runs, order, order)).astype(dtype)
        factor, definite = cholesky(covariance)
        if not (np.all(definite) and np.all(np.isfinite(mean))):
            raise FilterError(
                "The initial covariance must be positive definite and the initial mean finite; give every state an "
                "uncertainty > 0."
            )
        unknown = np.full(runs, np.nan, dtype=dtype)
        return FilterState(
            mean=mean,
            covariance=covariance,
            factor=factor,
            points=None,
            innovation=unknown,
            innovation_variance=unknown,
            out_of_band=np.zeros(runs, dtype=dtype),
            outcome=np.zeros(runs, dtype=np.intp),
        )

    @final
    def predict(self, state: FilterState, voltage: FloatArray | float) -> FilterState:
        """The state one sample later.

        Parameters
        ----------
        voltage : array, shape (runs,), or float
            Input u held from this sample to the next.

        Returns
        -------
        FilterState
            Of the next sample, before its measurement.
        """
        inputs = np.broadcast_to(np.asarray(voltage, dtype=state.mean.dtype), (state.runs,))
        # A non-finite result is not repaired: it becomes the run's named outcome.
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            moments = self._predicted(state, inputs)
            return self._next(state, moments, state.outcome)

    @final
    def update(self, state: FilterState, measurement: FloatArray | float) -> FilterState:
        """The state given this sample's measurement.

        Parameters
        ----------
        measurement : array, shape (runs,), or float
            z.
        """
        values = np.broadcast_to(np.asarray(measurement, dtype=state.mean.dtype), (state.runs,))
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            correction = self._corrected(state, values)
            innovation, variance = correction.innovation, correction.innovation_variance
            outside = innovation**2 > BAND_99_9 * variance
            fraction = state.out_of_band + (outside - state.out_of_band) / self.divergence_steps
            code = np.where(fraction > 0.5, FilterOutcome.INNOVATIONS_OUT_OF_BAND, FilterOutcome.RUNNING)
            outcome = np.where(state.outcome == FilterOutcome.RUNNING, code, state.outcome)
            following = self._next(state, correction.moments, outcome)
        return replace(
            following,
            innovation=innovation,
            innovation_variance=variance,
            out_of_band=fraction.astype(state.mean.dtype),
        )

    @final
    def step(self, state: FilterState, voltage: FloatArray | float, measurement: FloatArray | float) -> FilterState:
        """Predict with the voltage held since the last sample, then update with this sample's measurement."""
        return self.update(self.predict(state, voltage), measurement)

    def _next(self, state: FilterState, moments: Moments, outcome: IntArray) -> FilterState:
        finite = np.isfinite(moments.mean).all(axis=1)
        healthy = finite & moments.definite
        code = np.where(finite, FilterOutcome.COVARIANCE_LOST, FilterOutcome.NOT_FINITE)
        code = np.where(healthy, FilterOutcome.RUNNING, code)
        if self.process.plausible is not None:
            lost = healthy & ~self.process.plausible(moments.mean)
            code = np.where(lost, FilterOutcome.LEFT_MODEL, code)
        return replace(
            state,
            mean=np.where(healthy[:, None], moments.mean, np.nan).astype(state.mean.dtype, copy=False),
            covariance=moments.covariance,
            factor=moments.factor,
            points=moments.points,
            outcome=np.where(state.outcome == FilterOutcome.RUNNING, np.where(code != 0, code, outcome), state.outcome),
        )
