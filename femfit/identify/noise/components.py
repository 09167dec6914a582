"""Estimates the noise of a campaign: its readings', its runs' and its mounts'; docs/explanation/noise.md has the model.

The scatter of a reading comes from repeats of one setting, from what was declared, and from what smooth patterns of the
settings leave: one restricted likelihood of all. Nothing here looks at an effect, and a hidden one does not widen the
noise as far as it is smooth or the same in every repeat. Simulated campaigns draw their noise from the same model.

References
----------
F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110: degrees of freedom of an estimated variance.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from operator import itemgetter

import numpy as np
import pandas as pd
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.effects.effect import AddedEffect
from femfit.identify.constants import (
    CONTRADICTED,
    LEAST_READINGS,
    LEAST_REPEATS,
    LEAST_REPEATS_AGAINST_DECLARED,
    PRIOR_MOUNT_M,
    PRIOR_RUN,
    PRIOR_WEIGHT,
)
from femfit.identify.noise.design import EXACT, ChannelDesign, channel_design
from femfit.identify.noise.likelihood import Likelihood
from femfit.identify.noise.whitening import MOST_STOPS, NoiseModel, Whitening, random_effects, stops
from femfit.identify.observations import VOLTAGE_BALANCE, Observations
from femfit.identify.settings import setting_cells
from femfit.identify.words import finding
from femfit.tables.measurement import OF_RUNS

ROUNDS = 2
"""Numerical: rounds in which correlations are sought by the variances, and these by the correlations."""

FIXED = 1e3
"""Numerical: size of a random effect, over its usual one, or over a reading's, that is as good as fixed."""

MOST_MOUNTS = 48
"""Numerical, for the time that it takes: of more mounts, or runs, so many say the noise of all (to 10 %)."""

UNKNOWN_CHANNEL = 1e6
"""Numerical: a channel of unknown noise gets this many times its largest reading, so that it has no weight."""

FINEST = 1e-7
"""Numerical: noise of a channel over its largest reading below which products of columns lose it in their rounding."""

SAME_READING = 1e-12
"""Numerical: some thousand roundings of a float, over the largest reading."""

GUESS = "guess"
"""Source of a noise that smooth patterns of the settings leave, where neither repeats nor a declaration tell it."""


def estimate_noise(observations: Observations) -> NoiseModel | None:
    """The noise model of a campaign.

    None where neither repeats nor a declaration say the noise of any channel, and it cannot be guessed either.
    """
    mount = observations.column("mount")
    if MOST_MOUNTS < len(mounts := np.unique(mount)) <= MOST_STOPS:
        some = mounts[np.linspace(0, len(mounts) - 1, MOST_MOUNTS).astype(int)]
        observations = observations.select(np.isin(mount, some))
    names, constant = observations.channels, never_varying(observations)
    every = {c: design for c, name in enumerate(names) if (design := _known(observations, c, name in constant))}
    designs = {c: design for c, design in every.items() if design.source != GUESS}
    if not designs and len(every) + len(constant) == len(names):  # a guess is one of all channels
        designs = every
    if not designs:
        return None
    effects, scales = random_effects(observations), _scales(observations, designs)
    # An offset of a run looks like readings that follow each other: it is begun with small ones and with large ones
    ends = [_settled(observations, designs, scales, factor) for factor in (1.0, FIXED)]
    _, designs, likelihood, x = min(ends, key=itemgetter(0))
    # Only those have a variance that several mounts or runs, in a channel of known noise, have
    moved = any(observations.distance_slope[observations.channel == c].any() for c in designs)
    judged = [moved, *(c in designs for c in range(len(names))), moved]
    used = (effects.differences > 0.0) & judged
    means = np.sqrt([likelihood.mean_variance(x, k) if used[k] else 0.0 for k in range(len(used))])
    sizes = np.where(used, np.exp(0.5 * x[: len(used)]), 0.0)
    largest = [float(np.abs(observations.value[observations.channel == c]).max(initial=0.0)) for c in range(len(names))]
    sigma = UNKNOWN_CHANNEL * np.array([value or 1.0 for value in largest])
    rho, repeats, degrees = *np.zeros((2, len(names))), np.full(len(names), 1.0 / EXACT)  # of none where unknown
    for (c, design), of_reading in zip(designs.items(), np.exp(0.5 * x[len(used) :]), strict=True):
        sigma[c] = max(of_reading, design.resolution)
        rho[c] = design.mean_correlation(effects.deviations(sizes) / of_reading)
        repeats[c], degrees[c] = design.repeats, design.degrees_of_freedom
    return NoiseModel(
        channels=names,
        sigma=sigma,
        rho=rho,
        mount_m=float(means[0]),
        run=means[1:-1],
        repeats=repeats,
        degrees_of_freedom=degrees,
        source={names[c]: design.source for c, design in designs.items()},
        stop_m=float(means[-1]) or observations.declared_noise.get("distance_m", 0.0),
        mount_assumed="distance_m" not in observations.declared_noise and bool(2.0 * sizes[0] < means[0]),
        never_varying=tuple(constant),
    )


