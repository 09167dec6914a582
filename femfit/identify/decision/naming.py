"""Decides what is missing: gate, score, refit the best few, form the class of what cannot be told apart, gate again.

The decision uses three numbers of a candidate: its weighted sum of squares, the part of the structured excess over the
noise that it explains, and whether the gate passes after it. A name is given only where the gate passes (``named``) or
where next to nothing of the excess is left (``form_insufficient``): a greedy choice without the gate would name some
known effect for every unknown one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.identify.decision.diagnosis import Gate, ScoredEffect, Verdict
from femfit.identify.decision.evidence import Evidence
from femfit.identify.decision.scoring import Scored, best_pairs, score_effects
from femfit.identify.signatures.candidate import Candidate, forward_pairs, refitted_candidates

_KNOWN_MISFIT = 4.0
"""A structured misfit up to twice (in amplitude) the model's own to its sweep is no missing physics."""


@dataclass(frozen=True)
class Levels:
    """Error rates and shares that the decision uses.

    Parameters
    ----------
    gate : float
        Probability that the first gate opens where nothing is missing.
    after : float
        Below this p-value the second gate finds structure left.
    enough, enough_of_two : float
        Part of the structured excess that one name, or two, must explain where the second gate does not pass.
    least : float
        Part that a name must explain at all, however well the second gate passes.
    most, ahead : float
        Part that one name must explain where no further effect adds anything, and by how much more than any other name.
    much, far_ahead : float
        The same where further effects add something.
    second : float
        Part that each of two effects must explain beyond the other.
    apart : float
        Part of the misfit in the channels that the other leaves alone that will do instead: there no form of the other
        stands for it.
    rest : float
        Part of what one effect leaves of the excess that a second one must explain to be named beside it where the
        second gate does not pass.
    against : float
        Cosine between the traces of two effects below which the one only mends the other's form.
    tie, tie_share : float
        Two effects are not told apart where the weighted sums of squares with them differ by less than ``tie``, or by
        less than ``tie_share`` of what the better one explains, or of all that is explained where no form is exact.
    refitted, paired, continued : int
        How many of the best single effects are refitted, how many are tried in pairs with every other to first order,
        and how many refitted ones are continued by how many others.
    """

    gate: float = 0.01
    after: float = 0.005
    enough: float = 0.97
    enough_of_two: float = 0.98
    least: float = 0.35
    most: float = 0.7
    ahead: float = 0.3
    much: float = 0.6
    far_ahead: float = 0.5
    second: float = 0.01
    apart: float = 0.5
    rest: float = 0.9
    against: float = -0.75
    tie: float = 9.0
    tie_share: float = 0.01
    refitted: int = 8
    paired: int = 8
    continued: int = 3


@dataclass(frozen=True, eq=False)
class Decision:
    """What is missing, before it is put into words.

    Parameters
    ----------
    verdict : str
        As in :class:`femfit.identify.decision.diagnosis.Diagnosis`.
    classes : tuple of tuple of str
        Per named effect, what cannot be told from it, itself first.
    """

    verdict: Verdict
    chosen: Candidate | None
    classes: tuple[tuple[str, ...], ...]
    before: Gate
    excess: float
    scores: tuple[ScoredEffect, ...]
    candidates: tuple[Candidate, ...]


