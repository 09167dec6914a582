"""Estimates the noise of a campaign: its readings', its runs' and its mounts'; docs/explanation/noise.md has the model.

The scatter of a reading comes from repeats of one setting, from what was declared, and from what smooth patterns of the
settings leave: one restricted likelihood of all. Nothing here looks at an effect, and a hidden one does not widen the
noise as far as it is smooth or the same in every repeat. Simulated campaigns draw their noise from the same model.

References
----------
F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110: degrees of freedom of an estimated variance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
from scipy import stats

from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Finding
from femfit.effects.effect import AddedEffect
from femfit.identify.constants import (
    CONTRADICTED,
    EXACT,
    FINEST,
    FIXED,
    LEAST_READINGS,
    LEAST_REPEATS,
    LEAST_REPEATS_AGAINST_DECLARED,
    MOST_MOUNTS,
    MOST_STOPS,
    PRIOR_MOUNT_M,
    PRIOR_RUN,
    PRIOR_WEIGHT,
    ROUNDS,
    SAME_READING,
    UNKNOWN_CHANNEL,
)
from femfit.identify.noise.design import ChannelDesign, channel_design, made_by_settings, rho_of
from femfit.identify.noise.likelihood import Contrasts, Likelihood, Priors
from femfit.identify.noise.whitening import NoiseModel, Whitening, random_effects, stops
from femfit.identify.observations import Observations
from femfit.identify.settings import quantisation_step, setting_cells
from femfit.identify.words import finding
from femfit.tables.measurement import OF_RUNS

GUESS = "guess"
"""Source of a noise that smooth patterns of the settings leave, where neither repeats nor a declaration tell it."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """A channel's readings, what is known of their noise beforehand, and what is likeliest of it."""

    design: ChannelDesign
    declared: float  # Standard deviation of a reading; NaN where nothing declares it
    weight: float  # So many readings it counts like
    source: str
    repeats: float  # Those that count
    place: tuple[int, int] = (0, 0)  # Numbers of the correlation and of the setting's share

    def likeliest(self, ratio: FloatArray) -> Self:
        """With the correlation and the setting's share that are likeliest where random effects (q,) are so large.

        Repeats, or a declaration, tell what a setting has from what a reading has; that is a misfit and no noise.
        """
        shared = bool(self.repeats or self.weight)
        return replace(self, place=self.design.likeliest(ratio, shared=shared))

    @property
    def contrasts(self) -> Contrasts:
        """What the readings say of variances."""
        return self.design.contrasts(*self.place)

    @property
    def variance(self) -> float:
        """Of a reading, random effects taken for fixed."""
        known = self.weight * self.declared**2 if self.weight else 0.0
        return (known + self.contrasts.square) / (self.weight + max(self.contrasts.free, 1.0))

    @property
    def degrees_of_freedom(self) -> float:
        """Of the variance, counted in independent readings; infinite where it is known.

        Readings that follow each other by the correlation rho say it only as well as (1 - rho^2) / (1 + rho^2) times as
        many independent ones; and slow patterns have (1 + rho) / (1 - rho) of it, which rho's own uncertainty,
        (1 - rho^2) / n, makes uncertain by 4 / ((1 - rho^2) n) in relative variance, and by 8 rho of these more since a
        large correlation goes with a large variance.
        """
        rho, free = rho_of(self.place[0]), max(self.contrasts.free, 1.0)
        if self.weight == EXACT:
            return np.inf
        independent = self.weight + free * (1.0 - rho**2) / (1.0 + rho**2)
        return 1.0 / ((2.0 + 4.0 * rho) * (rho > 0.0) / ((1.0 - rho**2) * free) + 1.0 / independent)


