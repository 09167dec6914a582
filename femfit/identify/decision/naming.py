"""Decides what is missing from how probable every explanation is: nothing, known effects, an unknown cause, or both."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import Item, ranked
from femfit.identify.comparison.lack_of_fit import LackOfFit, pattern_space
from femfit.identify.constants import BEYOND_NOISE, LEVEL, LEVEL_AFTER, ROUNDING, WITHIN_NOISE
from femfit.identify.decision.campaign import Campaign, explained_share
from femfit.identify.decision.constants import (
    DOMINANT,
    EXPLAINED,
    IN_CLASS,
    NOTHING_MISSING,
    OWN_MISFIT,
    RIVALS,
    RIVALS_REFITTED,
    TIED,
)
from femfit.identify.decision.diagnosis import ScoredEffect, Verdict
from femfit.identify.decision.search import Explanation, Posterior, explain, most_of_nothing
from femfit.identify.refit.refit import Refit, is_plausible, refit, starting_point
from femfit.identify.refit.sizes import at_bounds

_KINDS: Mapping[Verdict, tuple[bool, bool]] = {
    "nothing_missing": (False, False),
    "named": (True, False),
    "form_insufficient": (True, True),
    "unexplained": (False, True),
}
"""Per verdict: whether effects are missing, and whether an unknown cause is."""


@dataclass(frozen=True, eq=False)
class Decision:
    """What is missing, before it is put into words."""

    verdict: Verdict
    probability: Mapping[Verdict, float]
    lack_of_fit: LackOfFit  # Of the model before anything is added
    # Whether the model misses the readings by more than noise, but as the table that it was fitted to
    own_misfit: bool
    times_own: float  # Its misfit beyond noise over that to its table; infinite where that is none
    posterior: Posterior
    probability_of_chosen: float = 0.0  # Of exactly the effects that are named
    left_after: LackOfFit | None = None  # The lack of fit with what is named
    chosen: Explanation | None = None
    classes: tuple[tuple[str, ...], ...] = ()  # Per named effect, what cannot be told from it, itself first
    # The same of what is of a usual size and as likely, by odds of up to three; the simplest first
    ties: tuple[tuple[str, ...], ...] = ()
    # All that these data leave, what was named first: as probable as the members of a class
    left: tuple[Explanation, ...] = ()

    @property
    def refitted(self) -> tuple[Explanation, ...]:
        """Every explanation that was refitted, the most probable first."""
        fits = [one for one in self.posterior.explanations.values() if one.fit is not None]
        return tuple(ranked(fits, lambda one: one.log_evidence, ROUNDING))


def lack_of_fit(campaign: Campaign) -> LackOfFit:
    """The lack of fit before anything is added."""
    return campaign.patterns.test(campaign.whitened_residual)


def times_own(campaign: Campaign) -> float:
    """The model's misfit beyond noise over that to its table; infinite where that is none."""
    known = campaign.known_misfit
    return float(np.sqrt(campaign.misfit_as_recorded / known)) if known > 0.0 else np.inf


def fails_surely(campaign: Campaign) -> bool:
    """Whether something is missing, whatever a search for its name would find."""
    return most_of_nothing(campaign) <= NOTHING_MISSING and not _as_its_own(campaign)


