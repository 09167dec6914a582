"""Searches the explanations that count: sets of effects, refitted best first, with and without an unknown cause.

From each explanation the search goes on to first order: by one more effect, throughout or in some runs, or by a pair.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, count
from operator import attrgetter, itemgetter

import numpy as np
from scipy import special

from femfit.core.numerics import FloatArray
from femfit.identify.constants import EXPECTED_EFFECTS, FORM_SPREAD, IN_PART, LIKELIEST, UNKNOWN_CAUSE
from femfit.identify.decision.campaign import Campaign, EffectBlock
from femfit.identify.decision.evidence import SIZES, Linear, mean_of_logs, null, of_sizes, sizes_of, with_unknown_cause
from femfit.identify.refit import Refit, Start, refit

LOOKED_AT = 0.002
"""Numerical: an explanation is refitted where it may have this part of the probability: a fifth of a class's end."""

IN_VAIN = 3
"""Numerical: refits in a row that bring nothing after which no further effect is looked for beside an unknown cause."""

MOST_REFITS = 45
"""Numerical, for the time that it takes: explanations that are refitted; all others stand at first order."""

MOST_EFFECTS = 5
"""Numerical, for the time that it takes: effects of a set that is looked at; a refit of eight took half a minute."""

PAIRED = 12
"""Numerical: how many of the effects that fit best alone are tried in pairs from the start."""

Names = frozenset[str]
"""The effects of an explanation."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of effects; before it is refitted its evidence is what the readings say to first order."""

    starts: tuple[Start, ...]
    log_evidence: float
    without: float = -np.inf  # That of the refitted explanation that it has one effect, or two, more than
    fit: Refit | None = None
    linear: Linear | None = None  # Where it was refitted
    with_unknown: float = -np.inf  # Log evidence with an unknown cause beside

    @property
    def names(self) -> tuple[str, ...]:
        """The effects, in the order in which they were found."""
        return tuple(start.name for start in self.starts)

    @property
    def continued(self) -> tuple[Start, ...]:
        """Where its effects' refit ended, or begins."""
        return self.starts if self.fit is None else tuple(self.fit.restart)


def with_one_more(campaign: Campaign, base: Explanation, linear: Linear) -> list[Explanation]:
    """Every further effect beside refitted ones, to first order: its log evidence and where its refit begins."""
    if len(base.names) >= MOST_EFFECTS:
        return []
    begun, unknown = base.continued, base.with_unknown - base.log_evidence
    result = []
    for name, blocks in campaign.variants.items():
        if name in base.names:
            continue
        log, start = _averaged([_one_more(linear, block) for block in blocks])
        if in_part := [_one_more(linear, block) for block in campaign.in_some_runs.get(name, ())]:
            log_in_part, start_in_part = _averaged(in_part)
            log, log_in_part = log + np.log1p(-IN_PART), log_in_part + np.log(IN_PART)
            start = start_in_part if log_in_part > log else start
            log = float(np.logaddexp(log, log_in_part))
        # What adds something may stand in the unknown cause's place: its refit tells
        beside_unknown = log + unknown if log <= base.log_evidence else -np.inf
        result.append(Explanation((*begun, start), log, base.log_evidence, with_unknown=beside_unknown))
    return result


def _averaged(tries: Sequence[tuple[float, Start]]) -> tuple[float, Start]:
    """The mean of what log evidences are logarithms of, and the start of the largest."""
    return mean_of_logs([log for log, _ in tries]), max(tries, key=itemgetter(0))[1]


def _one_more(linear: Linear, block: EffectBlock) -> tuple[float, Start]:
    """Log evidence with one variant of an effect, of exact form or not, and where its amplitudes then are."""
    (gram, along), start = linear.products(block), block.start
    exact = _bounded(linear, start, gram[: start.count, : start.count], along[: start.count])
    if len(along) == start.count:
        return exact
    formed, share = _bounded(linear, start, gram, along), 1.0 / len(FORM_SPREAD)  # of exact forms among the spreads
    log = np.logaddexp(exact[0] + np.log(share), formed[0] + np.log1p(-share))
    return float(log), max(exact, formed, key=itemgetter(0))[1]


def _bounded(linear: Linear, effect: Start, gram: FloatArray, along: FloatArray) -> tuple[float, Start]:
    """Log evidence with an effect's columns, and where its amplitudes then are.

    What would leave its bounds is left out: a friction does not push.
    """
    (low, high), effects = effect.columns.bounds, slice(effect.count)
    moving = np.ones(len(along), dtype=bool)
    while moving[effects].any():
        amplitudes = gram[effects, effects][np.ix_(moving[effects], moving[effects])]
        sizes = sizes_of(float(np.sqrt(max(np.linalg.eigvalsh(amplitudes)[-1], 0.0))))
        logs, means = linear.with_more(gram[np.ix_(moving, moving)], along[moving], sizes)
        amplitude = np.zeros(len(along))
        amplitude[moving] = means[int(np.argmax(logs))]
        size = amplitude[effects] * effect.half_ranges
        wrong = ((size < low) & (low == 0.0)) | ((size > high) & (high == 0.0))
        if not wrong.any():
            return mean_of_logs(logs), replace(effect, amplitude=np.clip(size, low, high))
        moving[effects] &= ~wrong
    return -np.inf, effect


