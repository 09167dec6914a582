"""What repeats of one setting and a declaration, or else the smoothness of the misfit, say of a channel's scatter."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from femfit.identify.comparison.patterns import smooth_patterns
from femfit.identify.constants import CONTRADICTED, EXACT, LEAST_REPEATS, LEAST_REPEATS_AGAINST_DECLARED, SAME_READING
from femfit.identify.noise.contrasts import ChannelDesign
from femfit.identify.noise.designs import channel_design, random_effects, repeated_readings, uncertain_settings
from femfit.identify.noise.smoothness import guessed_noise
from femfit.identify.noise.whitening import NoiseModel, orthonormal_basis
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.repeats import quantisation_step


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
    free = 0 if constant else _free_repeats(observations, c)
    if free < LEAST_REPEATS:
        if constant and not np.isfinite(declared) and least > 0.0:  # coarser than its noise: rounding is left
            declared, source = least, "resolution"
        if not np.isfinite(declared):
            return Scatter(np.nan, 0.0, "")
        prior = max(declared, least)
        return Scatter(prior, weight, source, design=channel_design(observations, c, repeats=False, sigma=prior))
    if np.isfinite(declared):
        design = channel_design(observations, c, repeats=True, sigma=declared)
        shown = design.contrasts(observations.residual[design.here], 0).square / free
        if not contradicts(shown / declared**2, free, weight):
            both = source if weight == EXACT else f"{source} and repeats"
            return Scatter(declared, weight, both, 0.0 if weight == EXACT else float(free), design)
    sigma = max(_pure_error(observations, c, free), least)
    return Scatter(sigma, 0.0, "repeats", float(free), channel_design(observations, c, repeats=True, sigma=sigma))


def _free_repeats(observations: Observations, c: int) -> int:
    """Degrees of freedom of repeats beside mounts, runs, temperatures and times; 0 where they are all the same."""
    sorting, start, _ = repeated_readings(observations)[c]
    if len(sorting) - len(start) < LEAST_REPEATS:
        return 0
    design = channel_design(observations, c, repeats=True)
    if design.free < LEAST_REPEATS:
        return 0
    square = design.contrasts(observations.residual[design.here], 0).square
    largest = float(np.sum(observations.value[design.here] ** 2))
    return design.free if square > SAME_READING**2 * largest else 0


def _pure_error(observations: Observations, c: int, free: int) -> float:
    """Standard deviation of repeats without what the declared errors of their settings make of it.

    Not less variance is left than the standard error of one from so many repeats: below it nothing can be told apart.
    """
    design = channel_design(observations, c, repeats=True)
    variance = design.contrasts(observations.residual[design.here], 0).square / free
    stops_known = not design.random[:, random_effects(observations).of_stops].any()
    made = float(np.mean(np.sum(uncertain_settings(observations, stops_known)[design.here] ** 2, axis=1)))
    return float(np.sqrt(max(variance - made, variance * np.sqrt(2.0 / free))))


def guessed_scatter(observations: Observations, c: int) -> Scatter:
    """The noise of a channel from the smoothness of its misfit, where nothing says that of any channel."""
    guess, free = guessed_noise(observations, observations.channels[c])
    if guess <= SAME_READING * float(np.abs(observations.value[observations.channel == c]).max()):
        return Scatter(np.nan, 0.0, "")
    return Scatter(guess, free, "guess", design=channel_design(observations, c, repeats=False, sigma=guess))


def contradicts(ratio: float, free: float, weight: float) -> bool:
    """Whether a variance with so many degrees of freedom is no estimate of one that counts like ``weight`` readings."""
    return 2.0 * min(stats.f.sf(ratio, free, weight), stats.f.cdf(ratio, free, weight)) < CONTRADICTED


def scatter_as_noise(observations: Observations) -> NoiseModel:
    """What smooth patterns leave, in place of an unknown noise: enough to weigh the channels by."""
    patterns, zeros = smooth_patterns(observations), np.zeros(len(observations.channels))
    sigma = np.ones(len(observations.channels))
    for c in range(len(sigma)):
        here, columns = observations.channel == c, patterns.columns[:, patterns.channel == c]
        basis = orthonormal_basis(columns[here])
        scatter = observations.residual[here] - basis @ (basis.T @ observations.residual[here])
        sigma[c] = max(float(np.sqrt(scatter @ scatter / max(len(scatter) - basis.shape[1], 1))), 1e-12)
    return NoiseModel(observations.channels, sigma, zeros, 0.0, zeros, zeros, zeros, {}, 0.0, zeros)