def decide(campaign: Campaign) -> Decision:
    """Name what is missing, or say that nothing or nothing known is."""
    posterior = explain(campaign)
    probability = {word: posterior.of(effects=e, unknown=u) for word, (e, u) in _KINDS.items()}
    if probability["nothing_missing"] > NOTHING_MISSING:
        verdict: Verdict = "nothing_missing"
    else:
        verdict = max((word for word in _KINDS if word != "nothing_missing"), key=lambda word: probability[word])
    unknown = _KINDS[verdict][1]
    test, times = lack_of_fit(campaign), times_own(campaign)
    chosen, after, near, tie = None, None, list[frozenset[str]](), list[frozenset[str]]()
    if _KINDS[verdict][0]:
        near = _near(posterior, unknown)
        tie = _tied(campaign, posterior, near, unknown)
        near = [*tie[:1], *(names for names in near if names != tie[0])]
        chosen = posterior.explanations[near[0]]
        if chosen.fit is not None:
            after = campaign.patterns.test(chosen.fit.whitened_residual, chosen.fit.jacobian[:, ~chosen.fit.active])
            verdict = "form_insufficient" if after.p_value <= LEVEL_AFTER else verdict
    if verdict == "form_insufficient" and not _explains_most(campaign, chosen):
        verdict, chosen, after = "unexplained", None, None
    if verdict in {"unexplained", "form_insufficient"} and _as_its_own(campaign):
        return Decision("nothing_missing", probability, test, True, times, posterior)
    own = verdict == "nothing_missing" and _beyond_noise(campaign)
    if chosen is None:
        return Decision(verdict, probability, test, own, times, posterior)
    return Decision(
        verdict,
        probability,
        test,
        own,
        times,
        posterior,
        posterior.probability[near[0], unknown],
        after,
        chosen,
        tuple((name, *_exchanged(name, near)) for name in chosen.names),
        tuple((name, *_exchanged(name, tie)) for name in chosen.names),
        tuple(posterior.explanations[names] for names in near if posterior.explanations[names].fit is not None),
    )


def _explains_most(campaign: Campaign, chosen: Explanation | None) -> bool:
    """Whether effects of another form than the readings explain most of the squared misfit, and spoil nothing.

    Where no explanation fits, the best of them is still no explanation; nor is one that makes a channel worse, or one
    whose size is as unlikely as its form.
    """
    before = float(np.sum(campaign.whitened_residual**2)) - len(campaign.whitened_residual)
    fit = chosen.fit if chosen else None
    if fit is None or fit.chi2 - len(fit.whitened_residual) >= (1.0 - EXPLAINED) * before:
        return False
    return _plausible(fit) and not _spoils(campaign, fit)


def _spoils(campaign: Campaign, fit: Refit) -> bool:
    """Whether effects make a channel worse."""
    observations = campaign.observations
    left = observations.value - observations.predict(fit.effects)
    for c, sigma in enumerate(campaign.noise.sigma):
        here = observations.channel == c
        was, now = (np.sqrt(np.mean(one[here] ** 2)) for one in (observations.residual, left))
        if now > WITHIN_NOISE * max(was, sigma):
            return True
    return False


def dominant(
    campaign: Campaign, decision: Decision, scores: Sequence[ScoredEffect], excess: float
) -> tuple[tuple[Refit, ...], float]:
    """Single effects that explain most of a misfit that none explains in all, and what part of it; none where none do.

    However large they are, but not at the end of their range, and without making a channel worse. The first leaves the
    least, or supposes least of those that leave hardly more. The part is that of runs left out.
    """
    if decision.verdict != "unexplained":
        return (), 0.0
    fits = [fit for fit in _leading(campaign, decision, scores) if not at_bounds(fit) and not _spoils(campaign, fit)]
    fits = _alike(fits, [fit.chi2 - len(fit.whitened_residual) for fit in fits])
    fits.sort(key=_supposes)
    part = explained_share(campaign, fits[0], excess) if fits else 0.0
    return (tuple(fits), part) if part >= DOMINANT else ((), 0.0)


def _leading(campaign: Campaign, decision: Decision, scores: Sequence[ScoredEffect]) -> list[Refit]:
    """The effects that alone leave the least to first order, refitted: the search takes none up for its size alone."""
    before = float(np.sum(campaign.whitened_residual**2)) - len(campaign.whitened_residual)
    tested = ranked([one for one in scores if not one.note], lambda one: one.chi2_fall, ROUNDING)
    best = _alike(tested, [before - one.chi2_fall for one in tested])[:RIVALS_REFITTED]
    known = {one.names: one.fit for one in decision.refitted if one.fit}
    effects = {one.name: one.columns.effect for one in campaign.effects}
    given = campaign.observations, campaign.whitening
    return [known.get((one.name,)) or refit(*given, starting_point(*given, [effects[one.name]])) for one in best]


def _alike(items: Sequence[Item], above_noise: Sequence[float]) -> list[Item]:
    """The items that leave hardly more squared misfit above the noise than the best."""
    most = RIVALS * max(min(above_noise, default=0.0), 1.0)
    return [one for one, left in zip(items, above_noise, strict=True) if left <= most]


