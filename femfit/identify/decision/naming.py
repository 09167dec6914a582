"""Decides what is missing: test the model, score and refit the effects, form the class of what cannot be told apart.

The decision uses three numbers of a candidate: its weighted sum of squares, the share of the structured excess over the
noise that it explains, and whether the lack-of-fit test passes after it. A name is given only where that test passes
(``named``) or where next to nothing of the excess is left (``form_insufficient``): a greedy choice without the test
would name some known effect for every unknown one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.ties import ranked
from femfit.identify.constants import (
    AHEAD,
    CONTINUED,
    ELSEWHERE_SHARE,
    ENOUGH,
    ENOUGH_OF_TWO,
    FAR_AHEAD,
    LEAST_SECOND_SHARE,
    LEAST_SHARE,
    LEVEL_AFTER,
    MOST,
    MUCH,
    OPPOSED,
    PAIRED,
    REFITTED,
    REMAINDER_SHARE,
    ROUNDING,
    TIE,
)
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.candidate import Candidate, forward_pairs, refitted_candidates
from femfit.identify.decision.diagnosis import Verdict
from femfit.identify.decision.model_test import ModelTest, judge_model
from femfit.identify.decision.scoring import best_pairs
from femfit.identify.refit.start import Start


@dataclass(frozen=True, eq=False)
class Decision:
    """What is missing, before it is put into words."""

    verdict: Verdict
    test: ModelTest  # The test of the model before anything is added
    chosen: Candidate | None = None
    classes: tuple[tuple[str, ...], ...] = ()  # Per named effect, what cannot be told from it, itself first
    candidates: tuple[Candidate, ...] = ()  # All that were refitted, the cheapest first

    @property
    def excess(self) -> float:
        """Squared length of the model's whitened residual beyond what noise gives."""
        return self.test.excess


def decide(campaign: Campaign) -> Decision:
    """Name what is missing, or say that nothing or nothing known is."""
    test = judge_model(campaign)
    return _search(campaign, test) if test.outcome == "fails" else Decision("nothing_missing", test)