def estimate_noise(observations: Observations) -> NoiseModel | None:
    """The noise model of a campaign.

    None where neither repeats nor a declaration say the noise of any channel, and it cannot be guessed either.
    """
    mount = observations.column("mount")
    if MOST_MOUNTS < len(mounts := np.unique(mount)) <= MOST_STOPS:
        some = mounts[np.linspace(0, len(mounts) - 1, MOST_MOUNTS).astype(int)]
        observations = observations.select(np.isin(mount, some))
    names, constant = observations.channels, never_varying(observations)
    every = {c: _scatter(observations, c, name in constant) for c, name in enumerate(names)}
    guessed = {c: of_channel for c, of_channel in every.items() if of_channel is not None}
    scatter = {c: of_channel for c, of_channel in guessed.items() if of_channel.source != GUESS}
    if not scatter and len(guessed) + len(constant) == len(names):  # a guess is one of all channels
        scatter = guessed
    if not scatter:
        return None
    scales = _scales(observations, scatter)
    # An offset of a run looks like readings that follow each other: it is begun with small ones and with large ones
    ends = [_settled(observations, scatter, scales, factor * scales) for factor in (1.0, FIXED)]
    scatter, sizes, of_readings, likelihood, used, x = min(ends, key=_Settled.cost)
    deviations, means = random_effects(observations).deviations(sizes), sizes.copy()
    means[used] = [np.sqrt(likelihood.mean_variance(x, k)) for k in range(len(used))]
    largest = [float(np.abs(observations.value[observations.channel == c]).max(initial=0.0)) for c in range(len(names))]
    sigma = UNKNOWN_CHANNEL * np.array([value or 1.0 for value in largest])
    rho, repeats, degrees = *np.zeros((2, len(names))), np.full(len(names), 1.0 / EXACT)  # of none where unknown
    for c, of_channel in scatter.items():
        step = quantisation_step(observations.value[observations.channel == c])
        sigma[c] = max(float(np.sqrt(of_readings[c])), step / np.sqrt(12.0))
        rho[c] = of_channel.design.mean_correlation(of_channel.place, deviations / np.sqrt(of_readings[c]))
        repeats[c] = of_channel.repeats
        degrees[c] = of_channel.degrees_of_freedom
    return NoiseModel(
        channels=names,
        sigma=sigma,
        rho=rho,
        mount_m=float(means[0]),
        run=means[1:-1],
        repeats=repeats,
        degrees_of_freedom=degrees,
        source={names[c]: of_channel.source for c, of_channel in scatter.items()},
        stop_m=float(means[-1]) or observations.declared_noise.get("distance_m", 0.0),
        mount_assumed="distance_m" not in observations.declared_noise and bool(2.0 * sizes[0] < means[0]),
        never_varying=tuple(constant),
    )


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
        variance, free = float(missed[c]), float(count)
        if k or not of_stops:
            design = channel_design(observations, c)
            variance, free = design.variance, design.contrasts(0, 0).free
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
    names, cells = [], setting_cells(observations)
    for name in observations.channels:
        here = observations.of(name)
        value, by_cell = observations.value[here], pd.Series(observations.value[here]).groupby(cells[here])
        spread = by_cell.max() - by_cell.min()
        repeated = len(value) - len(spread) >= LEAST_REPEATS
        if repeated and spread.max() <= SAME_READING * float(np.abs(value).max()):
            names.append(name)
    return names


def _scatter(observations: Observations, c: int, constant: bool) -> Scatter | None:
    """What repeats, a declaration and smooth patterns say of a channel's readings; None where nothing does."""
    declared, source = observations.declared_noise.get(observations.channels[c], np.nan), observations.noise_source
    values = observations.value[observations.channel == c]
    if not len(values):  # none in the mounts that say the noise
        return None
    step = quantisation_step(values) / np.sqrt(12.0)
    least = max(step, FINEST * float(np.abs(values).max()))
    weight = EXACT if source == "samples" else LEAST_REPEATS_AGAINST_DECLARED
    if constant and not np.isfinite(declared):  # coarser than its noise: rounding is left
        declared, source, weight = step or np.nan, "resolution", EXACT
    known = bool(np.isfinite(declared))
    declared = max(declared, least) if known else np.nan
    design = channel_design(observations, c, declared if known else 0.0)
    if not known and (constant or design.contrasts(0, 0).free < LEAST_REPEATS):
        return None
    made, free = made_by_settings(observations, c), design.contrasts(0, 0).free
    if not known and made.any():
        # Without what the declared errors of the settings make; but not less is left than the standard error of a
        # variance from so many readings: below it nothing can be told apart
        variance = max(design.variance - float(made.mean()), design.variance * np.sqrt(2.0 / free), least**2)
        design = channel_design(observations, c, float(np.sqrt(variance)))
    # Windows of a record that share a setting share no motion, and what their edges of a command are off by
    repeats = 0.0 if constant or observations.in_motion or design.repeats < LEAST_REPEATS else float(design.repeats)
    if not known:
        varies = design.contrasts(0, 0).square > SAME_READING * float(np.sum(design.residual**2))
        return Scatter(design, np.nan, 0.0, "repeats" if repeats else GUESS, repeats) if varies else None
    told = Scatter(design, declared, EXACT, source, 0.0)  # which nothing moves
    if not repeats or design.contrasts(0, 0).free < LEAST_REPEATS:  # mounts may have all that repeats differ by
        return told
    alone = Scatter(design, np.nan, 0.0, "repeats", repeats)
    shown = alone.likeliest(FIXED / np.maximum(np.linalg.norm(design.random, axis=0), 1e-300)).variance
    ratio = shown / declared**2
    if 2.0 * min(stats.f.sf(ratio, repeats, weight), stats.f.cdf(ratio, repeats, weight)) < CONTRADICTED:
        return alone
    return told if weight == EXACT else Scatter(design, declared, weight, f"{source} and repeats", repeats)


