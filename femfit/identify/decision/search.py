"""Searches the explanations that count: sets of effects, refitted best first, with and without an unknown cause.

From each explanation the search goes on to first order: by one more effect, throughout or in some runs, or by a pair.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, count
from operator import attrgetter

import numpy as np
from scipy import special

from femfit.core.numerics import FloatArray
from femfit.identify.decision.campaign import Campaign, half_ranges
from femfit.identify.decision.constants import (
    EXPECTED_EFFECTS,
    FORM_SPREAD,
    IN_PART,
    IN_VAIN,
    LIKELIEST,
    LOOKED_AT,
    MOST_EFFECTS,
    MOST_REFITS,
    PAIRED,
    SIZES,
    UNKNOWN_CAUSE,
)
from femfit.identify.decision.evidence import (
    Linear,
    density_of,
    mean_of_logs,
    null,
    of_sizes,
    sizes_of,
    with_unknown_cause,
)
from femfit.identify.refit import Refit, Start, refit


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


def with_one_more(campaign: Campaign, base: Explanation) -> list[Explanation]:
    """Every further effect beside refitted ones, to first order: its log evidence and where its refit begins."""
    if len(base.names) >= MOST_EFFECTS:
        return []
    linear = base.linear or null(campaign)
    begun, unknown = base.continued, base.with_unknown - base.log_evidence
    result = []
    for name, variants in campaign.variants.items():
        if name in base.names:
            continue
        logs, starts = [], []
        for k in variants:
            effect, (gram, along) = campaign.effects[k], linear.products(campaign.blocks[k], campaign.grams[k])
            exact = _one_more(linear, effect, gram[: effect.count, : effect.count], along[: effect.count])
            formed = _one_more(linear, effect, gram, along)
            share = np.log(1.0 / len(FORM_SPREAD))  # of exact forms, the first of the spreads
            logs.append(float(np.logaddexp(exact[0] + share, formed[0] + np.log1p(-np.exp(share)))))
            starts.append(max(exact, formed, key=lambda pair: pair[0])[1])
        log, start = mean_of_logs(logs), starts[int(np.argmax(logs))]
        if name in campaign.in_some_runs:
            in_part = [
                _one_more(linear, each, *linear.products(each.whitened * half_ranges(each)))
                for each in campaign.in_some_runs[name]
            ]
            log_in_runs = mean_of_logs([pair[0] for pair in in_part])
            if log_in_runs + np.log(IN_PART) > log + np.log1p(-IN_PART):
                start = max(in_part, key=lambda pair: pair[0])[1]
            log = float(np.logaddexp(log + np.log1p(-IN_PART), log_in_runs + np.log(IN_PART)))
        # What adds something may stand in the unknown cause's place: its refit tells
        beside_unknown = log + unknown if log <= base.log_evidence else -np.inf
        result.append(Explanation((*begun, start), log, base.log_evidence, with_unknown=beside_unknown))
    return result


def _one_more(linear: Linear, effect: Start, gram: FloatArray, along: FloatArray) -> tuple[float, Start]:
    """Log evidence with one variant of an effect, and where its amplitudes then are.

    What would leave its bounds is left out: a friction does not push.
    """
    half, (low, high) = half_ranges(effect), effect.columns.bounds
    moving = np.ones(len(along), dtype=bool)
    while moving[: effect.count].any():
        amplitudes = gram[: effect.count, : effect.count][np.ix_(moving[: effect.count], moving[: effect.count])]
        sizes = sizes_of(float(np.sqrt(max(np.linalg.eigvalsh(amplitudes)[-1], 0.0))))
        logs, means = linear.with_more(gram[np.ix_(moving, moving)], along[moving], sizes)
        amplitude = np.zeros(len(along))
        amplitude[moving] = means[int(np.argmax(logs))]
        amplitude = amplitude[: effect.count] * half
        wrong = ((amplitude < low) & (low == 0.0)) | ((amplitude > high) & (high == 0.0))
        if not wrong.any():
            return mean_of_logs(logs), replace(effect, amplitude=np.clip(amplitude, low, high))
        moving[: effect.count] &= ~wrong
    return -np.inf, effect


def pairs_of_two(campaign: Campaign, linear: Linear, alone: Sequence[Explanation]) -> list[Explanation]:
    """Pairs of which neither may look like much alone, to first order."""
    best = sorted(alone, key=attrgetter("log_evidence"), reverse=True)[:PAIRED]
    firsts = [explanation.starts[0] for explanation in best if np.isfinite(explanation.log_evidence)]
    leading = [(start, campaign.block(start)) for start in firsts]
    pairs = []
    for (first, columns), (second, further) in combinations(leading, 2):
        own_sizes, sizes = (
            sizes_of(float(np.linalg.norm(block[:, : start.count])))[::2]
            for block, start in ((columns, first), (further, second))
        )
        about = [Linear.of(linear.target, size * columns, linear.density) for size in own_sizes]
        logs = np.array([beside.with_more(*beside.products(further), sizes)[0] for beside in about])
        j, k = np.unravel_index(np.argmax(logs), logs.shape)
        both = Linear.of(linear.target, np.hstack([own_sizes[j] * columns, sizes[k] * further]), linear.density)
        # Not the least squares: at a bound, a direction that the readings leave open would keep a refit there
        means = own_sizes[j] * both.amplitudes[: first.count], sizes[k] * both.amplitudes[columns.shape[1] :]
        begun = tuple(
            replace(start, amplitude=np.clip(half_ranges(start) * mean[: start.count], *start.columns.bounds))
            for start, mean in zip((first, second), means, strict=True)
        )
        pairs.append(Explanation(begun, float(np.max(logs)) - np.log(SIZES), linear.log_evidence))
    return sorted(pairs, key=attrgetter("log_evidence"), reverse=True)[:PAIRED]


Key = tuple[frozenset[str], bool]
"""The effects of an explanation, and whether an unknown cause acts beside them."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """How probable every explanation is that was looked at."""

    explanations: Mapping[frozenset[str], Explanation]
    probability: Mapping[Key, float]
    ended: bool = False  # Whether sets were left to first order since so many had been refitted

    def of(self, *, effects: bool, unknown: bool) -> float:
        """Probability of all explanations with and without effects, with and without an unknown cause."""
        return sum(p for (names, beside), p in self.probability.items() if bool(names) == effects and beside == unknown)


def most_of_nothing(campaign: Campaign) -> float:
    """Probability that nothing is missing before any effect is looked at, an unknown cause alone beside it.

    It is an upper bound: every effect that is looked at takes probability from it.
    """
    start = null(campaign)
    odds = np.log(UNKNOWN_CAUSE) - np.log1p(-UNKNOWN_CAUSE)
    return float(special.expit(start.log_evidence - with_unknown_cause(campaign, start) - odds))


def explain(campaign: Campaign) -> Posterior:
    """Compare sets of effects: the most promising one is refitted, and what goes on from it joins the others."""
    start = null(campaign)
    unknown = with_unknown_cause(campaign, start)
    nothing = Explanation((), start.log_evidence, np.inf, linear=start, with_unknown=unknown)
    explanations = {frozenset[str](): nothing}
    alone = with_one_more(campaign, nothing)
    promised = {frozenset[str](): {frozenset(explanation.names): explanation.log_evidence for explanation in alone}}
    for explanation in (*alone, *pairs_of_two(campaign, start, alone)):
        _propose(explanations, explanation)
    # A large effect's own curvature may spoil what it promises to first order
    likeliest = max(alone, key=attrgetter("log_evidence"), default=nothing)
    prior = min(EXPECTED_EFFECTS / max(len(campaign.variants), 1), LIKELIEST)
    odds, least, in_vain, ended = float(np.log(prior) - np.log1p(-prior)), np.log(LOOKED_AT), 0, False
    for refits in count():
        logs = _log_posterior(explanations, odds)
        total = np.logaddexp.reduce(list(logs.values()))
        top = max(
            (names for names, explanation in explanations.items() if explanation.linear),
            key=lambda names: logs[names, False],
        )
        waiting = [
            key for key, explanation in explanations.items() if explanation.linear is None and _adds(explanation, odds)
        ]
        best = max(waiting, key=lambda names: logs[names, False], default=None)
        # Beside an unknown cause the first of several effects looks like nothing: the most promising way is gone on
        deeper = best is not None and logs[best, False] > logs[top, False] and in_vain < IN_VAIN
        if best is None or (logs[best, False] - total < least and not deeper):
            best = _without_one(explanations, top)
            if best is None and logs[top, False] - total > least:
                beside_unknown = logs[top, True] >= logs[top, False]
                best = _as_promising(explanations, promised, top, odds, beside_unknown=beside_unknown)
        if best is None:
            best = frozenset(likeliest.names)
            if explanations[best].linear is not None or logs[frozenset(), False] - total > least:
                break
        if refits == MOST_REFITS:
            ended = True
            break
        explanations[best] = _refitted(campaign, explanations[best])
        better = _log_posterior({best: explanations[best]}, odds)[best, False] > logs[top, False]
        in_vain = 0 if better else in_vain + 1
        if explanations[best].fit is not None:
            promised[best] = {}
            for explanation in with_one_more(campaign, explanations[best]):
                promised[best][frozenset(explanation.names)] = explanation.log_evidence
                _propose(explanations, explanation)
    probability = {key: float(np.exp(value - total)) for key, value in logs.items()}
    return Posterior(explanations, probability, ended or len(top) >= MOST_EFFECTS)


def _as_promising(
    explanations: Mapping[frozenset[str], Explanation],
    promised: Mapping[frozenset[str], Mapping[frozenset[str], float]],
    top: frozenset[str],
    odds: float,
    *,
    beside_unknown: bool,
) -> frozenset[str] | None:
    """An exchange of one effect that promised as much, beside the same others, as the most probable set did.

    One that makes these others no more probable stands at first order. Beside an unknown cause that says little of it.
    """
    every = beside_unknown and len(top) > 1
    alike = [
        (log, names)
        for dropped in top
        for rest in (promised.get(top - {dropped}, {}),)
        for names, log in rest.items()
        if explanations[names].linear is None
        and log > rest[top] + np.log(LOOKED_AT)
        and (every or _adds(explanations[names], odds))
    ]
    return max(alike, key=lambda pair: pair[0])[1] if alike else None


def _without_one(explanations: dict[frozenset[str], Explanation], top: frozenset[str]) -> frozenset[str] | None:
    """The most probable set without one of its effects, where its exchanges begin; None where all are known."""
    for dropped in explanations[top].names if len(top) > 1 else ():
        names = top - {dropped}
        if names not in explanations or explanations[names].linear is None:
            explanations[names] = Explanation(
                tuple(start for start in explanations[top].continued if start.name != dropped), -np.inf
            )
            return names
    return None


def _propose(explanations: dict[frozenset[str], Explanation], explanation: Explanation) -> None:
    """Take up a set of effects that is new, or begins better than before."""
    names = frozenset(explanation.names)
    if names not in explanations or (
        explanations[names].linear is None and explanations[names].log_evidence < explanation.log_evidence
    ):
        explanations[names] = explanation


def _adds(explanation: Explanation, odds: float) -> bool:
    """Whether a set is worth a refit: not where one more effect makes it no more probable to first order.

    What adds next to nothing is small, and for small effects first order is exact.
    """
    return explanation.log_evidence > explanation.without - (odds if len(explanation.starts) > 1 else 0.0)


def _log_posterior(explanations: Mapping[frozenset[str], Explanation], odds: float) -> dict[Key, float]:
    unknown, result = UNKNOWN_CAUSE, {}
    for names, explanation in explanations.items():
        result[names, False] = explanation.log_evidence + len(names) * odds + np.log1p(-unknown)
        result[names, True] = explanation.with_unknown + len(names) * odds + np.log(unknown)
    return result


def _refitted(campaign: Campaign, explanation: Explanation) -> Explanation:
    """An explanation at its refit, with the evidence of the linear model there."""
    observations = campaign.observations
    fit = refit(campaign.whitening, explanation.starts)
    value = np.array([(fit.effects[k].parameters[p.name] - p.null) / (0.5 * p.width) for k, p in fit.free])
    there = ~(fit.active & (np.abs(value) < 1e-9))
    free = [pair for pair, moves in zip(fit.free, there, strict=True) if moves]
    if {k for k, p in free if not p.nonlinear and not p.beside} != set(range(len(fit.effects))):
        # An effect of size zero explains nothing
        return replace(explanation, log_evidence=-np.inf, with_unknown=-np.inf, linear=null(campaign))
    families: dict[tuple[int, str], list[int]] = {}  # amplitudes that share a size, each with those beside it
    for j, (k, p) in enumerate(free):
        if not p.nonlinear:
            families.setdefault((k, p.beside or p.name), []).append(j)
    slopes = -0.5 * fit.jacobian[:, there]
    errors = [campaign.form_error(a.effect, observations.predict([a]) - observations.base) for a in fit.effects]
    columns = np.concatenate([slopes, *errors], axis=1)
    linear = of_sizes(
        fit.whitened_residual + slopes @ value[there],
        columns,
        [np.array(family) for family in families.values()],
        np.arange(slopes.shape[1], columns.shape[1]),
        density_of(campaign),
    )
    return replace(
        explanation,
        log_evidence=linear.log_evidence,
        fit=fit,
        linear=linear,
        with_unknown=with_unknown_cause(campaign, linear),
    )
