"""Whitened columns of everything that a bench's misfit may be made of: effects, their forms' errors, unknown causes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legvander

from femfit.core.numerics import FloatArray, IntArray, even_scale
from femfit.effects.effect import Effect
from femfit.identify.constants import FINER
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.constants import (
    BROAD,
    FORM,
    FORM_DEGREE,
    FORM_DIRECTIONS,
    FORM_ELSEWHERE,
    SHARE_DEGREE,
)
from femfit.identify.observations import Observations, WithoutCache
from femfit.identify.patterns import products, scaled_to_one
from femfit.identify.refit import Start


@dataclass(frozen=True, eq=False)
class EffectSpace(WithoutCache):
    """The columns of a campaign, each as long as one standard deviation of what it stands for."""

    campaign: Campaign

    @cached_property
    def variants(self) -> Mapping[str, tuple[int, ...]]:
        """Per effect, its numbers among the campaign's: one for each combination of nonlinear parameters."""
        names = dict.fromkeys(start.name for start in self.campaign.effects)
        return {name: tuple(k for k, start in enumerate(self.campaign.effects) if start.name == name) for name in names}

    @cached_property
    def blocks(self) -> tuple[FloatArray, ...]:
        """The block of every variant."""
        return tuple(self.block(start) for start in self.campaign.effects)

    def block(self, start: Start) -> FloatArray:
        """An effect's amplitudes' columns at half of their plausible range, then its form's error; shape (M, k)."""
        change = start.columns.columns * half_ranges(start)
        errors = _leading(np.concatenate([self.form_error(start.columns.effect, c) for c in change.T], axis=1))
        return np.concatenate([start.whitened * half_ranges(start), errors], axis=1)

    @cached_property
    def grams(self) -> tuple[FloatArray, ...]:
        """Products of each block's columns, shape (k, k)."""
        return tuple(np.asarray(block.T @ block) for block in self.blocks)

    @cached_property
    def run_by_run(self) -> Mapping[str, tuple[int, FloatArray]]:
        """Per effect, a variant and its amplitudes' columns run after run, shape (M, runs times k); none of one run.

        A number of the drawing, which no effect of the catalogue changes, is the same in every run.
        """
        observations = self.campaign.observations
        runs, run = observations.runs, observations.column("run")
        fixed = {effect.name for effect in observations.nominal.drawn}
        firsts = {name: variants[0] for name, variants in self.variants.items() if name not in fixed}
        if runs == 1 or not firsts:
            return {}
        picked = [self.campaign.effects[k] for k in firsts.values()]
        changes = [start.columns.columns * half_ranges(start) for start in picked]
        parts = np.concatenate([change * (run == k)[:, None] for change in changes for k in range(runs)], axis=1)
        ends = np.cumsum([runs * change.shape[1] for change in changes])[:-1]
        whitened = np.split(self.campaign.whitening.full(parts), ends, axis=1)
        return {name: (k, columns) for (name, k), columns in zip(firsts.items(), whitened, strict=True)}

    @cached_property
    def unknown(self) -> FloatArray:
        """What an unknown cause may look like: smooth patterns, then shares of the prediction; shape (M, n).

        Each has unit length.
        """
        observations, whitening = self.campaign.observations, self.campaign.whitening
        shares = whitening.full(self._shares * observations.base[:, None])
        columns = np.concatenate([self.campaign.patterns.groups[-1].whitened, shares], axis=1)
        return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))

    @cached_property
    def _shares(self) -> FloatArray:
        """Smooth functions of the setting, coarse ones first, in one channel after the other; shape (M, f)."""
        return _smooth_by_channel(self.campaign.observations, SHARE_DEGREE)

    @cached_property
    def unknown_gram(self) -> FloatArray:
        """Products of the patterns, shape (n, n)."""
        return np.asarray(self.unknown.T @ self.unknown)

    @cached_property
    def unknown_groups(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """Which patterns an unknown cause may have, and how long each is beside the others.

        Those of one channel, or of all, up to a degree or all, the finer the shorter; those of one channel that change
        with the distance alone, or with the current, all as long; and a channel's shares.
        """
        patterns = self.campaign.patterns.patterns
        finest = int(patterns.degree.max(initial=0))
        parts = [
            (patterns.channel == c) & (patterns.degree <= cut)
            for c in np.unique(patterns.channel)
            for cut in (*BROAD, finest)
        ]
        parts += [patterns.degree <= cut for cut in (*BROAD[1:3], finest)]
        groups = [
            np.flatnonzero(picks) for picks in {picks.tobytes(): picks for picks in parts if picks.any()}.values()
        ]
        weighed = [(group, np.asarray(FINER ** patterns.degree[group])) for group in groups]
        for c in np.unique(patterns.channel):
            for name in ("distance_m", "current_A"):
                alone = [k for k, a in enumerate(patterns.along) if a <= {name} and patterns.channel[k] == c]
                weighed.append((np.array(alone, dtype=int), np.ones(len(alone))))
        each = self._shares.shape[1] // len(self.campaign.observations.channels)
        firsts = range(len(patterns.degree), self.unknown.shape[1], each)
        return (*weighed, *((first + np.arange(each), np.ones(each)) for first in firsts))

    @cached_property
    def _modulations(self) -> FloatArray:
        """Smooth functions of the setting in each channel, at most one over the root of their number; shape (M, f).

        Together their mean square is about a quarter over an even grid.
        """
        observations = self.campaign.observations
        smooth = _smooth_by_channel(observations, FORM_DEGREE)
        return np.asarray(smooth / np.sqrt(smooth.shape[1] / len(observations.channels)))

    def form_error(self, effect: Effect, change: FloatArray) -> FloatArray:
        """Whitened columns (M, n) of the error of an effect's form where it changes the readings by so much, (M,)."""
        error = max(FORM.get(stage, FORM_ELSEWHERE) for stage in effect.acts_on)
        columns = self._modulations * change[:, None]
        return _leading(error * self.campaign.whitening.full(columns[:, np.any(columns != 0.0, axis=0)]))


def half_ranges(start: Start) -> FloatArray:
    """Half of the plausible ranges of an effect's amplitudes, shape (k,)."""
    return np.array([0.5 * p.width for p in start.columns.amplitudes])


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
