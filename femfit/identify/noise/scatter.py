"""What repeats of one setting and a declaration, or else the smoothness of the misfit, say of a channel's scatter.

A guess of the noise where nothing tells it: what neighbouring settings leave beside a straight line.

A model's misfit is smooth over distance and current. Of three neighbours on a line the middle one, less the straight
line through the others, holds noise and little else: e = a y_before + b y_after - y has the variance
(a^2 + b^2 + 1) sigma^2. Noise that lasts from reading to reading hides from neighbours that were read one after the
other, and seldom from those along the other setting, so that the larger of both guesses counts.

Whether an error is within the noise, the one answer for everything that is printed.

References
----------
T. Gasser, L. Sroka and C. Jennen-Steinmetz, Biometrika 73 (1986) 625: pseudo-residuals.
P. J. Rousseeuw and C. Croux, J. American Statistical Association 88 (1993) 1273: median absolute deviation, 37 %.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.identify.comparison.patterns import smooth_patterns
from femfit.identify.constants import (
    CONTRADICTED,
    EXACT,
    GUESS_WIDER,
    INDEPENDENT_DIFFERENCES,
    LEAST_NEIGHBOURS,
    LEAST_REPEATS,
    LEAST_REPEATS_AGAINST_DECLARED,
    LEVEL,
    NORMAL_MEDIAN,
    SAME_LINE,
    SAME_READING,
    WITHIN_NOISE,
)
from femfit.identify.noise.contrasts import ChannelDesign
from femfit.identify.noise.designs import channel_design, random_effects, repeated_readings, uncertain_settings
from femfit.identify.noise.whitening import NoiseModel, orthonormal_basis, random_columns, setting_errors
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.settings import levels, quantisation_step
from femfit.tables.measurement import CHANNEL_WORDS


def guessed_noise(observations: Observations, channel: str) -> tuple[float, float]:
    """A standard deviation of one reading, on the wide side, and its degrees of freedom; 0 where there is no guess."""
    here = observations.of(channel)
    residual = observations.residual[here]
    at = {name: observations.setting(name)[here] for name in observations.settings}
    beside = (observations.column("run")[here], observations.column("branch")[here])
    guesses = []
    for along, values in at.items():
        lines = np.stack([*beside, *(levels(at[fixed], SAME_LINE) for fixed in at if fixed != along)])
        differences = _pseudo_residuals(residual, values, lines)
        if len(differences) >= LEAST_NEIGHBOURS:
            sigma = float(np.median(np.abs(differences))) / NORMAL_MEDIAN
            guesses.append((GUESS_WIDER * sigma, INDEPENDENT_DIFFERENCES * len(differences)))
    return max(guesses, default=(0.0, 0.0))


def _pseudo_residuals(y: FloatArray, x: FloatArray, lines: FloatArray) -> FloatArray:
    """Middle readings less the line through their neighbours, each with the variance of one reading."""
    _, line = np.unique(lines, axis=1, return_inverse=True)
    frame = pd.DataFrame({"line": line.ravel(), "x": x, "y": y}).groupby(["line", "x"], as_index=False).first()
    number, at, value = (frame[name].to_numpy() for name in ("line", "x", "y"))
    inside = np.flatnonzero(number[:-2] == number[2:]) if len(number) > 2 else np.zeros(0, dtype=np.intp)
    before, middle, after = inside, inside + 1, inside + 2
    weight = (at[after] - at[middle]) / (at[after] - at[before])
    left = weight * value[before] + (1.0 - weight) * value[after] - value[middle]
    return np.asarray(left / np.sqrt(weight**2 + (1.0 - weight) ** 2 + 1.0))


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


def beyond_noise(observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float]) -> dict[str, float]:
    """Channels whose rms error is more than their noise, and how many times the noise of one reading it is.

    Within the noise is what is at most 1.2 times what the declared noise, or repeats, show: of the readings, of
    settings, and of mounts and runs as far as the readings show these. What is assumed of them does not count, nor a
    guess of the noise. Few readings may have more: what chance makes of so many, at the level of the tests. A channel
    of unknown noise is in no list.
    """
    if noise is None:
        return {}
    shown, number = noise_shown(observations, noise), {name: c for c, name in enumerate(noise.channels)}
    return {
        name: error / float(noise.sigma[number[name]])
        for name, error in rms.items()
        if name in noise.source and error > _most(int(np.sum(observations.of(name)))) * shown[number[name]]
    }


def _most(readings: int) -> float:
    """Rms error over the noise up to which so many readings are within it: few are far from 1 by chance."""
    return max(WITHIN_NOISE, float(np.sqrt(stats.chi2.isf(LEVEL, readings) / readings)))


def noise_shown(observations: Observations, noise: NoiseModel) -> FloatArray:
    """Rms error that the noise makes in each channel, by what was declared and what the readings show of it."""
    count = np.maximum(np.bincount(observations.channel, minlength=len(noise.sigma)), 1)
    columns, deviations = random_columns(observations, 0.0 if noise.mount_assumed else noise.mount_m, noise.run)
    settings = sum((size**2 for _, size in setting_errors(observations, noise.stop_m)), np.zeros(len(columns)))
    beside = np.bincount(observations.channel, settings + columns**2 @ deviations**2, len(noise.sigma)) / count
    return np.asarray(np.sqrt(noise.sigma**2 + beside))


def not_judged(observations: Observations, noise: NoiseModel | None) -> list[str]:
    """A sentence on the channels whose noise is unknown, beside others; none where there are none."""
    unknown = [CHANNEL_WORDS[name] for name in observations.channels if noise and name not in noise.source]
    if not unknown:
        return []
    return [
        f"Not judged: the {' and the '.join(unknown)}, whose noise nothing says. Measure settings twice, or declare it."
    ]


def if_mounts_are_assumed(
    observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float], left: Mapping[str, str]
) -> str:
    """What a "nothing is missing" rests on where re-mounts make the errors that are given in words as ``left``.

    Empty where they would not make them, and where the readings or a declaration say how large re-mounts are.
    """
    if noise is None or not left or not noise.mount_assumed:
        return ""
    with_mounts = noise_shown(observations, replace(noise, mount_assumed=False, mount_m=noise.test_mount_m))
    if any(rms[name] > with_mounts[noise.channels.index(name)] for name in left):
        return ""
    return (
        f"if each time that it is put back the body may stand {amount(noise.test_mount_m, 'mount_m')} elsewhere. That "
        f"is assumed, and would explain all that the model misses: {' and '.join(left.values())}. To know, declare "
        "distance_mm, or put the body back more often."
    )


def in_words(observations: Observations, beyond: Mapping[str, float], rms: Mapping[str, float]) -> dict[str, str]:
    """Each such channel as it is said of a model: what it misses, and by how much."""
    return {
        name: f"the {CHANNEL_WORDS[name]} by {observations.amount(rms[name], name, 3)} rms, "
        f"{times:.3g} times the noise of one reading"
        for name, times in beyond.items()
    }


def allowed_for(observations: Observations, noise: NoiseModel | None) -> str:
    """What the test allows for beside the noise of a reading, and where that comes from; empty where that is nothing.

    Offsets of runs, and errors of stops, are said where they make more than the noise of one reading.
    """
    if noise is None:
        return ""
    made = np.abs(noise.stop_m * observations.distance_slope) > noise.sigma[observations.channel]
    at_stops = [f"the {amount(noise.stop_m, 'mount_m')} by which the distance is off at each stop (estimated)"]
    place = "mount to mount" if "mount" in observations.given else "run to run"
    source = "assumed, since there are few" if noise.mount_assumed else "estimated"
    said = [f"the {amount(noise.test_mount_m, 'mount_m')} by which the distance may differ from {place} ({source})"]
    if noise.test_mount_m >= np.ptp(observations.column("distance_m")):
        said = [f"any error of the distance that differs from {place} (too few of them say how large it is)"]
    return " and ".join(
        said[: noise.mount_m > 0.0]
        + at_stops[: bool(made.any())]
        + [
            f"the {amount(offset, name)} by which every reading of the {CHANNEL_WORDS[name]} differs from run to run "
            f"({'declared' if name in observations.declared_run else f'estimated; declare run.{name} if it is less'})"
            for name, offset, sigma in zip(noise.channels, noise.run, noise.sigma, strict=True)
            if offset > sigma
        ]
    )
