"""Decides what is missing from how probable every explanation is, and how far the name can be trusted.

What is missing is nothing, known effects, an unknown cause, or both. Whether a campaign distinguishes a named effect
from one outside of the catalogue cannot be tested with the catalogue's own effects as rivals. They serve as examples of
what physics does to these readings: had one of them been the cause, as large as what was named, and not been listed,
would an unknown cause have been preferred to the name? What adds the same to every reading of a channel has more causes
than any list holds, so that a constant error of each channel is always among the examples.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from femfit.core.numerics import ROUNDING as NUMERIC
from femfit.core.numerics import ranked
from femfit.identify.constants import (
    BEYOND_NOISE,
    EXPLAINED,
    IN_CLASS,
    LEVEL,
    LEVEL_AFTER,
    NOTHING_MISSING,
    NOTICED,
    OWN_MISFIT,
    RIVALS,
    ROUNDING,
    TIED,
    WITHIN_NOISE,
)
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.evidence import Linear, odds_of_unknown
from femfit.identify.decision.search import Explanation, Posterior, explain, most_of_nothing
from femfit.identify.lack_of_fit import LackOfFit, pattern_space
from femfit.identify.refit import Refit, plausible
from femfit.tables.measurement import channel_words

Verdict = Literal["nothing_missing", "named", "form_insufficient", "unexplained", "compare_only"]

_KINDS: Mapping[Verdict, tuple[bool, bool]] = {
    "nothing_missing": (False, False),
    "named": (True, False),
    "form_insufficient": (True, True),
    "unexplained": (False, True),
}
"""Per verdict: whether effects are missing, and whether an unknown cause is."""


@dataclass(frozen=True, eq=False)
class Decision:
    """What is missing, before it is put into words; ``compare_only`` where that cannot be tested."""

    verdict: Verdict
    probability: Mapping[Verdict, float] = field(default_factory=dict)
    lack_of_fit_before: LackOfFit | None = None
    # Whether the model misses the readings by more than noise, but as the table that it was fitted to
    own_misfit: bool = False
    posterior: Posterior = field(default_factory=Posterior)
    probability_of_chosen: float = 0.0  # Of exactly the effects that are named
    lack_of_fit_after: LackOfFit | None = None  # With what is named
    chosen: Explanation | None = None
    classes: tuple[tuple[str, ...], ...] = ()  # Per named effect, what cannot be told from it, itself first
    # The same of what is of a usual size and as likely, by odds of up to three; the simplest first
    ties: tuple[tuple[str, ...], ...] = ()
    # All that these data leave, what was named first: as probable as the members of a class
    remaining: tuple[Explanation, ...] = ()

    @property
    def p_value(self) -> float:
        """Of the model's lack of fit, as in ``femfit compare``."""
        return self.lack_of_fit_before.p_value if self.lack_of_fit_before else 1.0

    @property
    def fit(self) -> Refit | None:
        """The refit of what is named."""
        return self.chosen.fit if self.chosen else None

    @property
    def fits(self) -> dict[tuple[str, ...], Refit]:
        """What was refitted, by the names of its effects, the most probable first."""
        refitted = [(each, each.fit) for each in self.posterior.explanations.values() if each.fit]
        return {each.names: fit for each, fit in ranked(refitted, lambda pair: pair[0].log_evidence, ROUNDING)}


def fails_surely(campaign: Campaign) -> bool:
    """Whether something is missing, whatever a search for its name would find."""
    return most_of_nothing(campaign) <= NOTHING_MISSING and not _as_its_own(campaign)


def decide(campaign: Campaign) -> Decision:
    """Name what is missing, or say that nothing or nothing known is."""
    posterior = explain(campaign)
    probability, verdicts = dict.fromkeys(_KINDS, 0.0), {kind: word for word, kind in _KINDS.items()}
    for (names, unknown), p in posterior.probability.items():
        probability[verdicts[bool(names), unknown]] += p
    verdict: Verdict = "nothing_missing"
    if probability[verdict] <= NOTHING_MISSING:
        verdict = max((word for word in _KINDS if word != verdict), key=lambda word: probability[word])
    test = campaign.patterns.test(campaign.whitening.residual)
    decision = Decision(verdict, probability, test, posterior=posterior)
    if _KINDS[verdict][0]:
        decision = _named(campaign, decision)
    as_its_own = _as_its_own(campaign)
    explained = decision.verdict == "named" and (decision.fit is None or _explains_most(campaign, decision.fit))
    if as_its_own and decision.verdict != "nothing_missing" and not explained:
        return Decision("nothing_missing", probability, test, own_misfit=True, posterior=posterior)
    if as_its_own and decision.verdict == "nothing_missing":  # is it more than noise that the own misfit explains?
        alone = replace(campaign.whitening, misfit=None)
        return replace(decision, own_misfit=pattern_space(alone).test(alone.residual).p_value <= LEVEL)
    return decision


