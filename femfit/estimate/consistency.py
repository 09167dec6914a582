"""Whether innovations are as large as the filter says, and white.

What an estimate says of every recorded channel, read by the filter or not.

References
----------
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4 (normalised innovations squared, whiteness).
R. K. Mehra, On the identification of variances and adaptive Kalman filtering, IEEE Trans. Automatic Control 15 (1970)
175 (correlation of the innovations of a gain that is too high or too low).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.estimate.constants import LEAST_JUDGED
from femfit.estimate.noise import ConsistencyBand, consistency_band

LAGS = 20
"""Conventional: lags of the innovations' autocorrelation, in samples."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """Of one sensor: mean square of the normalised innovations, which should be 1, and their autocorrelation."""

    sensor: str
    unit: str
    count: int
    mean_square: float
    band: ConsistencyBand
    autocorrelation: FloatArray  # At lags 1, 2, ...; of white innovations within +- the band's half-width in 95 %
    correlation_band: float
    rms: float  # Of the innovations themselves, in the sensor's unit

    @property
    def consistent(self) -> bool:
        """Whether the mean square lies in its 95 % band."""
        return self.band.contains(self.mean_square)

    @property
    def white(self) -> bool:
        """Whether the autocorrelation leaves its band no oftener than one lag in five, and nowhere by twice its width.

        At 20 lags a white sequence leaves the 95 % band at more than four lags in 0.3 % of cases.
        """
        return self._within(np.abs(self.autocorrelation))

    @property
    def bold(self) -> bool:
        """Whether they are larger than the filter says, or a reading's error comes back in the next ones.

        A filter that allows for more than there is follows each reading too far and takes it back in the next: its
        innovations are smaller than it says, or correlated with a negative sign, and its error is less than it claims.
        """
        return self.mean_square > self.band.upper or not self._within(self.autocorrelation)

    def _within(self, correlation: FloatArray) -> bool:
        outside = int((correlation > self.correlation_band).sum())
        return outside <= len(correlation) // 5 and not (correlation > 2.0 * self.correlation_band).any()

    @property
    def worst_lag(self) -> int:
        """Of the largest autocorrelation in magnitude, in samples."""
        return 1 + int(np.argmax(np.abs(self.autocorrelation)))

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        names = ("sensor", "unit", "count", "rms", "mean_square", "correlation_band", "consistent", "white")
        return {name: getattr(self, name) for name in names} | {
            "band": [self.band.lower, self.band.upper],
            "autocorrelation": self.autocorrelation.tolist(),
        }


def innovations_of(sensor: str, unit: str, innovation: FloatArray, variance: FloatArray) -> Innovations | None:
    """Judge the innovations of one sensor; None where it has fewer than :data:`LEAST_JUDGED`."""
    read = np.isfinite(innovation) & np.isfinite(variance)
    count = int(read.sum())
    if count < LEAST_JUDGED:
        return None
    normalised = np.where(read, innovation / np.sqrt(np.where(read, variance, 1.0)), 0.0)
    power = float((normalised**2).sum())
    lags = np.array([float((normalised[:-k] * normalised[k:]).sum()) for k in range(1, LAGS + 1)]) / power
    return Innovations(
        sensor=sensor,
        unit=unit,
        count=count,
        mean_square=power / count,
        band=consistency_band(count),
        autocorrelation=lags,
        correlation_band=1.96 / count**0.5,
        rms=float(np.sqrt(np.mean(innovation[read] ** 2))),
    )


@dataclass(frozen=True)
class Beside:
    """A recorded channel beside what the estimate says of it."""

    column: str
    used: bool  # Whether the filter read it
    rms: float
    mean: float  # Recorded less estimated


def beside(column: str, used: bool, recorded: FloatArray, estimated: FloatArray) -> Beside | None:
    """Compare a channel with its estimate; None where it has fewer than :data:`LEAST_JUDGED` samples."""
    difference = recorded - estimated
    read = np.isfinite(difference)
    if int(read.sum()) < LEAST_JUDGED:
        return None
    residual = difference[read]
    return Beside(column, used, float(np.sqrt(np.mean(residual**2))), float(residual.mean()))
