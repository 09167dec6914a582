"""Lack of fit of a model: whether a residual has structure, in which channel.

The residual is tested against smooth patterns over the settings. In whitened units a residual without structure has
squared length chi-square distributed in any k directions; noise known from nu repeats turns chi-square / k into
F(k, nu).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from femfit.core.numerics import BoolArray, FloatArray, first_best
from femfit.identify.constants import COARSE, SPANNED
from femfit.identify.noise.whitening import Whitening, orthonormal_basis
from femfit.identify.patterns import Patterns, smooth_patterns


@dataclass(frozen=True)
class LackOfFit:
    """The outcome of a lack-of-fit test."""

    # Squared length of the whitened residual in the tested directions, over its degrees of freedom; 1 is expected
    statistic: float
    degrees_of_freedom: int
    p_value: float  # Probability of at least this statistic where nothing is missing


@dataclass(frozen=True, eq=False)
class Group:
    """Patterns that are tested together."""

    basis: FloatArray  # Whitened, orthonormal; shape (M, k)
    degrees_of_freedom: float

    def test(self, residual: FloatArray, fitted: FloatArray) -> LackOfFit:
        """Test a residual beside orthonormal fitted columns; a pattern that these span is no freedom any more."""
        directions, sine, _ = np.linalg.svd(self.basis - fitted @ (fitted.T @ self.basis), full_matrices=False)
        along = (directions[:, sine**2 > SPANNED] if fitted.shape[1] else self.basis).T @ residual
        square, count, repeats = float(along @ along), len(along), self.degrees_of_freedom
        if not count:
            return LackOfFit(0.0, 0, 1.0)
        tail = stats.f.sf(square / count, count, repeats) if np.isfinite(repeats) else stats.chi2.sf(square, count)
        return LackOfFit(square / count, count, float(tail))


@dataclass(frozen=True, eq=False)
class PatternSpace:
    """Whitened smooth patterns, all together and in groups: each channel and all channels, broad patterns and all."""

    patterns: Patterns
    whitened: FloatArray  # Shape (M, n)
    groups: tuple[Group, ...]

    def excess(self, residual: FloatArray) -> float:
        """Squared length of a whitened residual in the patterns beyond what noise gives; may be negative."""
        along = self.groups[-1].basis.T @ residual
        return float(along @ along) - len(along)

    def test(self, residual: FloatArray, fitted: FloatArray | None = None) -> LackOfFit:
        """Test a whitened residual in every group; the p-value of the worst counts times their number (Bonferroni).

        What was fitted to it, whitened columns of shape (M, p), are directions in which it has no freedom left.
        """
        basis = orthonormal_basis(np.zeros((len(residual), 0)) if fitted is None else fitted)
        beside = residual - basis @ (basis.T @ residual)
        tests = [group.test(beside, basis) for group in self.groups]
        worst = tests[first_best([-outcome.p_value for outcome in tests])]
        return LackOfFit(worst.statistic, worst.degrees_of_freedom, min(1.0, len(self.groups) * worst.p_value))


def pattern_space(whitening: Whitening) -> PatternSpace:
    """The whitened smooth patterns of a campaign; without groups where every channel has too few readings."""
    patterns = smooth_patterns(whitening.observations)
    columns, degrees = whitening.full(patterns.columns), whitening.noise.degrees_of_freedom
    everything = np.ones(len(patterns.channel), dtype=bool)
    of_channel = [patterns.channel == c for c in np.unique(patterns.channel)]
    picked = [here & (patterns.degree <= cut) for here in of_channel for cut in COARSE]
    picked += [*of_channel, patterns.degree <= COARSE[0], everything]
    groups = [
        Group(orthonormal_basis(columns[:, picks]), float(np.sum(degrees[np.unique(patterns.channel[picks])])))
        for picks in distinct(picked)
    ]
    return PatternSpace(patterns, columns, tuple(sorted(groups, key=lambda group: group.basis.shape[1])))


def distinct(picked: Iterable[BoolArray]) -> list[BoolArray]:
    """Each choice of patterns once, without empty ones: a single channel is all of them."""
    return list({picks.tobytes(): picks for picks in picked if picks.any()}.values())