def _named(campaign: Campaign, decision: Decision) -> Decision:
    """With the most probable set of effects, and what else the data leave; without where that explains nothing."""
    posterior, unknown = decision.posterior, _KINDS[decision.verdict][1]
    # The sets of effects that a class may hold, the most probable first; of equal ones the commonest first
    order = {name: k for k, name in enumerate(campaign.variants)}
    likely = {names: p for (names, beside), p in posterior.probability.items() if names and beside == unknown}
    likely = {names: p for names, p in likely.items() if not has_idle(posterior, names)}
    near = [names for names, p in likely.items() if p >= IN_CLASS * max(likely.values())]
    near.sort(key=lambda names: sorted(order[name] for name in names))
    near = ranked(near, lambda names: float(np.log(likely[names] + 1e-300)), ROUNDING)
    tie = _tied(campaign, posterior, near, unknown)
    near = [*tie[:1], *(names for names in near if names != tie[0])]
    chosen = posterior.explanations[near[0]]
    verdict, fit, after = decision.verdict, chosen.fit, None
    if fit is not None:
        after = campaign.patterns.test(fit.whitened_residual, fit.jacobian[:, ~fit.active])
        verdict = "form_insufficient" if after.p_value <= LEVEL_AFTER else verdict
    if verdict == "form_insufficient" and not (fit and _explains_most(campaign, fit)):
        return replace(decision, verdict="unexplained")
    missed = campaign.observations.mean_square(campaign.observations.residual) / campaign.noise.sigma**2
    if fit and not all(map(plausible, fit.effects)) and np.all(missed <= WITHIN_NOISE**2):
        return replace(decision, verdict="nothing_missing")  # a size beyond its range explains noise by itself
    return replace(
        decision,
        verdict=verdict,
        probability_of_chosen=posterior.probability[near[0], unknown],
        lack_of_fit_after=after,
        chosen=chosen,
        classes=tuple((name, *_exchanged(name, near)) for name in chosen.names),
        ties=tuple((name, *_exchanged(name, tie)) for name in chosen.names),
        remaining=tuple(each for names in near if (each := posterior.explanations[names]).fit is not None),
    )


def _explains_most(campaign: Campaign, fit: Refit) -> bool:
    """Whether effects explain most of the squared misfit beyond noise alone, and spoil nothing.

    That is asked of those of another form than the readings, and where a model misses these no more than its own table.

    Where no explanation fits, the best of them is still no explanation; nor is one that makes a channel worse, or one
    whose size is as unlikely as its form.
    """
    observations, noise = campaign.observations, replace(campaign.whitening, misfit=None)
    misfits = observations.residual, observations.value - observations.predict(fit.effects)
    before, after = (float(np.sum(noise.full(misfit) ** 2)) for misfit in misfits)
    if not before - after > EXPLAINED * (before - len(misfits[0])) > 0.0 or not all(map(plausible, fit.effects)):
        return False
    was, now = (np.sqrt(observations.mean_square(misfit)) for misfit in misfits)
    return bool(np.all(now <= WITHIN_NOISE * np.maximum(was, campaign.noise.sigma)))


def _tied(campaign: Campaign, posterior: Posterior, near: list[frozenset[str]], unknown: bool) -> list[frozenset[str]]:
    """The sets that are as probable as the best of a usual size, that with the fewest moved parameters first.

    Of sets that exchange one effect of the best. The evidence lets an effect be as large as half of its plausible range
    at one standard deviation, so that it hardly counts against a number of the drawing to be off by four tolerances;
    what is beyond its plausible range stands first only where nothing of a usual size leaves as little of the readings.
    """
    best = near[0]
    exchanged = [names for names in near if len(names) == len(best) and len(names - best) <= 1]
    fits = {names: fit for names in exchanged if (fit := posterior.explanations[names].fit)}
    squares, observations = {}, campaign.observations
    sigma = campaign.noise.sigma[observations.channel]
    for names, fit in fits.items():  # mean square in the noise of one reading of each channel
        squares[names] = float(np.mean(((observations.value - observations.predict(fit.effects)) / sigma) ** 2))
    most = RIVALS * max(min(squares.values(), default=1.0), 1.0)  # what is granted to mounts is no reason for a name
    as_good = [names for names in fits if squares[names] <= most]
    usual = [names for names in as_good if all(map(plausible, fits[names].effects))] or as_good or near[:1]
    least = TIED * max(posterior.probability[names, unknown] for names in usual)
    alike = [names for names in usual if posterior.probability[names, unknown] >= least]
    return sorted(alike, key=lambda names: np.count_nonzero(~fits[names].active) if names in fits else 0)


