"""Lack of fit of a model: whether a residual has structure, in which channel, and where the model fails.

The residual is tested against smooth patterns over the settings. In whitened units a residual without structure has
squared length chi-square distributed in any k directions; noise known from nu repeats turns chi-square / k into
F(k, nu).

Where a model fails is said by the channel, what the misfit changes with, and one plain sentence: how large the misfit
is, of which sign, and whether it is the same everywhere or at which setting it is the largest.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from femfit.core.numerics import BoolArray, FloatArray, first_best
from femfit.effects.conditions import TEMPERATURES
from femfit.identify.constants import (
    BEYOND_NOISE,
    COARSE,
    COVARIATE_SHARE,
    LEAST_READINGS,
    LEFT_BY_SHARE,
    LEVEL,
    SAME_SHARE,
    WITHIN_NOISE,
)
from femfit.identify.noise.whitening import NoiseModel, Whitening, random_columns, setting_errors
from femfit.identify.observations import Observations
from femfit.identify.patterns import Patterns, orthonormal_basis, smooth_patterns
from femfit.identify.signatures import ROUNDED
from femfit.identify.words import sentence
from femfit.tables.header import parts_of

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
    columns = whitening.full(patterns.columns)
    everything = np.ones(len(patterns.channel), dtype=bool)
    of_channel = [patterns.channel == c for c in np.unique(patterns.channel)]
    picked = [here & (patterns.degree <= cut) for here in of_channel for cut in COARSE]
    picked += [*of_channel, patterns.degree <= COARSE[0], everything]
    groups = [
        (orthonormal_basis(columns[:, picks]), whitening.noise.pooled_degrees(patterns.channel[picks]))
        for picks in distinct(picked)
    ]
    return PatternSpace(patterns, columns, tuple(sorted(groups, key=lambda group: group[0].shape[1])))


def distinct(picked: Iterable[BoolArray]) -> list[BoolArray]:
    """Each choice of patterns once, without empty ones: a single channel is all of them."""
    return list({picks.tobytes(): picks for picks in picked if picks.any()}.values())


@dataclass(frozen=True)
class Where:
    """Where the model fails."""

    channel: str  # The measured channel with the largest misfit over its noise; empty where nothing fails
    covariates: tuple[str, ...]  # Columns along which the misfit changes, the strongest first
    sentence: str


def where_it_fails(observations: Observations, whitening: Whitening) -> Where:
    """Find the channel with the largest misfit over its noise, its covariates, and a sentence.

    Where mounts and noise could be what makes that channel the worst, it is the one with the most structure instead.

    The structure is the generalised least-squares fit of smooth patterns beside the scatter of mounts and runs. The
    covariates stand in the order in which they explain it; there are none where the misfit is the same everywhere.
    """
    patterns = smooth_patterns(observations)
    columns, residual = whitening.full(patterns.columns), whitening.full(observations.residual)
    smooth = structured_misfit(patterns, columns, residual)
    counts = np.array([max(int(observations.of(name).sum()), 1) for name in observations.channels])
    excess = np.array([_excess(columns[:, patterns.channel == c], residual) for c in range(len(counts))])
    clear = _clearly_worst(observations, whitening.noise)
    worst = first_best((excess / counts).tolist()) if clear is None else clear
    channel, covariates = observations.channels[worst], _covariates(columns, patterns, worst, residual, smooth)
    # What is said of the readings is what they show, whatever re-mounts may have made of it
    shown = structured_misfit(patterns, *map(whitening.serial, (patterns.columns, observations.residual)))
    return Where(channel, covariates, describe_misfit(observations, whitening.noise, channel, covariates, shown))


def _clearly_worst(observations: Observations, noise: NoiseModel) -> int | None:
    """The channel whose readings are farthest off, over their noise; None where noise and mounts may be why."""
    count = np.maximum(np.bincount(observations.channel, minlength=len(noise.sigma)), 1)
    off = observations.residual, observations.distance_slope * noise.mount_m
    square, mounts = (observations.mean_square(values) / noise.sigma**2 for values in off)
    worst = first_best(square.tolist())
    scatter = np.sqrt(2.0 * (1.0 + noise.rho[worst]) / (1.0 - noise.rho[worst]) / count[worst])
    return worst if square[worst] > 1.0 + mounts[worst] + BEYOND_NOISE * scatter else None


def structured_misfit(patterns: Patterns, columns: FloatArray, residual: FloatArray) -> FloatArray:
    """The smooth part, in the readings' units, of recorded minus predicted; columns and residual are whitened."""
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    amplitude = np.linalg.lstsq(columns / size, residual, rcond=1e-8)[0] / size
    return np.asarray(patterns.columns @ amplitude)