def pairs_of_two(campaign: Campaign, linear: Linear, alone: Sequence[Explanation]) -> list[Explanation]:
    """Pairs of which neither may look like much alone, to first order."""
    best = sorted(alone, key=attrgetter("log_evidence"), reverse=True)[:PAIRED]
    leading = [campaign.block(each.starts[0]) for each in best if np.isfinite(each.log_evidence)]
    sizes = [sizes_of(float(np.linalg.norm(block.amplitudes)))[::2] for block in leading]
    pairs = []
    for (first, own_sizes), (second, further_sizes) in combinations(zip(leading, sizes, strict=True), 2):
        about = [Linear.of(linear.target, size * first.columns, linear.density) for size in own_sizes]
        logs = np.array([beside.with_more(*beside.products(second), further_sizes)[0] for beside in about])
        j, k = np.unravel_index(np.argmax(logs), logs.shape)
        columns = np.hstack([own_sizes[j] * first.columns, further_sizes[k] * second.columns])
        # Not the least squares: at a bound, a direction that the readings leave open would keep a refit there
        means = np.split(Linear.of(linear.target, columns, linear.density).amplitudes, [first.columns.shape[1]])
        begun = []
        for block, mean, size in zip((first, second), means, (own_sizes[j], further_sizes[k]), strict=True):
            amplitude = size * mean[: block.start.count] * block.start.half_ranges
            begun.append(replace(block.start, amplitude=np.clip(amplitude, *block.start.columns.bounds)))
        pairs.append(Explanation(tuple(begun), float(np.max(logs)) - np.log(SIZES), linear.log_evidence))
    return sorted(pairs, key=attrgetter("log_evidence"), reverse=True)[:PAIRED]


@dataclass(frozen=True, eq=False)
class Posterior:
    """How probable every explanation is that was looked at."""

    explanations: Mapping[Names, Explanation] = field(default_factory=dict)
    # With an unknown cause beside, and without
    probability: Mapping[tuple[Names, bool], float] = field(default_factory=dict)
    ended: bool = False  # Whether sets were left to first order since so many had been refitted


def most_of_nothing(campaign: Campaign) -> float:
    """Probability that nothing is missing before any effect is looked at, an unknown cause alone beside it.

    It is an upper bound: every effect that is looked at takes probability from it.
    """
    start = null(campaign)
    odds = np.log(UNKNOWN_CAUSE) - np.log1p(-UNKNOWN_CAUSE)
    return float(special.expit(start.log_evidence - with_unknown_cause(campaign, start) - odds))


def explain(campaign: Campaign) -> Posterior:
    """Compare sets of effects: the most promising one is refitted, and what goes on from it joins the others."""
    search, in_vain = Search(campaign), 0
    for refits in count():
        logs = search.log_posterior()
        total = np.logaddexp.reduce(list(logs.values()))
        top = max((n for n, each in search.explanations.items() if each.linear), key=lambda names: logs[names, False])
        best = search.most_promising(logs, top, total + np.log(LOOKED_AT), deeper=in_vain < IN_VAIN)
        if best is None or refits == MOST_REFITS:
            break
        search.refit(best)
        in_vain = 0 if search.log_posterior()[best, False] > logs[top, False] else in_vain + 1
    probability = {key: float(np.exp(value - total)) for key, value in logs.items()}
    return Posterior(search.explanations, probability, best is not None or len(top) >= MOST_EFFECTS)