def _settled(
    observations: Observations, designs: Mapping[int, ChannelDesign], scales: FloatArray, factor: float
) -> tuple[float, dict[int, ChannelDesign], Likelihood, FloatArray]:
    """Correlations by the variances, and these by the correlations, from some scales: what is the likeliest together.

    The cost of all, -2 log of likelihood and prior, then the correlations, and the likelihood with its log variances.
    """
    effects, near = random_effects(observations), list[FloatArray]()
    x = np.log([*(factor * scales) ** 2, *(design.variance for design in designs.values())])
    for _ in range(ROUNDS):
        deviations, sigma = effects.deviations(np.exp(0.5 * x[: len(scales)])), np.exp(0.5 * x[len(scales) :])
        places = zip(designs.items(), sigma, strict=True)
        likeliest = {c: design.likeliest(deviations / of_reading) for (c, design), of_reading in places}
        likelihood = _likelihood(observations, list(likeliest.values()), scales)
        x = likelihood.maximum(*near)
        near = [x]
    cost = likelihood.cost(x) + sum(design.cost(design.place) for design in likeliest.values())
    return cost, likeliest, likelihood, x


def _scales(observations: Observations, designs: Mapping[int, ChannelDesign]) -> FloatArray:
    """What mounts, runs of each channel and stops are assumed to scatter by, or were declared to: standard deviations.

    A stop is assumed to make, in the channel which shows it most, what runs are assumed to differ by; but to be off by
    no more than a body that is put back, however little the channels change with the distance.
    """
    names, declared = observations.channels, observations.declared_noise
    slope = np.sqrt(observations.mean_square(observations.distance_slope))
    sigma = {c: np.sqrt(design.variance) for c, design in designs.items()}
    runs = [declared.get(OF_RUNS + name) or PRIOR_RUN * sigma.get(c, 1.0) for c, name in enumerate(names)]
    shown = max(float(slope[c] / sd) for c, sd in sigma.items())
    stop = min(PRIOR_RUN / shown, PRIOR_MOUNT_M) if shown else PRIOR_MOUNT_M
    distance_m = declared.get("distance_m")
    return np.array([distance_m or PRIOR_MOUNT_M, *runs, distance_m or stop])


def _likelihood(observations: Observations, designs: Sequence[ChannelDesign], scales: FloatArray) -> Likelihood:
    """The likelihood of all variances: of mounts, runs of each channel and stops, then of the designs' readings."""
    effects, declared = random_effects(observations), observations.declared_noise
    of_distance = PRIOR_WEIGHT * ("distance_m" in declared)
    of_runs = [EXACT * (OF_RUNS + name in declared) for name in observations.channels]
    weight = np.array([of_distance, *of_runs, of_distance, *(design.counts_like for design in designs)])
    variances = [design.declared**2 if design.counts_like else design.variance for design in designs]
    return Likelihood(
        [design.contrasts(*design.place) for design in designs],
        effects.group,
        effects.second,
        scale=np.append(scales**2, variances),
        weight=weight,
        from_zero=(weight == 0.0) & (np.arange(len(weight)) < len(scales)),
    )


def _known(observations: Observations, c: int, constant: bool) -> ChannelDesign | None:
    """What repeats, a declaration and smooth patterns say of a channel's readings; None where nothing does."""
    declared, source = observations.declared_noise.get(observations.channels[c], np.nan), observations.noise_source
    values = observations.value[observations.channel == c]
    if not len(values):  # none in the mounts that say the noise
        return None
    design, counts_like = (
        channel_design(observations, c),
        EXACT if source == "samples" else LEAST_REPEATS_AGAINST_DECLARED,
    )
    least = max(design.resolution, FINEST * float(np.abs(values).max()))
    if constant and not np.isfinite(declared):  # coarser than its noise: rounding is left
        declared, source, counts_like = design.resolution or np.nan, "resolution", EXACT
    if not np.isfinite(declared):
        return None if constant else _undeclared(design, least)
    declared, repeats = max(declared, least), 0 if constant else design.repeats
    design = replace(design, sigma=declared, cache={})
    as_declared = replace(design, declared=declared, counts_like=EXACT, source=source, repeats=0)  # which nothing moves
    if not repeats or design.contrasts(0, 0).free < LEAST_REPEATS:  # mounts may have all that repeats differ by
        return as_declared
    alone = replace(design, source="repeats")
    shown = alone.likeliest(FIXED / np.maximum(np.linalg.norm(design.random, axis=0), 1e-300)).variance
    ratio = shown / declared**2
    if 2.0 * min(stats.f.sf(ratio, repeats, counts_like), stats.f.cdf(ratio, repeats, counts_like)) < CONTRADICTED:
        return alone
    if counts_like == EXACT:
        return as_declared
    return replace(as_declared, counts_like=counts_like, source=f"{source} and repeats", repeats=repeats)


