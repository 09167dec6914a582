"""A campaign, on which a diagnosis rests: readings, their noise, and whitened columns of what a misfit may be made of.

These are patterns of the lack of fit, effects, errors of their forms, and unknown causes. From them follow what the
readings can show of each effect, and how much of a misfit effects explain.

References
----------
J. Cohen, Statistical Power Analysis for the Behavioral Sciences (Erlbaum, 1988), chapter 12: noncentral chi-square.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from operator import attrgetter

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy import stats

from femfit.core.numerics import FloatArray, IntArray, even_scale
from femfit.core.results import Finding
from femfit.effects.catalogue import device_effects, effect_by_name
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, Effect
from femfit.identify.constants import (
    BROAD,
    FINER,
    FORM,
    FORM_DEGREE,
    FORM_ELSEWHERE,
    LEVEL,
    POWER,
    SHARE_DEGREE,
    STILL_THE_NOISE,
)
from femfit.identify.lack_of_fit import PatternSpace, distinct, pattern_space
from femfit.identify.noise.components import (
    as_readings_show,
    beside_effects,
    dead_sensors,
    estimate_noise,
    never_varying,
)
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations, WithoutCache
from femfit.identify.patterns import products, scaled_to_one
from femfit.identify.refit import Refit, Start
from femfit.identify.signatures import testable_columns
from femfit.identify.words import finding

FORM_DIRECTIONS = 14
"""Numerical, for the time that it takes: directions of a form's error that are kept, the largest."""


VARIANCES, OF_SIGMA = ("sigma", "run", "mount_m", "stop_m"), ("sigma", "rho", "repeats", "degrees_of_freedom")
"""Of a noise model: what a misfit may look like, and what goes with the readings' own."""


@dataclass(frozen=True, eq=False)
class Block:
    """Whitened columns that a misfit may be made of."""

    columns: FloatArray  # Shape (M, k)

    @cached_property
    def gram(self) -> FloatArray:
        """Products of the columns, shape (k, k)."""
        return np.asarray(self.columns.T @ self.columns)


@dataclass(frozen=True, eq=False)
class EffectBlock(Block):
    """Those of an effect: its amplitudes at half of their plausible ranges, then errors of its form."""

    start: Start

    @property
    def amplitudes(self) -> FloatArray:
        """Columns of the amplitudes, shape (M, count)."""
        return self.columns[:, : self.start.count]