class Search:
    """Explanations that were looked at, and what each refit promised of those with one effect more."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign, self.nothing = campaign, null(campaign)
        prior = min(EXPECTED_EFFECTS / max(len(campaign.variants), 1), LIKELIEST)
        self.odds = float(np.log(prior) - np.log1p(-prior))
        self.explanations: dict[Names, Explanation] = {}
        self.promised: dict[Names, dict[Names, float]] = {}
        unknown = with_unknown_cause(campaign, self.nothing)
        start = Explanation((), self.nothing.log_evidence, np.inf, linear=self.nothing, with_unknown=unknown)
        alone = self._go_on(start, self.nothing)
        for pair in pairs_of_two(campaign, self.nothing, alone):
            self._propose(pair)
        # A large effect's own curvature may spoil what it promises to first order
        self.likeliest = frozenset(max(alone, key=attrgetter("log_evidence"), default=start).names)

    def _go_on(self, explanation: Explanation, linear: Linear) -> list[Explanation]:
        """Take up a refitted explanation, and what has one effect more."""
        extended, names = with_one_more(self.campaign, explanation, linear), frozenset(explanation.names)
        self.explanations[names] = explanation
        self.promised[names] = {frozenset(each.names): each.log_evidence for each in extended}
        for each in extended:
            self._propose(each)
        return extended

    def _propose(self, explanation: Explanation) -> None:
        """Take up a set of effects that is new, or begins better than before."""
        earlier = self.explanations.setdefault(frozenset(explanation.names), explanation)
        if earlier.linear is None and earlier.log_evidence < explanation.log_evidence:
            self.explanations[frozenset(explanation.names)] = explanation

    def log_posterior(self) -> dict[tuple[Names, bool], float]:
        """Log evidence and prior of every explanation, with an unknown cause beside and without."""
        result = {}
        for names, explanation in self.explanations.items():
            prior = len(names) * self.odds
            result[names, False] = explanation.log_evidence + prior + np.log1p(-UNKNOWN_CAUSE)
            result[names, True] = explanation.with_unknown + prior + np.log(UNKNOWN_CAUSE)
        return result

    def most_promising(
        self, logs: Mapping[tuple[Names, bool], float], top: Names, least: float, *, deeper: bool
    ) -> Names | None:
        """The set to be refitted next beside the most probable one; None where none may have the least probability.

        Beside an unknown cause the first of several effects looks like nothing: the most promising way is gone on with.
        """
        waiting = [names for names in self.explanations if self._waits(names) and self._adds(names)]
        best = max(waiting, key=lambda names: logs[names, False], default=None)
        if best is not None and (logs[best, False] >= least or (deeper and logs[best, False] > logs[top, False])):
            return best
        best = self._without_one(top)
        if best is None and logs[top, False] > least:
            best = self._as_promising(top, every=len(top) > 1 and logs[top, True] >= logs[top, False])
        if best is None and self._waits(self.likeliest) and logs[frozenset(), False] <= least:
            best = self.likeliest
        return best

    def _waits(self, names: Names) -> bool:
        """Whether a set was not refitted."""
        return names not in self.explanations or self.explanations[names].linear is None

    def _adds(self, names: Names) -> bool:
        """Whether a set is worth a refit: not where one more effect makes it no more probable to first order.

        What adds next to nothing is small, and for small effects first order is exact.
        """
        explanation = self.explanations[names]
        return explanation.log_evidence > explanation.without - (self.odds if len(names) > 1 else 0.0)

    def _without_one(self, top: Names) -> Names | None:
        """The most probable set without one of its effects, where its exchanges begin; None where all are known."""
        for dropped in self.explanations[top].names if len(top) > 1 else ():
            names = top - {dropped}
            if self._waits(names):
                starts = (start for start in self.explanations[top].continued if start.name != dropped)
                self.explanations[names] = Explanation(tuple(starts), -np.inf)
                return names
        return None

    def _as_promising(self, top: Names, *, every: bool) -> Names | None:
        """An exchange of one effect that promised as much, beside the same others, as the most probable set did.

        One that makes these others no more probable stands at first order, unless every one counts: beside an unknown
        cause that says little of it.
        """
        alike = [
            (log, names)
            for dropped in top
            for rest in (self.promised.get(top - {dropped}, {}),)
            for names, log in rest.items()
            if self._waits(names) and log > rest[top] + np.log(LOOKED_AT) and (every or self._adds(names))
        ]
        return max(alike, key=itemgetter(0))[1] if alike else None

    def refit(self, names: Names) -> None:
        """Refit an explanation, with the evidence of the linear model there, and go on from it."""
        campaign, starts = self.campaign, self.explanations[names].starts
        fit, observations = refit(campaign.whitening, starts), campaign.observations
        value = np.array([(fit.effects[k].parameters[p.name] - p.null) / (0.5 * p.width) for k, p in fit.free])
        moving = ~(fit.active & (np.abs(value) < 1e-9))
        free = [pair for pair, moves in zip(fit.free, moving, strict=True) if moves]
        if {k for k, p in free if not p.nonlinear and not p.beside} != set(range(len(fit.effects))):
            # An effect of size zero explains nothing
            self.explanations[names] = Explanation(starts, -np.inf, linear=self.nothing)
            return
        families: dict[tuple[int, str], list[int]] = {}  # amplitudes that share a size, each with those beside it
        for j, (k, p) in enumerate(free):
            if not p.nonlinear:
                families.setdefault((k, p.beside or p.name), []).append(j)
        slopes = -0.5 * fit.jacobian[:, moving]
        errors = [campaign.form_error(a.effect, observations.predict([a]) - observations.base) for a in fit.effects]
        columns = np.concatenate([slopes, *errors], axis=1)
        linear = of_sizes(
            fit.whitened_residual + slopes @ value[moving],
            columns,
            [np.array(family) for family in families.values()],
            np.arange(slopes.shape[1], columns.shape[1]),
            self.nothing.density,
        )
        unknown = with_unknown_cause(campaign, linear)
        self._go_on(Explanation(starts, linear.log_evidence, fit=fit, linear=linear, with_unknown=unknown), linear)
