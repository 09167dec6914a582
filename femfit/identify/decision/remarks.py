"""What a campaign says of what is named, and beside it: each effect alone, dead sensors, guessed noise, bench errors.

An error of the bench that no effect of the catalogue is, of the stage or of a sensor's zero, is taken out of the misfit
with whatever sizes it may have; it is said where nothing is left then.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from femfit.core.numerics import ranked
from femfit.core.results import Finding
from femfit.effects.words import describe
from femfit.identify.constants import CREEP_DEGREE, LEVEL, READINGS_OF_A_STOP, ROUNDING
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.naming import Decision
from femfit.identify.noise.components import dead_sensors
from femfit.identify.noise.whitening import NoiseModel, stops
from femfit.identify.refit import Refit, fitted_together, plausible
from femfit.identify.words import finding


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the verdict names."""

    data = (
        *("name", "explained_share", "parameters", "ci95", "words", "tied_words", "plausible", "class=members", "tie"),
        "when",
    )

    name: str
    members: tuple[str, ...]  # The class: effects that would give the same readings, itself first
    tie: tuple[str, ...]  # Those of them that are as likely, itself first: the data do not choose among these
    explained_share: float  # Part of the structured misfit, above the noise, that all that is named explains
    parameters: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # 95 % intervals
    words: tuple[str, ...] = ()
    tied_words: tuple[tuple[str, ...], ...] = ()  # Of the others of the tie, in their order
    plausible: bool = True  # Whether every parameter lies in its plausible range
    # First and last run in which it acts, counted from 1; None for all
    runs: tuple[int, int] | None = None

    @property
    def when(self) -> dict[str, int] | None:
        """First and last run by their names."""
        return dict(zip(("first_run", "last_run"), self.runs, strict=True)) if self.runs else None


@dataclass(frozen=True)
class ScoredEffect:
    """An effect of the catalogue as these data see it."""

    name: str
    # By how much it lowers the weighted sum of squares: refitted where ``error_left`` is a number, else to first
    # order
    chi2_fall: float
    degrees_of_freedom: int  # Number of its amplitudes that these data can see
    explained_share: float = float("nan")  # As in :class:`NamedEffect`; NaN where it was not refitted
    note: str = ""  # Why it cannot be tested; empty where it can
    # Rms error that it leaves alone, refitted, over the noise of one reading, all channels together; NaN where it was
    # not refitted
    error_left: float = float("nan")


def named_effects(campaign: Campaign, decision: Decision, fit: Refit, excess: float) -> tuple[NamedEffect, ...]:
    """What is named, each effect with its class and the sizes of those that are as likely."""
    by_name = {added.effect.name: added for added in fit.effects}
    exchanged = {frozenset(each.names): each.fit for each in decision.remaining if each.fit}
    nominal, result = campaign.observations.nominal, []
    for members, tie in zip(decision.classes, decision.ties, strict=True):
        added, beside = by_name[members[0]], set(fit.names) - {members[0]}
        refits = [exchanged.get(frozenset(beside | {name})) for name in tie[1:]]
        exchanges = [[a for a in each.effects if a.effect.name not in beside] if each else [] for each in refits]
        named = NamedEffect(
            name=members[0],
            members=members,
            tie=tie,
            explained_share=campaign.explained_share(fit, excess),
            parameters=dict(added.parameters),
            ci95=dict(added.ci95),
            words=tuple(describe(added, nominal)),
            tied_words=tuple(tuple(clause for a in rivals for clause in describe(a, nominal)) for rivals in exchanges),
            plausible=plausible(added),
            runs=None if added.runs is None else (added.runs[0] + 1, added.runs[1] + 1),
        )
        result.append(named)
    return tuple(result)


def scored(campaign: Campaign) -> tuple[ScoredEffect, ...]:
    """Every effect alone to first order, at its best nonlinear parameters; what lowers the misfit most stands first."""
    best: dict[str, tuple[float, int]] = {}
    for start in campaign.effects:
        _, fall = fitted_together(campaign.whitening.residual, [start])
        best[start.name] = max(best.get(start.name, (0.0, start.count)), (fall, start.count))
    scores = [ScoredEffect(name, *fall_and_count) for name, fall_and_count in best.items()]
    absent = (ScoredEffect(name, 0.0, 0, note=why) for name, why in campaign.untestable.items())
    return (*ranked(scores, lambda score: score.chi2_fall - score.degrees_of_freedom, ROUNDING), *absent)


def ranking_of(
    campaign: Campaign, decision: Decision, scores: tuple[ScoredEffect, ...], excess: float
) -> tuple[ScoredEffect, ...]:
    """Every effect as these data see it: those that were refitted as they were, the best first, then the others."""
    before, by_name = float(np.sum(campaign.whitening.residual**2)), {score.name: score for score in scores}
    observations, noise, refitted = campaign.observations, campaign.noise, dict[str, ScoredEffect]()
    judged = np.array([name in noise.source for name in noise.channels])[observations.channel]
    for name, fit in ((names[0], fit) for names, fit in decision.fits.items() if len(names) == 1):
        # Over the noise of one reading, as the fall of the error has it; all channels together
        residual = (observations.value - observations.predict(fit.effects)) / noise.sigma[observations.channel]
        share, error = campaign.explained_share(fit, excess), float(np.sqrt(np.mean(residual[judged] ** 2)))
        fall = before - fit.chi2
        refitted[name] = replace(by_name[name], chi2_fall=fall, explained_share=share, error_left=error)
    return (*refitted.values(), *(score for score in scores if score.name not in refitted))


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
    return [*few, *dead_sensors(noise.never_varying), *replaced, *guessed_noises(noise)]


def stage_errors(campaign: Campaign) -> list[Finding]:
    """Say that errors of the stage would explain a misfit, where stops have some rows each and no error is known.

    Whatever shifts the stops may have is taken out of the misfit; what several currents show beside it is tested.
    """
    observations, whitening = campaign.observations, campaign.whitening
    number = stops(observations)
    if campaign.noise.stop_m or READINGS_OF_A_STOP * (number.max() + 1) > len(observations.covariates):
        return []
    shifts = whitening.full((number[:, None] == np.unique(number)) * observations.distance_slope[:, None])
    if campaign.patterns.test(whitening.residual, shifts).p_value <= LEVEL:
        return []
    size = float(np.sqrt(np.mean(np.linalg.lstsq(shifts, whitening.residual)[0] ** 2)))
    return [finding("stage-errors", "distance_m", size, error=size)]


def creeping_zeros(campaign: Campaign) -> list[Finding]:
    """Say of which sensor a zero that creeps with the order of the rows would explain a misfit by itself."""
    observations, whitening = campaign.observations, campaign.whitening
    elapsed = observations.row / max(int(observations.row.max()), 1)
    slow = elapsed[:, None] ** np.arange(1, 1 + CREEP_DEGREE)
    findings = []
    for name in observations.channels:
        zeros = slow * observations.of(name)[:, None]
        whitened = whitening.full(zeros)
        if campaign.patterns.test(whitening.residual, whitened).p_value > LEVEL:
            crept = np.ptp((zeros @ np.linalg.lstsq(whitened, whitening.residual)[0])[observations.of(name)])
            findings.append(finding("creeping-zero", name, float(crept), name=name, crept=float(crept)))
    return findings


def guessed_noises(noise: NoiseModel) -> list[Finding]:
    """Say that the noise is a guess, where nothing tells it."""
    sizes = {name: noise.known[name] for name, source in noise.source.items() if source == "guess"}
    return [finding("guessed-noise", sizes=sizes)] if sizes else []
