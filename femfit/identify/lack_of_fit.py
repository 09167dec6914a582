"""Lack of fit of a model: whether a residual has structure, in which channel.

The residual is tested against smooth patterns over the settings. In whitened units a residual without structure has
squared length chi-square distributed in any k directions; noise known from nu repeats turns chi-square / k into
F(k, nu).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from femfit.core.numerics import BoolArray, FloatArray, first_best
from femfit.identify.constants import COARSE
from femfit.identify.noise.whitening import Whitening, orthonormal_basis
from femfit.identify.patterns import Patterns, smooth_patterns

SPANNED = 1e-4
"""Numerical: squared sine below which a pattern lies in the fitted columns."""


@dataclass(frozen=True)
class LackOfFit:
    """The outcome of a lack-of-fit test."""

    # Squared length of the whitened residual in the tested directions, over its degrees of freedom; 1 is expected
    statistic: float
    degrees_of_freedom: int
    p_value: float  # Probability of at least this statistic where nothing is missing


@dataclass(frozen=True, eq=False)
class PatternSpace:
    """Whitened smooth patterns, all together and in groups: each channel and all channels, broad patterns and all."""

    patterns: Patterns
    whitened: FloatArray  # Shape (M, n)
    # Patterns that are tested together, whitened and orthonormal, shape (M, k), and the noise's degrees of freedom
    groups: tuple[tuple[FloatArray, float], ...]

    def excess(self, residual: FloatArray) -> float:
        """Squared length of a whitened residual in the patterns beyond what noise gives; may be negative."""
        along = self.groups[-1][0].T @ residual
        return float(along @ along) - len(along)

    def test(self, residual: FloatArray, fitted: FloatArray | None = None) -> LackOfFit:
        """Test a whitened residual in every group; the p-value of the worst counts times their number (Bonferroni).

        What was fitted to it, whitened columns of shape (M, p), are directions in which it has no freedom left; nor has
        it in a pattern that they span.
        """
        span = orthonormal_basis(np.zeros((len(residual), 0)) if fitted is None else fitted)
        residual = residual - span @ (span.T @ residual)
        tests = []
        for basis, repeats in self.groups:
            if span.shape[1]:
                directions, sine, _ = np.linalg.svd(basis - span @ (span.T @ basis), full_matrices=False)
                basis = directions[:, sine**2 > SPANNED]  # noqa: PLW2901  what is left of it
            along = basis.T @ residual
            count, ratio = len(along), float(along @ along) / max(len(along), 1)
            tail = stats.f.sf(ratio, count, repeats) if np.isfinite(repeats) else stats.chi2.sf(count * ratio, count)
            tests.append(LackOfFit(ratio, count, float(tail) if count else 1.0))
        worst = tests[first_best([-outcome.p_value for outcome in tests])]
        return replace(worst, p_value=min(1.0, len(self.groups) * worst.p_value))


def pattern_space(whitening: Whitening) -> PatternSpace:
    """The whitened smooth patterns of a campaign; without groups where every channel has too few readings."""
    patterns = smooth_patterns(whitening.observations)
    columns, degrees = whitening.full(patterns.columns), whitening.noise.degrees_of_freedom
    everything = np.ones(len(patterns.channel), dtype=bool)
    of_channel = [patterns.channel == c for c in np.unique(patterns.channel)]
    picked = [here & (patterns.degree <= cut) for here in of_channel for cut in COARSE]
    picked += [*of_channel, patterns.degree <= COARSE[0], everything]
    groups = [
        (orthonormal_basis(columns[:, picks]), float(np.sum(degrees[np.unique(patterns.channel[picks])])))
        for picks in distinct(picked)
    ]
    return PatternSpace(patterns, columns, tuple(sorted(groups, key=lambda group: group[0].shape[1])))


def distinct(picked: Iterable[BoolArray]) -> list[BoolArray]:
    """Each choice of patterns once, without empty ones: a single channel is all of them."""
    return list({picks.tobytes(): picks for picks in picked if picks.any()}.values())
