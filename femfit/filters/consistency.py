"""Whether a filter's innovations are as large as it says.

The normalised innovation squared of a true filter is chi-square with one degree of freedom and white, so that the sum
over N samples is chi-square with N. Quantiles by Wilson and Hilferty's cube-root transformation, within 0.1 % for
N >= 30 (numpy has none).

References
----------
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4.
E. B. Wilson and M. M. Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684.
"""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from femfit.core.arrays import FloatArray


@dataclass(frozen=True)
class ConsistencyBand:
    """Interval for a mean of N independent chi-square variables.

    Parameters
    ----------
    lower, upper : float
        Its ends; the expectation is the number of degrees of freedom of one variable.
    """

    lower: float
    upper: float

    def contains(self, value: float) -> bool:
        """Whether a mean lies in the band; NaN does not."""
        return self.lower <= value <= self.upper


def consistency_band(samples: int, confidence: float = 0.95, freedom: int = 1) -> ConsistencyBand:
    """Two-sided band of the mean of normalised squares.

    Parameters
    ----------
    freedom : int
        Degrees of freedom of each: 1 for the innovation (NIS), n for the state's error (NEES).
    """
    total = samples * freedom
    width = 2.0 / (9.0 * total)
    z = NormalDist().inv_cdf(0.5 + 0.5 * confidence) * width**0.5
    return ConsistencyBand(freedom * (1.0 - width - z) ** 3, freedom * (1.0 - width + z) ** 3)


def normalised_error_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """e^T P^-1 e, the NEES.

    Parameters
    ----------
    error : array, shape (runs, n)
        Estimate minus truth.
    covariance : array, shape (runs, n, n)
        What the filter says of it.

    Returns
    -------
    array, shape (runs,)
        Chi-square with n degrees of freedom in a true filter.
    """
    return np.asarray(np.einsum("ri,ri->r", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0]))
