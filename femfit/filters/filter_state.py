"""The state of a batch of filters, which one step hands to the next, and how a run ended."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femfit.core.arrays import BoolArray, FloatArray, IntArray


class FilterOutcome(IntEnum):
    """How a run ended; the first outcome other than RUNNING stays."""

    RUNNING = 0
    COVARIANCE_LOST = 1
    NOT_FINITE = 2
    LEFT_MODEL = 3
    INNOVATIONS_OUT_OF_BAND = 4

    @property
    def sentence(self) -> str:
        """What happened and what to do about it."""
        return _SENTENCES[self]


_SENTENCES = {
    FilterOutcome.RUNNING: "The filter runs.",
    FilterOutcome.COVARIANCE_LOST: (
        "The covariance is no longer positive definite: the readings lie far outside of what the model predicts, the "
        "process covariance is not positive definite, or the filter runs in single precision. Check them in this order."
    ),
    FilterOutcome.NOT_FINITE: (
        "A measurement, input or estimate is not a finite number. Check the sensor's samples and the initial state; a "
        "sample that is missing may be NaN."
    ),
    FilterOutcome.LEFT_MODEL: (
        "The estimate went far outside of the distances and currents for which the model was fitted: the moving part "
        "is lost or the initial state is wrong. Start again from a measured distance."
    ),
    FilterOutcome.INNOVATIONS_OUT_OF_BAND: (
        "Most innovations stayed outside of their 99.9 % band: model, noise or sensor are not what the filter was "
        "given. Check the sensor's offset (4-state filter), the measurement noise and the force law."
    ),
}


@dataclass(frozen=True, eq=False)
class FilterState:
    """Estimates of many runs; never changed, every step returns a new one."""

    mean: FloatArray  # Estimated state; NaN from the step at which a run broke down numerically; shape (runs, n)
    # Covariance of the estimate's error, and its lower Cholesky factor; shape (runs, n, n)
    covariance: FloatArray
    factor: FloatArray
    # Measurement minus its prediction at the last update, and its expected square; NaN before the first
    # shape (runs,), and (runs, sensors) where there are several; NaN for a sample that is missing
    innovation: FloatArray
    innovation_variance: FloatArray
    out_of_band: FloatArray  # Recent fraction of innovations outside of their band; shape (runs,)
    outcome: IntArray  # A :class:`FilterOutcome` each; shape (runs,)

    @classmethod
    def of_fields(cls, value: Callable[[str], NDArray[Any]]) -> "FilterState":
        """A state from what stands for the name of each of its arrays."""
        return cls(**{array.name: value(array.name) for array in fields(cls)})

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.mean)

    @property
    def diverged(self) -> BoolArray:
        """Which runs have an outcome other than RUNNING."""
        return np.asarray(self.outcome != 0)

    @property
    def normalised_innovation_squared(self) -> FloatArray:
        """Innovation^2 over its variance, shape (runs,).

        In a true filter it is chi-square with one degree of freedom for each sensor that was read; NaN where all
        samples are missing.
        """
        ratio = self.innovation**2 / self.innovation_variance
        if ratio.ndim == 1:
            return np.asarray(ratio)
        read = np.isfinite(ratio)
        return np.where(read.any(axis=1), np.where(read, ratio, 0.0).sum(axis=1), np.nan)

    def outcomes(self) -> tuple[FilterOutcome, ...]:
        """The outcome of every run."""
        return tuple(FilterOutcome(int(code)) for code in self.outcome)