def has_idle(posterior: Posterior, names: frozenset[str]) -> bool:
    """Whether some effects of a set leave as little as all of it, but for what noise gives a parameter on average.

    Of two that change the readings alike the evidence prefers both to one of twice the size, which is less usual.
    """
    every = posterior.explanations[names].fit
    if every is None:
        return False
    fewer = [some.fit for subset, some in posterior.explanations.items() if subset < names and some.fit]
    parameters = np.count_nonzero(~every.active)
    return any(fit.chi2 - every.chi2 <= parameters - np.count_nonzero(~fit.active) for fit in fewer)


def _exchanged(name: str, near: list[frozenset[str]]) -> list[str]:
    """What may stand for one of the named effects, the others the same; the most probable first."""
    rest = near[0] - {name}
    return [next(iter(s - rest)) for s in near[1:] if len(s) == len(near[0]) and rest <= s]


def _as_its_own(campaign: Campaign) -> bool:
    """Whether no channel is missed by more than noise and twice its own table's misfit, and that is more than noise."""
    observations, noise = campaign.observations, campaign.noise
    missed, variance = observations.mean_square(observations.residual), noise.sigma**2
    uncertain = variance * BEYOND_NOISE * np.sqrt(2.0 / np.bincount(observations.channel))
    put_back = observations.mean_square(observations.distance_slope * noise.mount_m)
    misfit = OWN_MISFIT**2 * observations.mean_square(observations.tolerance)
    # Where mounts make more than the own misfit, a misfit that they could make is no sign of it
    if np.any(missed > variance + uncertain + misfit + np.minimum(misfit, put_back)):
        return False
    return bool(np.any((missed > variance) & (misfit > uncertain)))


def look_alikes(campaign: Campaign, decision: Decision) -> tuple[str, ...]:
    """Effects that would have been given the chosen names on these data, had they been the cause and not been listed.

    First the others of the classes, then those of further explanations that the data leave, then of improbable ones
    that leave no more of the readings by no more effects, then examples, the most alike first.
    """
    chosen = decision.chosen
    if chosen is None or chosen.fit is None or chosen.linear is None:
        return ()
    rivals = [name for members in decision.classes for name in members[1:]]
    rivals += [n for each in decision.remaining if not set(chosen.names) <= set(each.names) for n in each.names]
    as_near = (names for names, fit in decision.fits.items() if fit.chi2 <= chosen.fit.chi2)
    rivals += [n for names in as_near if len(names) <= len(chosen.names) for n in names]
    examples = ranked(list(_noticed(campaign, chosen.fit, chosen.linear).items()), lambda pair: -pair[1], NUMERIC)
    rivals += [name for name, odds in examples if odds < NOTICED]
    return tuple(name for name in dict.fromkeys(rivals) if name not in chosen.names)


def _noticed(campaign: Campaign, fit: Refit, linear: Linear) -> dict[str, float]:
    """Per example, the log odds of an unknown cause beside what is named had it been the cause of one of them."""
    observations = campaign.observations
    together, lengths = observations.predict(fit.effects), []
    for added in fit.effects:
        change = together - observations.predict([effect for effect in fit.effects if effect is not added])
        lengths.append(float(np.linalg.norm(campaign.whitening.full(change))))
    blocks = [block for name, variants in campaign.variants.items() if name not in fit.names for block in variants]
    names = [block.start.name for block in blocks for _ in block.amplitudes.T]
    names += [f"a constant error of the {channel_words(name)}" for name in observations.channels]
    constants = (observations.channel[:, None] == np.arange(len(observations.channels))).astype(np.float64)
    columns = np.concatenate([*(block.amplitudes for block in blocks), campaign.whitening.full(constants)], axis=1)
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.maximum(size, 1e-300)
    # Of an effect the whole of its plausible range
    longest = np.where(np.arange(len(names)) < len(names) - constants.shape[1], 2.0 * size, np.inf)
    result: dict[str, float] = {}
    of_columns, of_unknown = linear.beside(columns), linear.beside(campaign.unknown.columns)
    gram = campaign.unknown.gram - of_unknown.T @ of_unknown
    along = campaign.unknown.columns.T @ columns - of_unknown.T @ of_columns
    unexplained = np.maximum(1.0 - np.sum(of_columns**2, axis=0), 0.0)
    for length in lengths:  # readings that are noise of its usual length and so much of an example
        square = len(columns) + length**2 * unexplained
        every = odds_of_unknown(campaign, linear.density, gram, length * along, square)
        for name, most, odds in zip(names, longest, every, strict=True):
            if most >= length:
                result[name] = min(result.get(name, np.inf), float(odds))
    return result
