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
from femfit.diagnose.whitening import Whitening, orthonormal_basis

_SPANNED = 1e-4
"""Squared sine below which a pattern lies in the fitted columns."""


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
        square, count = self._along(rest, fitted)
        return square - count

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
        square, count = self._along(rest, fitted)
        statistic = square / max(count, 1)
        if np.isfinite(self.degrees_of_freedom):
            p_value = float(stats.f.sf(statistic, count, self.degrees_of_freedom))
        else:
            p_value = float(stats.chi2.sf(square, count))
        return Gate(statistic, count, p_value)

    def _along(self, rest: FloatArray, fitted: FloatArray | None) -> tuple[float, int]:
        """Squared length of the residual in the patterns beside fitted columns L, and their number.

        With orthonormal B and L and L'B = U diag(c) V', the patterns beside L have the metric I - V diag(c^2) V', whose
        inverse adds (v'a)^2 c^2 / (1 - c^2) to |a|^2; a pattern that L spans (c = 1) is no freedom any more.
        """
        count = self.basis.shape[1]
        if fitted is None or not fitted.shape[1]:
            along = self.basis.T @ rest
            return float(along @ along), count
        left = orthonormal_basis(fitted)
        along = self.basis.T @ (rest - left @ (left.T @ rest))
        _, cosine, directions = np.linalg.svd(left.T @ self.basis, full_matrices=False)
        spanned = 1.0 - cosine**2 < _SPANNED
        part = (directions @ along) ** 2
        gain = np.where(spanned, -1.0, cosine**2 / np.maximum(1.0 - cosine**2, _SPANNED))
        return float(along @ along + part @ gain), count - int(np.count_nonzero(spanned))


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
    degrees = float(np.sum(whitening.noise.degrees_of_freedom))
    return PatternSpace(orthonormal_basis(whitening.full(patterns.columns)), patterns, degrees)