def _supposes(fit: Refit) -> tuple[bool, int]:
    """Plausible sizes before unusual ones, then the fewest parameters that the fit moved."""
    return not _plausible(fit), int(np.count_nonzero(~fit.active))


def _plausible(fit: Refit) -> bool:
    """Whether every parameter may be as large as it usually is."""
    return all(is_plausible(added, p) for added in fit.effects for p in added.effect.parameters)


def _near(posterior: Posterior, unknown: bool) -> list[frozenset[str]]:
    """The sets of effects that a class may hold, the most probable first; of equal ones the commonest first."""
    order = {name: k for k, name in enumerate(posterior.space.variants)}
    likely = {names: p for (names, beside), p in posterior.probability.items() if names and beside == unknown}
    least = IN_CLASS * max(likely.values())
    sets = [names for names, p in likely.items() if p >= least]
    sets.sort(key=lambda names: sorted(order[name] for name in names))
    return ranked(sets, lambda names: float(np.log(likely[names] + 1e-300)), ROUNDING)


def _tied(campaign: Campaign, posterior: Posterior, near: list[frozenset[str]], unknown: bool) -> list[frozenset[str]]:
    """The sets that are as probable as the best of a usual size, that with the fewest moved parameters first.

    Of sets that exchange one effect of the best. The evidence lets an effect be as large as half of its plausible range
    at one standard deviation, so that it hardly counts against a number of the drawing to be off by four tolerances;
    what is beyond its plausible range stands first only where nothing of a usual size leaves as little of the readings.
    """
    best = near[0]
    exchanged = [names for names in near if len(names) == len(best) and len(names - best) <= 1]
    fits = {names: fit for names in exchanged if (fit := posterior.explanations[names].fit)}
    left = {names: _mean_square_left(campaign, fit) for names, fit in fits.items()}
    most = RIVALS * max(min(left.values(), default=1.0), 1.0)  # what is granted to mounts is no reason for a name
    as_good = [names for names in fits if left[names] <= most]
    usual = [names for names in as_good if _plausible(fits[names])] or as_good or near[:1]
    least = TIED * max(posterior.probability[names, unknown] for names in usual)
    alike = [names for names in usual if posterior.probability[names, unknown] >= least]
    return sorted(alike, key=lambda names: np.count_nonzero(~fits[names].active) if names in fits else 0)


def _mean_square_left(campaign: Campaign, fit: Refit) -> float:
    """Mean square of what effects leave of the readings, in the noise of one reading of each channel."""
    observations = campaign.observations
    left = observations.value - observations.predict(fit.effects)
    return float(np.mean((left / campaign.noise.sigma[observations.channel]) ** 2))


def _exchanged(name: str, near: list[frozenset[str]]) -> list[str]:
    """What may stand for one of the named effects, the others the same; the most probable first."""
    rest = near[0] - {name}
    return [next(iter(s - rest)) for s in near[1:] if len(s) == len(near[0]) and rest <= s]


def _as_its_own(campaign: Campaign) -> bool:
    """Whether no channel is missed by more than noise and twice its own table's misfit, and that is more than noise."""
    observations, noise, beyond = campaign.observations, campaign.noise, False
    for c, sigma in enumerate(noise.sigma):
        here = observations.channel == c
        missed = np.mean(observations.residual[here] ** 2)
        uncertain = sigma**2 * BEYOND_NOISE * np.sqrt(2.0 / np.count_nonzero(here))
        put_back = np.mean((observations.distance_slope[here] * noise.mount_m) ** 2)
        own = OWN_MISFIT**2 * np.mean(observations.own_misfit[here] ** 2)
        # Where mounts make more than the own misfit, a misfit that they could make is no sign of it
        if missed > sigma**2 + uncertain + own + min(own, put_back):
            return False
        beyond = beyond or bool(missed > sigma**2 and own > uncertain)
    return beyond


def _beyond_noise(campaign: Campaign) -> bool:
    """Whether the model misses the readings by more than noise alone."""
    if campaign.whitening.misfit is None:
        return False
    alone = campaign.without_own_misfit
    test = pattern_space(campaign.observations, alone).test(alone.full(campaign.observations.residual))
    return test.p_value <= LEVEL
