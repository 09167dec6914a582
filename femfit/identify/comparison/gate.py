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
from femfit.identify.comparison.patterns import Patterns, smooth_patterns
from femfit.identify.decision.diagnosis import Gate
from femfit.identify.noise.whitening import Whitening, orthonormal_basis
from femfit.identify.readings.observations import Observations

_SPANNED = 1e-4
"""Squared sine below which a pattern lies in the fitted columns."""


_COARSE = (2, 3)
"""Degrees up to which patterns are tested apart from the finer ones, which would drown a broad misfit."""


def tail_probability(square: float, count: int, degrees_of_freedom: float) -> float:
    """Probability of at least this squared length in directions that hold noise alone.

    Parameters
    ----------
    square : float
        Squared length, in units of the noise.
    degrees_of_freedom : float
        Of the noise level; infinite where it is known.

    Returns
    -------
    float
        Of F(count, degrees of freedom), or of chi-square.
    """
    if np.isfinite(degrees_of_freedom):
        return float(stats.f.sf(square / count, count, degrees_of_freedom))
    return float(stats.chi2.sf(square, count))


@dataclass(frozen=True, eq=False)
class Group:
    """Patterns that are tested together.

    Parameters
    ----------
    basis : array, shape (M, k)
        Whitened, orthonormal.
    degrees_of_freedom : float
        Of the noise level of their channels.
    """

    basis: FloatArray
    degrees_of_freedom: float

    def along(self, rest: FloatArray, fitted: FloatArray) -> tuple[float, int]:
        """Squared length of the residual in the patterns beside orthonormal fitted columns L, and their number.

        With orthonormal B and L and L'B = U diag(c) V', the patterns beside L have the metric I - V diag(c^2) V', whose
        inverse adds (v'a)^2 c^2 / (1 - c^2) to |a|^2; a pattern that L spans (c = 1) is no freedom any more.
        """
        along, count = self.basis.T @ rest, self.basis.shape[1]
        if not fitted.shape[1]:
            return float(along @ along), count
        _, cosine, directions = np.linalg.svd(fitted.T @ self.basis, full_matrices=False)
        spanned = 1.0 - cosine**2 < _SPANNED
        part = (directions @ along) ** 2
        gain = np.where(spanned, -1.0, cosine**2 / np.maximum(1.0 - cosine**2, _SPANNED))
        return float(along @ along + part @ gain), count - int(np.count_nonzero(spanned))

    def test(self, rest: FloatArray, fitted: FloatArray) -> Gate:
        """Test a residual beside orthonormal fitted columns."""
        square, count = self.along(rest, fitted)
        if not count:
            return Gate(0.0, 0, 1.0)
        return Gate(square / count, count, tail_probability(square, count, self.degrees_of_freedom))


@dataclass(frozen=True, eq=False)
class PatternSpace:
    """Whitened smooth patterns, all together and in groups: each channel and all channels, broad patterns and all.

    Parameters
    ----------
    groups : tuple of Group
        The last one holds all patterns.
    """

    patterns: Patterns
    groups: tuple[Group, ...]

    @property
    def basis(self) -> FloatArray:
        """Orthonormal, of all patterns; shape (M, k)."""
        return self.groups[-1].basis

    @property
    def degrees_of_freedom(self) -> float:
        """Of the noise level of all channels."""
        return self.groups[-1].degrees_of_freedom

    def excess(self, rest: FloatArray, fitted: FloatArray | None = None) -> float:
        """Squared length of a whitened residual in the patterns beyond what noise gives; may be negative."""
        rest, left = _beside(rest, fitted)
        square, count = self.groups[-1].along(rest, left)
        return square - count

    def test(self, rest: FloatArray, fitted: FloatArray | None = None) -> Gate:
        """Test a whitened residual in every group.

        Parameters
        ----------
        rest : array, shape (M,)
            Whitened.
        fitted : array, shape (M, p), or None
            Whitened columns that were fitted to it: directions in which it has no freedom left.

        Returns
        -------
        Gate
            Of the group that is least likely to be noise; its p-value times the number of groups (Bonferroni).
        """
        rest, left = _beside(rest, fitted)
        worst = min((group.test(rest, left) for group in self.groups), key=lambda gate: gate.p_value)
        return Gate(worst.statistic, worst.degrees_of_freedom, min(1.0, len(self.groups) * worst.p_value))


def _beside(rest: FloatArray, fitted: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """A residual without its part along fitted columns, and their orthonormal basis."""
    if fitted is None or not fitted.shape[1]:
        return rest, np.zeros((len(rest), 0))
    left = orthonormal_basis(fitted)
    return rest - left @ (left.T @ rest), left


def pattern_space(observations: Observations, whitening: Whitening) -> PatternSpace:
    """The whitened smooth patterns of a campaign.

    Returns
    -------
    PatternSpace
        With the degrees of freedom of each group's repeats.
    """
    patterns = smooth_patterns(observations)
    columns, degrees = whitening.full(patterns.columns), whitening.noise.degrees_of_freedom
    everything = np.ones(len(patterns.channel), dtype=bool)
    of_channel = [patterns.channel == c for c in np.unique(patterns.channel)]
    picked = [here & (patterns.degree <= cut) for here in of_channel for cut in _COARSE]
    picked += [*of_channel, patterns.degree <= _COARSE[0], everything]
    distinct = {part.tobytes(): part for part in picked if part.any()}  # a single channel is all of them
    groups = [
        Group(orthonormal_basis(columns[:, part]), float(np.sum(degrees[np.unique(patterns.channel[part])])))
        for part in distinct.values()
    ]
    return PatternSpace(patterns, tuple(sorted(groups, key=lambda group: group.basis.shape[1])))