def _covariates(
    columns: FloatArray, patterns: Patterns, channel: int, residual: FloatArray, smooth: FloatArray
) -> tuple[str, ...]:
    """Covariates in the order in which each adds most to what the ones before explain with their products.

    The gain of a covariate is the geometric mean of two shares: of the structure, and of its excess over noise, mounts
    and runs. The first alone follows the noise, the second alone is blind to what re-mounts look like as well.
    """
    of_channel = np.flatnonzero(patterns.channel == channel)
    rows = np.any(patterns.columns[:, of_channel] != 0.0, axis=1)
    names = sorted(set().union(*(patterns.along[k] for k in of_channel)))
    chosen: list[str] = []

    def explained(among: list[str]) -> FloatArray:
        inside = [k for k in of_channel if patterns.along[k] <= frozenset(among)]
        projection = orthonormal_basis(patterns.columns[np.ix_(rows, inside)]).T @ smooth[rows]
        return np.array([projection @ projection, max(_excess(columns[:, inside], residual), 0.0)])

    total, reached = np.maximum(explained(names), 1e-300), explained([])
    while remaining := [name for name in names if name not in chosen]:
        gains = [np.maximum(explained([*chosen, name]) - reached, 0.0) / total for name in remaining]
        shares = np.sqrt(np.prod(gains, axis=1)).tolist()
        best = first_best(shares)
        if shares[best] < COVARIATE_SHARE:
            break
        chosen.append(remaining[best])
        reached = explained(chosen)
    # Both clocks mean the same to a reader
    return tuple(dict.fromkeys("order" if name == "elapsed" else name for name in chosen))


def _excess(columns: FloatArray, residual: FloatArray) -> float:
    """Squared length of the whitened residual along whitened columns, less what noise gives."""
    basis = orthonormal_basis(columns)
    along = basis.T @ residual
    return float(along @ along - basis.shape[1])


_FURTHER = ("branch", *TEMPERATURES, "order")
"""Covariates that are said beside the settings of the largest misfit where it changes with them."""


def most_of_noise(observations: Observations, noise: NoiseModel) -> FloatArray:
    """The largest rms per channel that is still noise: 1.2 times it, of few readings as much as chance makes of it.

    Noise is what was declared, or repeats show: of the readings, of settings, and of mounts and runs as far as the
    readings show these. What is assumed of them does not count.
    """
    columns = random_columns(observations, 0.0 if noise.mount_assumed else noise.mount_m, noise.run)
    settings = sum((size**2 for _, size in setting_errors(observations, noise.stop_m)), np.zeros(len(columns)))
    beside = observations.mean_square(np.sqrt(settings + np.sum(columns**2, axis=1)))
    readings = np.maximum(np.bincount(observations.channel, minlength=len(noise.sigma)), 1)
    by_chance = np.maximum(WITHIN_NOISE, np.sqrt(stats.chi2.isf(LEVEL, readings) / readings))
    return np.asarray(by_chance * np.sqrt(noise.sigma**2 + beside))


def describe_misfit(
    observations: Observations, noise: NoiseModel, channel: str, covariates: Sequence[str], smooth: FloatArray
) -> str:
    """One sentence on a misfit: ``Measured force is up to 12 mN low, most at 16 mm and 1.4 A``.

    A shift of all readings, or a share of the prediction, whichever leaves less of the misfit, is the same everywhere
    where it leaves no more than noise, and so on average where it leaves next to nothing. Otherwise the smooth part of
    recorded minus predicted, of shape (M,), says where it is the largest, and how large.
    """
    of_channel = observations.of(channel)
    # A relative misfit refers to the prediction, of a Hall output without its quiescent voltage
    quiescent = observations.nominal.hall_quiescent_V if channel == "hall_V" else 0.0
    misfit, base = observations.residual[of_channel], (observations.base - quiescent)[of_channel]
    share, shift, square = _share(misfit, base), float(misfit.mean()), float(misfit @ misfit)
    if square <= ROUNDED**2 * float(base @ base):
        return sentence("where", "nothing", channel)
    beside_shift, beside_share = (float(np.sum((misfit - made) ** 2)) for made in (shift, share * base))
    most = float(most_of_noise(observations, noise)[observations.channels.index(channel)])
    same = channel in noise.source and min(beside_shift, beside_share) <= len(misfit) * most**2
    structured = smooth[of_channel] if smooth[of_channel].any() else misfit
    worst = int(np.argmax(np.abs(structured)))
    facts: dict[str, Any] = {"size": float(structured[worst]), "share": None, "place": None}
    many = len(misfit) >= LEAST_READINGS  # fewer do not say what it is elsewhere
    level = same and not covariates and 2.0 * shift**2 > np.mean(structured**2)
    nearly = min(beside_shift, beside_share) < LEFT_BY_SHARE * square
    if many and beside_share < beside_shift and nearly and _is_share(misfit, base):
        facts["share"] = share
    elif many and beside_shift <= beside_share and (level or nearly):
        facts["size"] = shift
    else:
        names = [name for name in observations.settings if observations.column(name).any()]  # no current is no place
        names += [name for name in _FURTHER if name in covariates]
        facts["place"] = [(*parts_of(name), float(observations.column(name)[of_channel][worst])) for name in names]
    magnitude = observations.magnitude.get(channel)
    return sentence("where", "misfit", facts | {"channel": channel, "magnitude": magnitude, "same": same})


def _share(misfit: FloatArray, base: FloatArray) -> float:
    """The share of a prediction that leaves least of a misfit."""
    return float(misfit @ base) / max(float(base @ base), 1e-300)


def _is_share(misfit: FloatArray, base: FloatArray) -> bool:
    """Whether a misfit is about the same share of the prediction in small readings as in all."""
    small, share = np.abs(base) <= np.median(np.abs(base)), _share(misfit, base)
    return abs(_share(misfit[small], base[small]) - share) < SAME_SHARE * abs(share)