class _Settled(NamedTuple):
    """Correlations, shares and variances that are the likeliest together."""

    scatter: dict[int, Scatter]
    sizes: FloatArray  # Standard deviations of mounts, runs of each channel and stops; shape (2 + channels,)
    of_readings: dict[int, float]  # Variances by the channel
    likelihood: Likelihood
    used: IntArray  # Which of mounts, runs and stops have a variance in it
    log_variances: FloatArray  # All of its

    def cost(self) -> float:
        """-2 log of likelihood and prior of all."""
        each = (scatter.design.cost(scatter.place) for scatter in self.scatter.values())
        return self.likelihood.cost(self.log_variances) + sum(each)


def _settled(
    observations: Observations, scatter: Mapping[int, Scatter], scales: FloatArray, sizes: FloatArray
) -> _Settled:
    """Correlations by the variances, and these by the correlations."""
    effects, of_readings = random_effects(observations), {c: each.variance for c, each in scatter.items()}
    likeliest, near = dict(scatter), list[FloatArray]()
    for _ in range(ROUNDS):
        deviations = effects.deviations(sizes)
        likeliest = {c: each.likeliest(deviations / np.sqrt(of_readings[c])) for c, each in likeliest.items()}
        likelihood, used = _likelihood(observations, likeliest, scales)
        x, sizes = likelihood.maximum(*near), np.zeros(len(scales))
        near = [x]
        sizes[used] = np.exp(0.5 * x[: len(used)])
        of_readings = dict(zip(scatter, np.exp(x[len(used) :]).tolist(), strict=True))
    return _Settled(likeliest, sizes, of_readings, likelihood, used, x)


def _scales(observations: Observations, scatter: Mapping[int, Scatter]) -> FloatArray:
    """What mounts, runs of each channel and stops are assumed to scatter by, or were declared to: standard deviations.

    A stop is assumed to make, in the channel which shows it most, what runs are assumed to differ by; but to be off by
    no more than a body that is put back, however little the channels change with the distance.
    """
    names, declared = observations.channels, observations.declared_noise
    slope = np.sqrt(observations.mean_square(observations.distance_slope))
    sigma = {c: np.sqrt(of_channel.variance) for c, of_channel in scatter.items()}
    runs = [declared.get(OF_RUNS + name) or PRIOR_RUN * sigma.get(c, 1.0) for c, name in enumerate(names)]
    shown = max(float(slope[c] / sd) for c, sd in sigma.items())
    stop = min(PRIOR_RUN / shown, PRIOR_MOUNT_M) if shown else PRIOR_MOUNT_M
    distance_m = declared.get("distance_m")
    return np.array([distance_m or PRIOR_MOUNT_M, *runs, distance_m or stop])


def _likelihood(
    observations: Observations, scatter: Mapping[int, Scatter], scales: FloatArray
) -> tuple[Likelihood, IntArray]:
    """The likelihood of all variances, and which of mounts, runs of each channel and stops have one.

    Only those have a variance that several mounts or runs, in a channel of known noise, have.
    """
    random, names, declared = random_effects(observations), observations.channels, observations.declared_noise
    moved = any(observations.distance_slope[observations.channel == c].any() for c in scatter)
    judged = np.array([moved, *(c in scatter for c in range(len(names))), moved])
    used = np.flatnonzero((random.differences > 0.0) & judged)
    of_distance = PRIOR_WEIGHT * ("distance_m" in declared)
    weight = np.array([of_distance, *(EXACT * (OF_RUNS + name in declared) for name in names), of_distance])
    columns = np.isin(random.group, used)
    known = [(s.declared**2 if s.weight else s.variance, s.weight) for s in scatter.values()]
    likelihood = Likelihood(
        [replace(s.contrasts, columns=s.contrasts.columns[:, columns]) for s in scatter.values()],
        np.searchsorted(used, random.group[columns]),
        random.second[columns],
        Priors(
            scale=np.concatenate([scales[used] ** 2, [variance for variance, _ in known]]),
            weight=np.concatenate([weight[used], [counted for _, counted in known]]),
            from_zero=np.concatenate([weight[used] == 0.0, np.zeros(len(scatter), dtype=bool)]),
        ),
    )
    return likelihood, used
