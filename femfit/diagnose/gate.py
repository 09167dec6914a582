"""The structured lack-of-fit gate: is anything missing, before a name is sought and after one was given.

In whitened units a residual without structure has squared length chi-square distributed in any k directions. The
directions are smooth patterns over the settings; noise known from nu repeats turns chi-square / k into F(k, nu).

References
----------
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: lack of fit against pure error.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from femfit.core.arrays import FloatArray
from femfit.diagnose.diagnosis import Gate
from femfit.diagnose.observations import Observations
from femfit.diagnose.patterns import Patterns, smooth_patterns
from femfit.diagnose.whitening import Whitening


@dataclass(frozen=True, eq=False)
class PatternSpace:
    """Whitened smooth patterns.

    Parameters
    ----------
    basis : array, shape (M, k)
        Orthonormal columns.
    patterns : Patterns
        What they span, before whitening.
    degrees_of_freedom : float
        Of the noise level.
    """

    basis: FloatArray
    patterns: Patterns
    degrees_of_freedom: float

    def excess(self, rest: FloatArray, fitted: FloatArray | None = None) -> float:
        """Squared length of a whitened residual in the patterns beyond what noise gives; may be negative."""
        basis = self._beside(fitted)
        along = basis.T @ rest
        return float(along @ along - basis.shape[1])

    def test(self, rest: FloatArray, fitted: FloatArray | None = None) -> Gate:
        """Test a whitened residual.

        Parameters
        ----------
        rest : array, shape (M,)
            Whitened.
        fitted : array, shape (M, p), or None
            Whitened columns that were fitted to it: directions in which it has no freedom left.

        Returns
        -------
        Gate
            With the p-value of F(k, nu).
        """
        basis = self._beside(fitted)
        along, count = basis.T @ rest, basis.shape[1]
        statistic = float(along @ along) / max(count, 1)
        if np.isfinite(self.degrees_of_freedom):
            p_value = float(stats.f.sf(statistic, count, self.degrees_of_freedom))
        else:
            p_value = float(stats.chi2.sf(statistic * count, count))
        return Gate(statistic, count, p_value)

    def _beside(self, fitted: FloatArray | None) -> FloatArray:
        """The patterns orthogonal to fitted columns."""
        if fitted is None or not fitted.shape[1]:
            return self.basis
        left = np.linalg.qr(fitted / np.maximum(np.linalg.norm(fitted, axis=0), 1e-300))[0]
        vectors, sizes, _ = np.linalg.svd(self.basis - left @ (left.T @ self.basis), full_matrices=False)
        return np.asarray(vectors[:, sizes > 1e-6])


def pattern_space(observations: Observations, whitening: Whitening) -> PatternSpace:
    """The whitened smooth patterns of a campaign.

    Parameters
    ----------
    observations : Observations
        M readings.
    whitening : Whitening
        Of its noise.

    Returns
    -------
    PatternSpace
        With the degrees of freedom of all channels' repeats together.
    """
    patterns = smooth_patterns(observations)
    columns = whitening.full(patterns.columns)
    left, sizes, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    degrees = float(np.sum(whitening.noise.degrees_of_freedom))
    return PatternSpace(left[:, sizes > 1e-6 * sizes[0]], patterns, degrees)
