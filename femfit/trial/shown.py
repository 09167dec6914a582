"""How plainly the readings of a campaign show an error, to somebody who knows everything else."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from femfit.core.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from femfit.trial.virtual_bench import Meter


def expected_fall(
    change: Mapping[str, FloatArray],
    slope: Mapping[str, FloatArray],
    kept: Mapping[str, BoolArray],
    meters: Mapping[str, "Meter"],
    run: IntArray,
    mount_m: float,
) -> float:
    """Fall of the weighted sum of squares by the true error, delta' C^-1 delta, in the mean over the noise.

    Parameters
    ----------
    change, slope, kept : mapping of str to array, shape (n,)
        By channel: change by the error, slope over the distance, and whether a reading was kept; in the order of
        measuring.
    meters : mapping of str to Meter
        C holds their noise, which follows itself within a run, and rounding.
    run : array, shape (n,)
        Number of each reading's run; all readings of a run share one error of its mount.
    mount_m : float
        Standard deviation of that error.
    """
    fall = 0.0
    for number in np.unique(run):
        noise = crossed = shifted = 0.0
        for name, meter in meters.items():
            at = np.flatnonzero((run == number) & kept[name])
            if not len(at):
                continue
            covariance = meter.sigma**2 * meter.rho ** np.abs(at[:, None] - at[None, :])
            covariance[np.diag_indices(len(at))] += meter.step**2 / 12.0
            factor = cho_factor(covariance)
            weighted = cho_solve(factor, change[name][at])
            noise += float(change[name][at] @ weighted)
            crossed += float(slope[name][at] @ weighted)
            shifted += float(slope[name][at] @ cho_solve(factor, slope[name][at]))
        fall += noise - (crossed**2 / (1.0 / mount_m**2 + shifted) if mount_m > 0.0 else 0.0)
    return fall