def _undeclared(design: ChannelDesign, least: float) -> ChannelDesign | None:
    """What repeats and smooth patterns say of a channel's readings; None where they are too few or never differ."""
    free = design.contrasts(0, 0).free
    if free < LEAST_REPEATS:
        return None
    if design.made.any():
        # Without what the declared errors of the settings make; but not less is left than the standard error of a
        # variance from so many readings: below it nothing can be told apart
        variance = max(design.variance - float(design.made.mean()), design.variance * np.sqrt(2.0 / free), least**2)
        design = replace(design, sigma=float(np.sqrt(variance)), cache={})
    varies = design.contrasts(0, 0).square > SAME_READING * float(np.sum(design.residual**2))
    return replace(design, source="repeats" if design.repeats else GUESS) if varies else None


def as_readings_show(observations: Observations) -> Observations:
    """Readings without those declared errors of settings by which a channel would scatter more than it does.

    An error of each row is in the scatter about any smooth pattern; one of each stop of the stage in the misfit itself.
    """
    columns, declared = observations.setting_columns.copy(), dict(observations.declared_noise)
    findings = list[Finding]()
    of_stops = random_effects(observations).differences[-1] > 0.0
    missed, count = observations.mean_square(observations.residual), len(np.unique(stops(observations)))
    for (k, name), (c, channel) in product(enumerate(observations.settings), enumerate(observations.channels)):
        here = observations.channel == c
        made = float(np.mean(columns[here, k] ** 2)) if k < columns.shape[1] and here.any() else 0.0
        if not made or name not in declared:
            continue
        design = channel_design(observations, c)
        variance, free = design.variance, design.contrasts(0, 0).free
        if of_stops and not k:
            variance, free = float(missed[c]), float(count)
        if free >= LEAST_READINGS and stats.f.cdf(variance / made, free, PRIOR_WEIGHT) < CONTRADICTED:
            columns[:, k], error = 0.0, declared.pop(name)
            most = error * float(np.sqrt(variance / made))
            findings.append(finding("declared-setting", name, name=name, declared=error, channel=channel, most=most))
    if not findings:
        return observations
    every = (*observations.findings, *findings)
    return replace(observations, setting_columns=columns, declared_noise=declared, findings=every)


def beside_effects(whitening: Whitening, effects: Sequence[AddedEffect]) -> Whitening:
    """The map with the noise of what effects leave: a misfit that is taken away is no scatter of mounts and runs."""
    observations = whitening.observations
    explained = observations.predict(effects) - observations.base
    noise = estimate_noise(observations.with_values(observations.value - explained))
    return replace(whitening, noise=noise or whitening.noise)


def noise_by_smoothness(observations: Observations) -> NoiseModel:
    """What smooth patterns leave, in place of an unknown noise: enough to weigh the channels by."""
    zeros, channels = np.zeros(len(observations.channels)), range(len(observations.channels))
    sigma = np.array([max(float(np.sqrt(channel_design(observations, c).variance)), 1e-12) for c in channels])
    return NoiseModel(observations.channels, sigma, zeros, 0.0, zeros, zeros, zeros, {})


def never_varying(observations: Observations) -> list[str]:
    """Channels whose readings are the same, but for the rounding of a float, wherever a setting was repeated."""
    readings = pd.DataFrame({"channel": observations.channel, "value": observations.value})
    by_cell = readings.groupby([readings["channel"], setting_cells(observations)])["value"]
    spread, largest = (
        (by_cell.max() - by_cell.min()).groupby("channel"),
        readings["value"].abs().groupby(readings["channel"]),
    )
    constant = (spread.max() <= SAME_READING * largest.max()) & (largest.size() - spread.size() >= LEAST_REPEATS)
    return [name for c, name in enumerate(observations.channels) if constant.get(c, False)]


def dead_sensors(constant: Iterable[str]) -> Iterator[Finding]:
    """Of channels that never vary, sensors; a command repeats itself."""
    return (finding("never-varies", name, name=name) for name in constant if not name.startswith(VOLTAGE_BALANCE))