@dataclass(frozen=True, eq=False)
class Campaign(WithoutCache):
    """Readings with everything that a decision about them needs.

    Columns of effects are as long as one standard deviation of what they stand for.
    """

    whitening: Whitening
    # Every testable effect at every combination of trial values of its nonlinear parameters, in the catalogue's
    # order, with amplitudes of zero
    effects: tuple[Start, ...]
    untestable: Mapping[str, str]

    @property
    def observations(self) -> Observations:
        """The readings."""
        return self.whitening.observations

    @property
    def noise(self) -> NoiseModel:
        """Variances of the campaign."""
        return self.whitening.noise

    def beside(self, effects: Sequence[AddedEffect]) -> "Campaign | None":
        """The campaign with what of the noise effects take away; None where all of it is next to the same.

        What stays keeps its size, so that it is the noise that every command states.
        """
        noise, before = beside_effects(self.whitening, effects).noise, self.noise
        less = {name: np.less(vars(noise)[name], STILL_THE_NOISE * vars(before)[name]) for name in VARIANCES}
        if not any(map(np.any, less.values())):
            return None
        other_source = [noise.source.get(name) != before.source.get(name) for name in noise.channels]
        less |= dict.fromkeys(OF_SIGMA, less["sigma"] | other_source) | {"mount_assumed": less["mount_m"]}
        taken = {
            name: vars(noise)[name] if np.all(which) else np.where(which, vars(noise)[name], vars(before)[name])
            for name, which in less.items()
            if np.any(which)
        }
        return self.whitened_by(replace(self.whitening, noise=replace(before, source=noise.source, **taken)))

    def whitened_by(self, whitening: Whitening) -> "Campaign":
        """The same readings and effects by another map to independent readings."""
        starts = Start.at_null([start.columns for start in self.effects], whitening)
        return Campaign(whitening, starts, self.untestable)

    @cached_property
    def patterns(self) -> PatternSpace:
        """Smooth patterns of a lack of fit."""
        return pattern_space(self.whitening)

    @cached_property
    def variants(self) -> Mapping[str, tuple[EffectBlock, ...]]:
        """Per effect its columns for each combination of nonlinear parameters."""
        return {name: tuple(map(self.block, starts)) for name, starts in groupby(self.effects, attrgetter("name"))}

    def block(self, start: Start) -> EffectBlock:
        """An effect's amplitudes at half of their plausible range, then its form's error."""
        change = start.columns.columns * start.half_ranges
        errors = _leading(np.concatenate([self.form_error(start.columns.effect, c) for c in change.T], axis=1))
        return EffectBlock(np.concatenate([start.whitened * start.half_ranges, errors], axis=1), start)

    @cached_property
    def in_some_runs(self) -> Mapping[str, tuple[EffectBlock, ...]]:
        """Per effect its first variant as it begins or ends between two runs, of exact form; none of one run.

        A number of the drawing, which no effect of the catalogue changes, is the same in every run.
        """
        runs, run = self.observations.runs, self.observations.column("run").astype(int)
        periods = [*((k, runs - 1) for k in range(1, runs)), *((0, k) for k in range(runs - 1))]
        fixed = {effect.name for effect in self.observations.nominal.drawn}
        firsts = [blocks[0].start.columns for name, blocks in self.variants.items() if name not in fixed]
        every = [first.in_runs(period, run) for first in firsts for period in periods]
        starts = Start.at_null(every, self.whitening)
        blocks = [EffectBlock(start.whitened * start.half_ranges, start) for start in starts]
        return {name: tuple(some) for name, some in groupby(blocks, attrgetter("start.name"))}

    @cached_property
    def unknown(self) -> Block:
        """What an unknown cause may look like, each of unit length: smooth patterns, then shares of the prediction."""
        shares = self.whitening.full(self._shares * self.observations.base[:, None])
        columns = np.concatenate([self.patterns.whitened, shares], axis=1)
        return Block(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))

    @cached_property
    def _shares(self) -> FloatArray:
        """Smooth functions of the setting, coarse ones first, in one channel after the other; shape (M, f)."""
        return _smooth_by_channel(self.observations, SHARE_DEGREE)

    @cached_property
    def unknown_groups(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """Which patterns an unknown cause may have, and how long each is beside the others.

        Those of one channel, or of all, up to a degree or all, the finer the shorter; those of one channel that change
        with the distance alone, or with the current, all as long; and a channel's shares.
        """
        patterns = self.patterns.patterns
        channels, finest = np.unique(patterns.channel), int(patterns.degree.max(initial=0))
        parts = [(patterns.channel == c) & (patterns.degree <= cut) for c in channels for cut in (*BROAD, finest)]
        parts += [patterns.degree <= cut for cut in (*BROAD[1:3], finest)]
        groups = map(np.flatnonzero, distinct(parts))
        weighed = [(group, np.asarray(FINER ** patterns.degree[group])) for group in groups]
        alone = [
            [k for k, a in enumerate(patterns.along) if a <= {name} and patterns.channel[k] == c]
            for c in channels
            for name in ("distance_m", "current_A")
        ]
        each = self._shares.shape[1] // len(self.observations.channels)
        firsts = range(len(patterns.degree), self.unknown.columns.shape[1], each)
        alone += [list(range(first, first + each)) for first in firsts]
        return (*weighed, *((np.array(group, dtype=int), np.ones(len(group))) for group in alone))

    @cached_property
    def _modulations(self) -> FloatArray:
        """Smooth functions of the setting in each channel, at most one over the root of their number; shape (M, f).

        Together their mean square is about a quarter over an even grid.
        """
        smooth = _smooth_by_channel(self.observations, FORM_DEGREE)
        return np.asarray(smooth / np.sqrt(smooth.shape[1] / len(self.observations.channels)))

    def form_error(self, effect: Effect, change: FloatArray) -> FloatArray:
        """Whitened columns (M, n) of the error of an effect's form where it changes the readings by so much, (M,)."""
        error = max(FORM.get(stage, FORM_ELSEWHERE) for stage in effect.acts_on)
        columns = self._modulations * change[:, None]
        return _leading(error * self.whitening.full(columns[:, np.any(columns != 0.0, axis=0)]))

    def explained_share(self, fit: Refit, excess: float) -> float:
        """Part of the structured misfit above the noise, ``excess``, that effects explain."""
        before = self.whitening.residual
        return (float(before @ before) - fit.chi2) / max(excess, 1e-12)


def _smooth_by_channel(observations: Observations, degree: int) -> FloatArray:
    """Products of Legendre polynomials in log distance and current up to a total degree, in each channel; (M, f)."""
    x = scaled_to_one(even_scale(observations.column("distance_m")))
    y = scaled_to_one(observations.column("current_A"))
    in_x, in_y = (np.asarray(legvander(z, degree), dtype=np.float64) for z in (x, y))
    smooth = np.stack([column for column, _, _ in products(in_x, in_y, degree)], axis=1)
    channels = range(len(observations.channels))
    return np.concatenate([smooth * (observations.channel == c)[:, None] for c in channels], axis=1)


def _leading(columns: FloatArray) -> FloatArray:
    """The largest directions of a block."""
    if columns.shape[1] <= FORM_DIRECTIONS:
        return columns
    _, vectors = np.linalg.eigh(columns.T @ columns)
    return np.asarray(columns @ vectors[:, -FORM_DIRECTIONS:])


def considered_effects(exclude: Sequence[str] = (), nominal: Nominal | None = None) -> list[Effect]:
    """A device's catalogue without some effects; a name that the whole one does not have is an error.

    Nor has it those that another one stands for.
    """
    catalogue = device_effects(nominal.circuits, nominal.drawn) if nominal else device_effects(())
    for name in exclude:
        if name not in catalogue:
            effect_by_name(name)
    out = {*exclude, *(effect.stands_for for effect in catalogue.values())}
    return [effect for name, effect in catalogue.items() if name not in out]


def gather(observations: Observations, effects: Sequence[Effect]) -> Campaign | Finding:
    """Estimate the noise and compute the lack-of-fit patterns and every effect's columns.

    A finding says instead why these readings cannot be tested: their noise is unknown, or they are too few.
    """
    observations = as_readings_show(observations)
    noise = estimate_noise(observations)
    if noise is None:
        return next(dead_sensors(never_varying(observations)), finding("no-noise"))
    whitening = Whitening.granting(observations, noise)
    columns, untestable = testable_columns(observations, effects)
    campaign = Campaign(whitening, Start.at_null(columns, whitening), untestable)
    return campaign if campaign.patterns.groups else finding("too-few-readings")


def detectable_magnitudes(effects: Sequence[Start]) -> dict[str, dict[str, float]]:
    """The smallest magnitude of each effect's amplitudes that settings and noise show nine times in ten.

    The model's own misfit to its table counts as noise.

    Returns
    -------
    dict of str to dict of str to float
        Effect -> amplitude -> magnitude in its unit, each amplitude taken alone; infinite where the bounds end
        before. Nonlinear parameters have their usual values.
    """
    usual = {start.name: start for start in reversed(effects)}  # the first of each
    names = dict.fromkeys(start.name for start in effects)
    threshold = stats.chi2.isf(LEVEL / max(len(names), 1), 1)
    needed = np.sqrt(threshold) + stats.norm.ppf(POWER)  # of one degree of freedom; its other tail is nothing
    result: dict[str, dict[str, float]] = {name: {} for name in names}
    for name, magnitudes in result.items():
        start = usual[name]
        for p, length in zip(start.columns.amplitudes, np.linalg.norm(start.whitened, axis=0).tolist(), strict=True):
            magnitude = float(needed) / length if length > 0.0 else np.inf
            magnitudes[p.name] = magnitude if magnitude <= max(p.upper - p.null, p.null - p.lower) else np.inf
    return result
