"""What is kept of the samples of one window of a batch of loops."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.filters.theory import ConsistencyBand, consistency_band


@dataclass(frozen=True, eq=False)
class WindowStatistics:
    """Over the samples of one window, each of shape (runs,); NaN for runs lost before the window's end."""

    estimate_rms_m: FloatArray  # sqrt(mean((estimated - true distance)^2))
    estimate_bias_m: FloatArray
    tracking_rms_m: FloatArray
    tracking_bias_m: FloatArray
    normalised_innovation_squared: FloatArray  # Mean over the readings; 1 is expected of a true filter
    readings: FloatArray  # How many a filter took, of all sensors; 0 without one

    def consistency(self, runs: BoolArray) -> tuple[float, ConsistencyBand]:
        """Mean of the normalised innovations squared of some runs, NaN where there are none, and its 95 % band."""
        count = np.where(runs & (self.readings > 0.0), self.readings, 0.0)
        total = int(count.sum())
        mean = (
            np.sum(np.where(count > 0.0, self.normalised_innovation_squared * count, 0.0)) / total if total else np.nan
        )
        return float(mean), consistency_band(max(1, total))


def window_statistics(
    sums: FloatArray, window: slice, lost_at: FloatArray, step: float, steps: int
) -> WindowStatistics:
    """From sums over the samples: squared error, error, both of the deviation, normalised innovations, readings."""
    stop = min(window.stop, steps)
    mean = np.where(lost_at >= stop * step - 0.5 * step, sums, np.nan) / (stop - window.start)
    with np.errstate(invalid="ignore"):
        quality = mean[4] / mean[5]
    return WindowStatistics(np.sqrt(mean[0]), mean[1], np.sqrt(mean[2]), mean[3], quality, sums[5])