def decide(evidence: Evidence, levels: Levels) -> Decision:
    """Name what is missing, or say that nothing or nothing known is."""
    rest = evidence.rest
    before, excess = evidence.patterns.test(rest), evidence.patterns.excess(rest)
    scores, best = score_effects(evidence, rest)
    # What the gate cannot see of an effect between its patterns counts as well
    excess = max(excess, max((s.chi2_fall - s.degrees_of_freedom for s in scores), default=0.0))
    smallest = min((s.p_value for s in scores), default=1.0) * max(len(best), 1)
    if min(before.p_value, smallest) > 0.5 * levels.gate or excess < _KNOWN_MISFIT * evidence.known_misfit:
        return Decision("nothing_missing", None, (), before, excess, scores, ())
    singles = refitted_candidates(evidence, [[item] for item in best[: levels.refitted]])
    chosen = _first_passing(singles, levels, excess)
    if chosen is not None:
        return _named("named", chosen, singles, levels, before, excess, scores)
    starts = best_pairs(rest, best, levels.paired, levels.refitted // 2)
    starts += forward_pairs(singles, levels.continued, levels.continued)
    pairs = refitted_candidates(evidence, _without_repeats(starts))
    pairs = [pair for pair in pairs if _both_needed(evidence, pair, singles, levels, excess)]
    chosen = _first_passing(pairs, levels, excess)
    if chosen is not None and all(chosen.cost < one.cost for one in _explaining(singles, levels.enough, excess)):
        return _named("named", chosen, pairs, levels, before, excess, scores)
    found = _insufficient(evidence, singles, pairs, levels, excess)
    if found is not None:
        return _named("form_insufficient", *found, levels, before, excess, scores)
    return Decision("unexplained", None, (), before, excess, scores, tuple(sorted(singles + pairs, key=_cost)))


def _insufficient(
    evidence: Evidence, singles: Sequence[Candidate], pairs: Sequence[Candidate], levels: Levels, excess: float
) -> tuple[Candidate, Sequence[Candidate]] | None:
    """What explains most of the excess but not its exact form, with its rivals: one effect before two."""
    leading = _explaining(singles, levels.enough, excess)
    if not leading:
        together = _explaining(pairs, levels.enough_of_two, excess)
        if together:
            return together[0], pairs
        if not _stands_alone(singles, levels, excess):
            return None
        leading = list(singles[:1])
    name = leading[0].fit.names[0]
    for pair in pairs:
        if name in pair.fit.names and (
            pair.excess <= (1.0 - levels.rest) * leading[0].excess or _stands_apart(evidence, pair, leading[0], levels)
        ):
            return pair, pairs
    return leading[0], singles


def _explaining(candidates: Sequence[Candidate], share: float, excess: float) -> list[Candidate]:
    """Those that explain so much, cheapest first."""
    return [one for one in candidates if one.excess <= (1.0 - share) * excess]


def _cost(candidate: Candidate) -> float:
    return candidate.cost


def _stands_alone(singles: Sequence[Candidate], levels: Levels, excess: float) -> bool:
    """Whether one effect explains most of the excess and no other comes near it."""
    if len(singles) < 2:
        return False
    left = [max(one.excess, 0.0) / excess for one in singles[:2]]
    complete = singles[0].further > levels.after
    most, ahead = (levels.most, levels.ahead) if complete else (levels.much, levels.far_ahead)
    return left[0] <= 1.0 - most and left[1] >= left[0] + ahead


def _without_repeats(starts: Sequence[list[Scored]]) -> list[list[Scored]]:
    """One starting point for each pair of names, the later one: it begins at a refit."""
    return list({frozenset(item[0].effect.name for item in start): start for start in starts}.values())


def _first_passing(candidates: Sequence[Candidate], levels: Levels, excess: float) -> Candidate | None:
    """The cheapest candidate after which the gate passes."""
    passing = [c for c in candidates if c.passes(levels.after) and c.excess <= (1.0 - levels.least) * excess]
    return min(passing, key=_cost) if passing else None


def _both_needed(
    evidence: Evidence, pair: Candidate, singles: Sequence[Candidate], levels: Levels, excess: float
) -> bool:
    """Whether each of two effects explains a share that the other cannot, and does not undo what the other does."""
    first, second = (pair.fit.trace(k) for k in range(2))
    if first @ second < levels.against * np.linalg.norm(first) * np.linalg.norm(second):
        return False
    alone = {one.fit.names[0]: one for one in singles}
    for name in pair.fit.names:
        if name in alone:
            fall = alone[name].fit.chi2 - pair.fit.chi2
            small = fall < levels.second * excess
            if fall < levels.tie or (small and not _stands_apart(evidence, pair, alone[name], levels)):
                return False
    return True


def _stands_apart(evidence: Evidence, pair: Candidate, single: Candidate, levels: Levels) -> bool:
    """Whether the second effect of a pair explains the misfit in channels that the first one leaves alone."""
    observations, sigma = evidence.observations, evidence.noise.sigma
    first = pair.fit.effects[pair.fit.names.index(single.fit.names[0])]
    change = (observations.predict((first,)) - observations.base) / sigma[observations.channel]
    alone = (np.bincount(observations.channel, change**2) < 1.0)[observations.channel]
    before, after = (float(np.sum(one.fit.rest[alone] ** 2)) for one in (single, pair))
    structured = before - np.count_nonzero(alone)
    return before - after >= max(levels.tie, levels.apart * structured)


def _named(
    verdict: Verdict,
    chosen: Candidate,
    rivals: Sequence[Candidate],
    levels: Levels,
    before: Gate,
    excess: float,
    scores: tuple[ScoredEffect, ...],
) -> Decision:
    """The decision with the classes: rivals whose misfit is hardly larger, with the other effect the same.

    Where the form is insufficient, that of the larger effect may as well decide between rivals of the smaller one.
    """
    explained = [min(float(np.sum(chosen.fit.trace(k) ** 2)), excess) for k in range(len(chosen.fit.names))]
    shared = [excess] * len(explained) if verdict == "form_insufficient" else explained
    classes = []
    for k in np.argsort(explained, kind="stable")[::-1]:
        name, reach = chosen.fit.names[k], max(levels.tie, levels.tie_share * shared[k])
        others = set(chosen.fit.names) - {name}
        members = [name]
        for rival in rivals:
            rest = set(rival.fit.names) - others
            if rival.cost - chosen.cost <= reach and others <= set(rival.fit.names) and len(rest) == 1:
                members += [n for n in rest if n not in members]
        classes.append(tuple(members))
    return Decision(verdict, chosen, tuple(classes), before, excess, scores, tuple(rivals))
