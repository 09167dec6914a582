"""The state of a batch of filters: what one step hands to the next."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import FilterError
from femfit.filters.outcome import FilterOutcome


@dataclass(frozen=True, eq=False)
class FilterState:
    """Estimates of many runs; never changed, every step returns a new one.

    Parameters
    ----------
    mean : array, shape (runs, n)
        Estimated state; NaN from the step at which a run broke down numerically.
    covariance : array, shape (runs, n, n)
        Of the estimate's error.
    factor : array, shape (runs, n, n)
        Lower Cholesky factor of the covariance.
    points : array, shape (runs, 2n + 1, n), or None
        Predicted sigma points, kept for the update where the filter reuses them.
    innovation : array, shape (runs,)
        Measurement minus its prediction at the last update; NaN before the first.
    innovation_variance : array, shape (runs,)
        What the filter expects of its square.
    out_of_band : array, shape (runs,)
        Recent fraction of innovations outside of their band.
    outcome : array of int, shape (runs,)
        A :class:`FilterOutcome` each.
    """

    mean: FloatArray
    covariance: FloatArray
    factor: FloatArray
    points: FloatArray | None
    innovation: FloatArray
    innovation_variance: FloatArray
    out_of_band: FloatArray
    outcome: IntArray

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.mean)

    @property
    def diverged(self) -> BoolArray:
        """Which runs have an outcome other than RUNNING."""
        return np.asarray(self.outcome != FilterOutcome.RUNNING)

    @property
    def normalised_innovation_squared(self) -> FloatArray:
        """Innovation^2 over its variance, shape (runs,): chi-square with one degree of freedom in a true filter."""
        return np.asarray(self.innovation**2 / self.innovation_variance)

    def outcomes(self) -> tuple[FilterOutcome, ...]:
        """The outcome of every run."""
        return tuple(FilterOutcome(int(code)) for code in self.outcome)

    def require_running(self) -> None:
        """Refuse to go on with a diverged run."""
        if np.any(self.diverged):
            run = int(np.flatnonzero(self.diverged)[0])
            outcome = FilterOutcome(int(self.outcome[run]))
            raise FilterError(
                f"{int(np.sum(self.diverged))} of {self.runs} filters diverged; run {run}: "
                f"{outcome.name.lower()}. {outcome.sentence}"
            )
