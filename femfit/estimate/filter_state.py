"""The state that one step of a filter hands to the next, and how a run of it ended."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.estimate.words import sentence


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
        return sentence("filter", "outcome", self.name)


@dataclass(frozen=True, eq=False)
class FilterState:
    """Estimates of many runs; never changed, every step returns a new one."""

    predicted: FloatArray  # Estimated state before the last readings; shape (runs, n)
    mean: FloatArray  # And after them; NaN from the step at which a run broke down numerically
    # Covariance of the estimate's error, and its lower Cholesky factor; shape (runs, n, n)
    covariance: FloatArray
    factor: FloatArray
    # Measurement minus its prediction at the last update, and its expected square; NaN before the first
    # shape (runs,), and (runs, sensors) where there are several; NaN for a sample that is missing
    innovation: FloatArray
    innovation_variance: FloatArray
    out_of_band: FloatArray  # Recent fraction of innovations outside of their band; shape (runs,)
    outcome: IntArray  # A :class:`FilterOutcome` each; shape (runs,)

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
        ratio = np.atleast_2d((self.innovation**2 / self.innovation_variance).T).T
        read = np.isfinite(ratio)
        return np.where(read.any(axis=1), np.where(read, ratio, 0.0).sum(axis=1), np.nan)
