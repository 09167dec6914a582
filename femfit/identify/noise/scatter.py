"""What repeats of one setting and a declaration, or else the smoothness of the misfit, say of a channel's scatter.

Which readings of a campaign hold its noise alone, and what else differs between them, is worked out first. Where
nothing tells the noise, it is guessed from what neighbouring settings leave beside a straight line: a model's misfit is
smooth over distance and current. Of three neighbours on a line the middle one, less the straight line through the
others, holds noise and little else: e = a y_before + b y_after - y has the variance (a^2 + b^2 + 1) sigma^2. Noise that
lasts from reading to reading hides from neighbours that were read one after the other, and seldom from those along the
other setting, so that the larger of both guesses counts.

References
----------
T. Gasser, L. Sroka and C. Jennen-Steinmetz, Biometrika 73 (1986) 625: pseudo-residuals.
P. J. Rousseeuw and C. Croux, J. American Statistical Association 88 (1993) 1273: median absolute deviation, 37 %.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from femfit.core.numerics import FloatArray, IntArray
from femfit.estimate.constants import NORMAL_MEDIAN
from femfit.identify.constants import (
    CONTRADICTED,
    EXACT,
    GUESS_WIDER,
    INDEPENDENT_DIFFERENCES,
    LEAST_REPEATS,
    LEAST_REPEATS_AGAINST_DECLARED,
    SAME_LINE,
    SAME_READING,
)
from femfit.identify.noise.contrasts import ChannelDesign
from femfit.identify.noise.whitening import (
    NoiseModel,
    chain_of,
    orthonormal_basis,
    random_effects,
)
from femfit.identify.observations import Observations, once_for_settings
from femfit.identify.patterns import drift_patterns, smooth_patterns
from femfit.identify.settings import levels, quantisation_step, setting_cells


@once_for_settings
def repeated_readings(observations: Observations) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Of each channel the readings of settings that were repeated, cell by cell, where each cell starts, and all cells.

    The last are the numbers, from 0, of each reading's cell.
    """
    cells, result = setting_cells(observations), []
    for c in range(len(observations.channels)):
        here = np.flatnonzero(observations.channel == c)
        _, code, count = np.unique(cells[here], return_inverse=True, return_counts=True)
        repeated = here[count[code] > 1]
        sorting = repeated[np.argsort(cells[repeated], kind="stable")]
        _, start, cell = np.unique(cells[sorting], return_index=True, return_inverse=True)
        result.append((sorting, start, cell))
    return result


def channel_design(
    observations: Observations, c: int, repeats: bool, sigma: float = 0.0, stops_known: bool = False
) -> ChannelDesign:
    """The design of a channel; sigma weighs what uncertain settings make against it where it is not 0.

    Errors of stops have columns where enough of the repeats is left beside them; else they are known, and weighed as
    those of single rows are.
    """
    stops_known = stops_known or not repeats
    here = np.flatnonzero(observations.channel == c)
    cell, cells = np.zeros(len(here), dtype=np.intp), 0
    if repeats:
        here, start, cell = repeated_readings(observations)[c]
        cells = len(start)
    effects = random_effects(observations)
    made = np.sum(uncertain_settings(observations, stops_known)[here] ** 2, axis=1)
    weight = 1.0 / np.sqrt(1.0 + made / sigma**2) if sigma else np.ones(len(here))
    patterns = (drift_patterns if repeats else smooth_patterns)(observations)
    # A distance error of all mounts is in no difference between them; nor is a hidden effect that looks like it
    common = np.stack([observations.distance_slope[here], observations.distance_curvature[here]], axis=1)
    fixed = np.concatenate([patterns.columns[np.ix_(here, np.flatnonzero(patterns.channel == c))], common], axis=1)
    if repeats:
        fixed = _within(fixed, cell)
    random = effects.columns[here] * ((effects.differences > 0.0)[effects.group] & ~(effects.of_stops & stops_known))
    basis, residual = orthonormal_basis(fixed), observations.residual[here]
    design = ChannelDesign(here, cell, cells, basis, random, chain_of(observations, here), weight, residual)
    if stops_known or design.free >= LEAST_REPEATS:
        return design
    return channel_design(observations, c, repeats, sigma, stops_known=True)


def uncertain_settings(observations: Observations, stops_known: bool) -> FloatArray:
    """Errors of settings that are weighed as if each row had its own: without those of stops that have columns."""
    has_columns = random_effects(observations).differences[-1] > 0.0 and not stops_known
    return observations.setting_columns[:, int(has_columns) :]


def _within(columns: FloatArray, cell: IntArray) -> FloatArray:
    """Columns less their mean in each cell; zero where rounding alone is left."""
    deviation = columns - pd.DataFrame(columns).groupby(cell).transform("mean").to_numpy()
    varies = np.linalg.norm(deviation, axis=0) > 1e-9 * np.linalg.norm(columns, axis=0)
    return np.asarray(deviation * varies)


def guessed_noise(observations: Observations, channel: str) -> tuple[float, float]:
    """A standard deviation of one reading, on the wide side, and its degrees of freedom; 0 where there is no guess."""
    here = observations.of(channel)
    residual = observations.residual[here]
    settings = {name: observations.setting(name)[here] for name in observations.settings}
    beside = (observations.column("run")[here], observations.column("branch")[here])
    guesses = []
    for along, values in settings.items():
        lines = np.stack([*beside, *(levels(settings[fixed], SAME_LINE) for fixed in settings if fixed != along)])
        differences = _pseudo_residuals(residual, values, lines)
        if len(differences) >= LEAST_REPEATS:
            sigma = float(np.median(np.abs(differences))) / NORMAL_MEDIAN
            guesses.append((GUESS_WIDER * sigma, INDEPENDENT_DIFFERENCES * len(differences)))
    return max(guesses, default=(0.0, 0.0))