def _search(campaign: Campaign, test: ModelTest) -> Decision:
    """One effect if it passes, else two, else what explains most of the excess but not its form."""
    singles = refitted_candidates(campaign, [[item] for item in test.starts[:REFITTED]])
    chosen = _first_passing(campaign, singles, test.excess)
    if chosen is not None:
        return _named(campaign, "named", chosen, singles, test)
    starts = best_pairs(campaign.whitened_residual, test.starts, PAIRED, REFITTED // 2)
    starts += forward_pairs(singles, CONTINUED)
    pairs = refitted_candidates(campaign, _without_repeats(starts))
    pairs = [pair for pair in pairs if _both_needed(campaign, pair, singles, test.excess)]
    every = ranked([*singles, *pairs], lambda one: -one.cost, ROUNDING)
    chosen = _first_passing(campaign, pairs, test.excess)
    if chosen is not None and all(chosen.cost < one.cost for one in _explaining(singles, ENOUGH, test.excess)):
        return _named(campaign, "named", chosen, every, test)
    insufficient = _insufficient(campaign, singles, pairs, test.excess)
    if insufficient is not None:
        return _named(campaign, "form_insufficient", insufficient, every, test)
    return Decision("unexplained", test, candidates=tuple(every))


def _first_passing(campaign: Campaign, candidates: Sequence[Candidate], excess: float) -> Candidate | None:
    """The cheapest candidate after which the lack-of-fit test passes.

    Of those that the data cannot tell from it, the first one of usual size goes before one of unusual size.
    """
    passing = [c for c in candidates if c.passes() and c.excess <= (1.0 - LEAST_SHARE) * excess]
    if not passing:
        return None
    alike = [c for c in passing if c.cost - passing[0].cost <= tie(campaign, passing[0])]
    return next((c for c in alike if c.plausible), passing[0])


def _explaining(candidates: Sequence[Candidate], share: float, excess: float) -> list[Candidate]:
    """Those that explain so much, cheapest first."""
    return [one for one in candidates if one.excess <= (1.0 - share) * excess]


def _without_repeats(starts: Sequence[list[Start]]) -> list[list[Start]]:
    """One starting point for each pair of names, the later one: it begins at a refit."""
    return list({frozenset(item.name for item in start): start for start in starts}.values())


def _insufficient(
    campaign: Campaign, singles: Sequence[Candidate], pairs: Sequence[Candidate], excess: float
) -> Candidate | None:
    """What explains most of the excess but not its exact form: one effect before two."""
    leading = _explaining(singles, ENOUGH, excess)
    if not leading:
        together = _explaining(pairs, ENOUGH_OF_TWO, excess)
        if together:
            return together[0]
        if not _stands_alone(singles, excess):
            return None
        leading = list(singles[:1])
    first = leading[0]
    for pair in (pair for pair in pairs if first.fit.names[0] in pair.fit.names):
        if pair.excess <= (1.0 - REMAINDER_SHARE) * first.excess or _acts_elsewhere(campaign, pair, first):
            return pair
    return first


def _stands_alone(singles: Sequence[Candidate], excess: float) -> bool:
    """Whether one effect explains most of the excess and no other comes near it."""
    if len(singles) < 2:
        return False
    left = [max(one.excess, 0.0) / excess for one in singles[:2]]
    most, ahead = (MOST, AHEAD) if singles[0].further > LEVEL_AFTER else (MUCH, FAR_AHEAD)
    return left[0] <= 1.0 - most and left[1] >= left[0] + ahead


def _both_needed(campaign: Campaign, pair: Candidate, singles: Sequence[Candidate], excess: float) -> bool:
    """Whether each of two effects explains a share that the other cannot, and does not undo what the other does."""
    first, second = (pair.fit.contribution(k) for k in range(2))
    if first @ second < OPPOSED * np.linalg.norm(first) * np.linalg.norm(second):
        return False
    alone = {one.fit.names[0]: one for one in singles}
    for name in pair.fit.names:
        if name in alone:
            fall = alone[name].fit.chi2 - pair.fit.chi2
            small = fall < LEAST_SECOND_SHARE * excess
            if fall < TIE or (small and not _acts_elsewhere(campaign, pair, alone[name])):
                return False
    return True


def _acts_elsewhere(campaign: Campaign, pair: Candidate, single: Candidate) -> bool:
    """Whether the second effect of a pair explains the misfit in channels that the first one leaves alone."""
    observations, sigma = campaign.observations, campaign.noise.sigma
    first = pair.fit.effects[pair.fit.names.index(single.fit.names[0])]
    change = (observations.predict((first,)) - observations.base) / sigma[observations.channel]
    alone = (np.bincount(observations.channel, change**2) < 1.0)[observations.channel]
    before, after = (float(np.sum(one.fit.whitened_residual[alone] ** 2)) for one in (single, pair))
    structured = before - np.count_nonzero(alone)
    return before - after >= max(TIE, ELSEWHERE_SHARE * structured)


def tie(campaign: Campaign, chosen: Candidate) -> float:
    """By how much a rival's sum of squares may be larger for the data not to tell it from what was chosen.

    What the chosen explanation itself leaves in the smooth patterns, of the model's misfit or of its own form, is noise
    to a difference between two explanations (the scatter's own size, as R. T. Birge, Physical Review 40 (1932) 207).
    """
    return float(TIE * (1.0 + max(chosen.excess, 0.0) / campaign.patterns.basis.shape[1]))


def _named(
    campaign: Campaign, verdict: Verdict, chosen: Candidate, rivals: Sequence[Candidate], test: ModelTest
) -> Decision:
    """The decision with the classes: rivals that the data cannot tell from it, with the other effect the same."""
    names, slack = chosen.fit.names, tie(campaign, chosen)
    classes = []
    for k in ranked(range(len(names)), lambda k: float(np.sum(chosen.fit.contribution(k) ** 2))):
        others, members = set(names) - {names[k]}, [names[k]]
        for rival in rivals:
            if len(rival.fit.names) != len(names):
                continue
            instead = set(rival.fit.names) - others
            if rival.cost - chosen.cost <= slack and others <= set(rival.fit.names) and len(instead) == 1:
                members += [name for name in instead if name not in members]
        classes.append(tuple(members))
    return Decision(verdict, test, chosen, tuple(classes), tuple(rivals))
