"""A campaign, on which a diagnosis rests: readings, their noise, patterns of the lack of fit, and effects' columns.

From it follow what the readings can show of each effect, and how much of a misfit effects explain.

References
----------
J. Cohen, Statistical Power Analysis for the Behavioral Sciences (Erlbaum, 1988), chapter 12: noncentral chi-square.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats

from femfit.core.results import Finding
from femfit.effects.catalogue import device_effects, effect_by_name
from femfit.effects.conditions import Nominal
from femfit.effects.effect import Effect
from femfit.identify.constants import LEVEL, POWER
from femfit.identify.lack_of_fit import PatternSpace, pattern_space
from femfit.identify.noise.components import estimate_noise, never_varying
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, Start
from femfit.identify.signatures import CHANGES_NOTHING, EffectColumns, effect_columns, why_untestable
from femfit.identify.words import finding


@dataclass(frozen=True, eq=False)
class Campaign:
    """Readings with everything that a decision about them needs."""

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

    @cached_property
    def patterns(self) -> PatternSpace:
        """Smooth patterns of a lack of fit."""
        return pattern_space(self.whitening)

    def by(self, whitening: Whitening) -> "Campaign":
        """The same effects with another noise."""
        return replace(
            self, whitening=whitening, effects=Start.at_null([effect.columns for effect in self.effects], whitening)
        )


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


def testable_columns(
    observations: Observations, effects: Sequence[Effect]
) -> tuple[list[EffectColumns], dict[str, str]]:
    """The first-order columns of every effect that readings can show, and why they cannot show the others."""
    every, untestable = list[EffectColumns](), dict[str, str]()
    for effect in effects:
        reason = why_untestable(effect, observations)
        columns = [] if reason else effect_columns(effect, observations)
        if any(not np.isfinite(variant.columns).all() for variant in columns):
            columns, reason = [], "the model lacks the sensor, circuit or mass that it acts on"
        if not columns:
            untestable[effect.name] = reason or CHANGES_NOTHING
        every += columns
    return every, untestable


def gather(observations: Observations, effects: Sequence[Effect]) -> Campaign | Finding:
    """Estimate the noise and compute the lack-of-fit patterns and every effect's columns.

    A finding says instead why these readings cannot be tested: their noise is unknown, or they are too few.
    """
    noise = estimate_noise(observations)
    if noise is None:
        constant = constant_readings(never_varying(observations))
        return constant[0] if constant else finding("no-noise")
    whitening = Whitening.granting(observations, noise)
    columns, untestable = testable_columns(observations, effects)
    campaign = Campaign(whitening, Start.at_null(columns, whitening), untestable)
    return campaign if campaign.patterns.groups else finding("too-few-readings")


def campaign_remarks(campaign: Campaign) -> list[Finding]:
    """Say which channels cannot be tested, which never vary, and where the noise was guessed or repeats replaced it."""
    tested = set(campaign.patterns.patterns.channel.tolist())
    observations, noise = campaign.observations, campaign.noise
    few, replaced = list[Finding](), list[Finding]()
    for c, name in enumerate(observations.channels):
        if c not in tested:
            few.append(finding("too-few-readings", name, name=name, readings=int(observations.of(name).sum())))
        if name in observations.declared_noise and noise.source[name] == "repeats":
            facts: dict[str, Any] = {"declared": observations.declared_noise[name], "source": observations.noise_source}
            facts |= {"sigma": float(noise.sigma[c]), "repeats": round(noise.repeats[c])}
            replaced.append(finding("declared-noise", name, name=name, **facts))
    return [*few, *constant_readings(noise.never_varying), *replaced, *guessed_noises(noise)]


def constant_readings(names: Iterable[str]) -> list[Finding]:
    """Say which channels read the same at every repeat, so that their repeats show no noise."""
    return [finding("never-varies", name, name=name) for name in names]


def guessed_noises(noise: NoiseModel) -> list[Finding]:
    """Say that the noise is a guess, where nothing tells it."""
    sizes = {name: noise.floor[name] for name, source in noise.source.items() if source == "guess"}
    return [finding("guessed-noise", sizes=sizes)] if sizes else []


def detectable_magnitudes(campaign: Campaign) -> dict[str, dict[str, float]]:
    """The smallest magnitude of each effect's amplitudes that these settings and this noise show nine times in ten.

    The model's own misfit to its table counts as noise.

    Returns
    -------
    dict of str to dict of str to float
        Effect -> amplitude -> magnitude in its unit, each amplitude taken alone; infinite where the bounds end
        before. Nonlinear parameters have their usual values.
    """
    effects = {start.name for start in campaign.effects}
    threshold = stats.chi2.isf(LEVEL / max(len(effects), 1), 1)
    needed = (np.sqrt(threshold) + stats.norm.ppf(POWER)) ** 2  # of one degree of freedom; its other tail is nothing
    result: dict[str, dict[str, float]] = {}
    for start in campaign.effects:
        if start.name in result:
            continue
        result[start.name] = {}
        for k, p in enumerate(start.columns.amplitudes):
            length = float(np.linalg.norm(start.whitened[:, k]))
            magnitude = float(np.sqrt(needed)) / length if length > 0.0 else np.inf
            result[start.name][p.name] = magnitude if magnitude <= max(p.upper - p.null, p.null - p.lower) else np.inf
    return result


def explained_share(campaign: Campaign, fit: Refit, excess: float) -> float:
    """Part of the structured misfit above the noise, ``excess``, that effects explain."""
    before = campaign.whitening.residual
    return (float(before @ before) - fit.chi2) / max(excess, 1e-12)