def _pseudo_residuals(y: FloatArray, x: FloatArray, lines: FloatArray) -> FloatArray:
    """Middle readings less the line through their neighbours, each with the variance of one reading."""
    _, line = np.unique(lines, axis=1, return_inverse=True)
    frame = pd.DataFrame({"line": line.ravel(), "x": x, "y": y}).groupby(["line", "x"], as_index=False).first()
    number, place, value = (frame[name].to_numpy() for name in ("line", "x", "y"))
    inside = np.flatnonzero(number[:-2] == number[2:]) if len(number) > 2 else np.zeros(0, dtype=np.intp)
    before, middle, after = inside, inside + 1, inside + 2
    weight = (place[after] - place[middle]) / (place[after] - place[before])
    difference = weight * value[before] + (1.0 - weight) * value[after] - value[middle]
    return np.asarray(difference / np.sqrt(weight**2 + (1.0 - weight) ** 2 + 1.0))


@dataclass(frozen=True, eq=False)
class Scatter:
    """What is known of the standard deviation of one reading of a channel."""

    prior: float  # As declared or guessed; NaN where neither
    weight: float  # So many readings it counts like
    source: str
    repeats: float = 0.0  # Degrees of freedom of the repeats that count
    design: ChannelDesign | None = None


def known_scatter(observations: Observations, c: int, constant: bool) -> Scatter:
    """What repeats and a declaration say of a channel's noise."""
    declared, source = observations.declared_noise.get(observations.channels[c], np.nan), observations.noise_source
    weight = EXACT if source == "samples" else LEAST_REPEATS_AGAINST_DECLARED
    least = quantisation_step(observations.value[observations.channel == c]) / np.sqrt(12.0)
    design = None if constant else _design_of_repeats(observations, c)
    if design is None:
        if constant and not np.isfinite(declared) and least > 0.0:  # coarser than its noise: rounding is left
            declared, source = least, "resolution"
        if not np.isfinite(declared):
            return Scatter(np.nan, 0.0, "")
        prior = max(declared, least)
        return Scatter(prior, weight, source, design=channel_design(observations, c, repeats=False, sigma=prior))
    free, variance = design.free, design.contrasts(0).square / design.free
    if np.isfinite(declared):
        weighed = channel_design(observations, c, repeats=True, sigma=declared)
        shown = weighed.contrasts(0).square / free
        if not contradicts(shown / declared**2, free, weight):
            both = source if weight == EXACT else f"{source} and repeats"
            return Scatter(declared, weight, both, 0.0 if weight == EXACT else float(free), weighed)
    # Without what the declared errors of the settings make of it; but not less is left than the standard error of a
    # variance from so many repeats: below it nothing can be told apart
    stops_known = not design.random[:, random_effects(observations).of_stops].any()
    made = float(np.mean(np.sum(uncertain_settings(observations, stops_known)[design.here] ** 2, axis=1)))
    sigma = max(float(np.sqrt(max(variance - made, variance * np.sqrt(2.0 / free)))), least)
    return Scatter(sigma, 0.0, "repeats", float(free), channel_design(observations, c, repeats=True, sigma=sigma))


def _design_of_repeats(observations: Observations, c: int) -> ChannelDesign | None:
    """The repeats of a channel beside mounts, runs, temperatures and times; None where too few, or all the same."""
    sorting, start, _ = repeated_readings(observations)[c]
    if len(sorting) - len(start) < LEAST_REPEATS:
        return None
    design = channel_design(observations, c, repeats=True)
    largest = float(np.sum(observations.value[design.here] ** 2))
    shown = design.free >= LEAST_REPEATS and design.contrasts(0).square > SAME_READING**2 * largest
    return design if shown else None


def guessed_scatter(observations: Observations, c: int) -> Scatter:
    """The noise of a channel from the smoothness of its misfit, where nothing says that of any channel."""
    guess, free = guessed_noise(observations, observations.channels[c])
    if guess <= SAME_READING * float(np.abs(observations.value[observations.channel == c]).max()):
        return Scatter(np.nan, 0.0, "")
    return Scatter(guess, free, "guess", design=channel_design(observations, c, repeats=False, sigma=guess))


def contradicts(ratio: float, free: float, weight: float) -> bool:
    """Whether a variance with so many degrees of freedom is no estimate of one that counts like ``weight`` readings."""
    return 2.0 * min(stats.f.sf(ratio, free, weight), stats.f.cdf(ratio, free, weight)) < CONTRADICTED


def beside_patterns(observations: Observations, c: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Readings of a channel, what smooth patterns leave of their misfit, (n,), and the patterns' basis, (n, p)."""
    patterns, here = smooth_patterns(observations), np.flatnonzero(observations.channel == c)
    basis = orthonormal_basis(patterns.columns[np.ix_(here, np.flatnonzero(patterns.channel == c))])
    return here, observations.residual[here] - basis @ (basis.T @ observations.residual[here]), basis


def scatter_as_noise(observations: Observations) -> NoiseModel:
    """What smooth patterns leave, in place of an unknown noise: enough to weigh the channels by."""
    zeros, sigma = np.zeros(len(observations.channels)), np.ones(len(observations.channels))
    for c in range(len(sigma)):
        _, scatter, basis = beside_patterns(observations, c)
        sigma[c] = max(float(np.sqrt(scatter @ scatter / max(len(scatter) - basis.shape[1], 1))), 1e-12)
    return NoiseModel(observations.channels, sigma, zeros, 0.0, zeros, zeros, zeros, {}, 0.0, zeros)
