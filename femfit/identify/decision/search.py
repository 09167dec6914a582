"""Searches the explanations that count: sets of effects, refitted best first, with and without an unknown cause.

Explanations, and what goes on from them to first order: one more effect, throughout or in some runs, or a pair.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, count

import numpy as np
from scipy import linalg, special

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.effect import EffectParameter
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.constants import (
    EXPECTED_EFFECTS,
    FORM_SPREAD,
    IN_PART,
    IN_VAIN,
    LIKELIEST,
    LOOKED_AT,
    MOST_REFITS,
    PAIRED,
    SIZES,
    UNKNOWN_CAUSE,
)
from femfit.identify.decision.effect_space import EffectSpace, half_ranges
from femfit.identify.decision.evidence import (
    Linear,
    density_of,
    mean_of_logs,
    null,
    of_sizes,
    sizes_of,
    with_unknown_cause,
)
from femfit.identify.refit.refit import Refit, Start, refit


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
        return tuple(one.name for one in self.starts)

    @property
    def continued(self) -> tuple[Start, ...]:
        """Where its effects' refit ended, or begins."""
        if self.fit is None:
            return self.starts
        return tuple(one.continued(added) for one, added in zip(self.starts, self.fit.effects, strict=True))


def with_one_more(space: EffectSpace, base: Explanation) -> list[Explanation]:
    """Every further effect beside refitted ones, to first order: its log evidence and where its refit begins."""
    linear = base.linear or null(space)
    beside = linear.beside(space.every_block)
    along = linear.along(space.every_block, beside)
    begun, unknown = base.continued, base.with_unknown - base.log_evidence
    found = []
    for name, variants in space.variants.items():
        if name in base.names:
            continue
        logs, starts = [], []
        for k in variants:
            at = space.places[k]
            gram = space.grams[k] - beside[:, at].T @ beside[:, at]
            one = space.campaign.effects[k]
            exact = _one_more(linear, one, gram[: one.count, : one.count], along[at][: one.count])
            formed = _one_more(linear, one, gram, along[at])
            share = np.log(1.0 / len(FORM_SPREAD))  # of exact forms, the first of the spreads
            logs.append(float(np.logaddexp(exact[0] + share, formed[0] + np.log1p(-np.exp(share)))))
            starts.append(max(exact, formed, key=lambda pair: pair[0])[1])
        log, start = mean_of_logs(logs), starts[int(np.argmax(logs))]
        if name in space.run_by_run:
            part, in_part = _in_some_runs(space, linear, name)
            start = in_part if part + np.log(IN_PART) > log + np.log1p(-IN_PART) else start
            log = float(np.logaddexp(log + np.log1p(-IN_PART), part + np.log(IN_PART)))
        # What adds something may stand in the unknown cause's place: its refit tells
        beside_unknown = log + unknown if log <= base.log_evidence else -np.inf
        found.append(Explanation((*begun, start), log, base.log_evidence, with_unknown=beside_unknown))
    return found


def _in_some_runs(space: EffectSpace, linear: Linear, name: str) -> tuple[float, Start]:
    """Log evidence of an effect that begins or ends between two runs, and where it then begins."""
    number, parts = space.run_by_run[name]
    one, runs = space.campaign.effects[number], space.campaign.observations.runs
    beside = linear.beside(parts)
    gram, along = parts.T @ parts - beside.T @ beside, linear.along(parts, beside)
    periods = [*((k, runs - 1) for k in range(1, runs)), *((0, k) for k in range(runs - 1))]
    logs, starts, summed = [], [], []
    for first, last in periods:
        acts = (np.arange(runs) >= first) & (np.arange(runs) <= last)
        sums = np.kron(acts[:, None], np.eye(one.count))
        summed.append(sums)
        log, start = _one_more(linear, one, sums.T @ gram @ sums, sums.T @ along)
        logs.append(log)
        starts.append(start)
    best = int(np.argmax(logs))
    run = space.campaign.observations.column("run").astype(int)
    columns = starts[best].columns.in_runs(periods[best], run)
    whitened = parts @ summed[best] / half_ranges(one)
    return mean_of_logs(logs), replace(starts[best], columns=columns, whitened=whitened)


def _one_more(linear: Linear, one: Start, gram: FloatArray, along: FloatArray) -> tuple[float, Start]:
    """Log evidence with one variant of an effect, and where its amplitudes then are.

    What would leave its bounds is left out: a friction does not push.
    """
    half, (low, high) = half_ranges(one), one.columns.bounds
    kept = np.ones(len(along), dtype=bool)
    while kept[: one.count].any():
        own = gram[: one.count, : one.count][np.ix_(kept[: one.count], kept[: one.count])]
        sizes = sizes_of(float(np.sqrt(max(np.linalg.eigvalsh(own)[-1], 0.0))))
        logs, means = linear.with_more(gram[np.ix_(kept, kept)], along[kept], sizes)
        amplitude = np.zeros(len(along))
        amplitude[kept] = means[int(np.argmax(logs))]
        amplitude = amplitude[: one.count] * half
        wrong = ((amplitude < low) & (low == 0.0)) | ((amplitude > high) & (high == 0.0))
        if not wrong.any():
            return mean_of_logs(logs), replace(one, amplitude=np.clip(amplitude, low, high))
        kept[: one.count] &= ~wrong
    return -np.inf, one


def pairs_of_two(space: EffectSpace, linear: Linear, alone: Sequence[Explanation]) -> list[Explanation]:
    """Pairs of which neither may look like much alone, to first order."""
    best = sorted((one for one in alone if np.isfinite(one.log_evidence)), key=lambda one: -one.log_evidence)
    leading = [(one.starts[0], space.block(one.starts[0])) for one in best[:PAIRED]]
    pairs = []
    for both in combinations(leading, 2):
        starts, blocks = [one for one, _ in both], [block for _, block in both]
        columns, ends = np.concatenate(blocks, axis=1), np.cumsum([0, *(block.shape[1] for block in blocks)])
        gram, product = columns.T @ columns, columns.T @ linear.target
        square, top = linear.square, (-np.inf, np.zeros(0))
        tried = [sizes_of(float(np.linalg.norm(b[:, : s.count])))[::2] for b, s in zip(blocks, starts, strict=True)]
        for first in tried[0]:
            for second in tried[1]:
                scale = np.repeat([first, second], np.diff(ends))
                triangle = linalg.cho_factor(np.eye(len(scale)) + scale[:, None] * gram * scale, lower=True)
                mean = linalg.cho_solve(triangle, scale * product)
                fall, log_det = float(scale * product @ mean), 2.0 * float(np.log(np.diag(triangle[0])).sum())
                log = float(linear.density(square - fall, log_det))
                top = max(top, (log, scale * mean), key=lambda one: one[0])
        begun = tuple(
            replace(one, amplitude=np.clip(half_ranges(one) * top[1][at : at + one.count], *one.columns.bounds))
            for one, at in zip(starts, ends, strict=False)
        )
        pairs.append(Explanation(begun, top[0] - np.log(SIZES), linear.log_evidence))
    return sorted(pairs, key=lambda one: -one.log_evidence)[:PAIRED]


Key = tuple[frozenset[str], bool]
"""The effects of an explanation, and whether an unknown cause acts beside them."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """How probable every explanation is that was looked at."""

    space: EffectSpace
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
    space = EffectSpace(campaign)
    start = null(space)
    odds = np.log(UNKNOWN_CAUSE) - np.log1p(-UNKNOWN_CAUSE)
    return float(special.expit(start.log_evidence - with_unknown_cause(space, start) - odds))


def explain(campaign: Campaign) -> Posterior:
    """Compare sets of effects: the most promising one is refitted, and what goes on from it joins the others."""
    space = EffectSpace(campaign)
    start = null(space)
    nothing = Explanation((), start.log_evidence, np.inf, linear=start, with_unknown=with_unknown_cause(space, start))
    found = {frozenset[str](): nothing}
    alone = with_one_more(space, nothing)
    promised = {frozenset[str](): {frozenset(one.names): one.log_evidence for one in alone}}
    for one in (*alone, *pairs_of_two(space, start, alone)):
        _propose(found, one)
    # A large effect's own curvature may spoil what it promises to first order
    likeliest = max(alone, key=lambda one: one.log_evidence, default=nothing)
    odds, least, in_vain, ended = _prior_odds(len(space.variants)), np.log(LOOKED_AT), 0, False
    for refits in count():
        logs = _log_posterior(found, odds)
        total = np.logaddexp.reduce(list(logs.values()))
        top = max((names for names, one in found.items() if one.linear), key=lambda names: logs[names, False])
        waiting = [key for key, one in found.items() if one.linear is None and _adds(one, odds)]
        best = max(waiting, key=lambda names: logs[names, False], default=None)
        # Beside an unknown cause the first of several effects looks like nothing: the most promising way is gone on
        deeper = best is not None and logs[best, False] > logs[top, False] and in_vain < IN_VAIN
        if best is None or (logs[best, False] - total < least and not deeper):
            best = _without_one(found, top)
            if best is None and logs[top, False] - total > least:
                beside_unknown = logs[top, True] >= logs[top, False]
                best = _as_promising(found, promised, top, odds, beside_unknown=beside_unknown)
        if best is None:
            best = frozenset(likeliest.names)
            if found[best].linear is not None or logs[frozenset(), False] - total > least:
                break
        if refits == MOST_REFITS:
            ended = True
            break
        found[best] = _refitted(space, found[best])
        better = _log_posterior({best: found[best]}, odds)[best, False] > logs[top, False]
        in_vain = 0 if better else in_vain + 1
        if found[best].fit is not None:
            promised[best] = {}
            for one in with_one_more(space, found[best]):
                promised[best][frozenset(one.names)] = one.log_evidence
                _propose(found, one)
    probability = {key: float(np.exp(value - total)) for key, value in logs.items()}
    return Posterior(space, found, probability, ended)


def _as_promising(
    found: Mapping[frozenset[str], Explanation],
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
        for left in top
        for rest in (promised.get(top - {left}, {}),)
        for names, log in rest.items()
        if found[names].linear is None and log > rest[top] + np.log(LOOKED_AT) and (every or _adds(found[names], odds))
    ]
    return max(alike, key=lambda pair: pair[0])[1] if alike else None


def _without_one(found: dict[frozenset[str], Explanation], top: frozenset[str]) -> frozenset[str] | None:
    """The most probable set without one of its effects, where its exchanges begin; None where all are known."""
    for left in found[top].names if len(top) > 1 else ():
        names = top - {left}
        if names not in found or found[names].linear is None:
            found[names] = Explanation(tuple(one for one in found[top].continued if one.name != left), -np.inf)
            return names
    return None


def _propose(found: dict[frozenset[str], Explanation], one: Explanation) -> None:
    """Take up a set of effects that is new, or begins better than before."""
    names = frozenset(one.names)
    if names not in found or (found[names].linear is None and found[names].log_evidence < one.log_evidence):
        found[names] = one


def _prior_odds(effects: int) -> float:
    """Log odds of an effect before the readings are looked at."""
    there = min(EXPECTED_EFFECTS / max(effects, 1), LIKELIEST)
    return float(np.log(there) - np.log1p(-there))


def _adds(one: Explanation, odds: float) -> bool:
    """Whether a set is worth a refit: not where one more effect makes it no more probable to first order.

    What adds next to nothing is small, and for small effects first order is exact.
    """
    return one.log_evidence > one.without - (odds if len(one.starts) > 1 else 0.0)


def _log_posterior(found: Mapping[frozenset[str], Explanation], odds: float) -> dict[Key, float]:
    unknown, result = UNKNOWN_CAUSE, {}
    for names, one in found.items():
        result[names, False] = one.log_evidence + len(names) * odds + np.log1p(-unknown)
        result[names, True] = one.with_unknown + len(names) * odds + np.log(unknown)
    return result


def _refitted(space: EffectSpace, one: Explanation) -> Explanation:
    """An explanation at its refit, with the evidence of the linear model there."""
    campaign, observations = space.campaign, space.campaign.observations
    fit = refit(observations, campaign.whitening, one.starts)
    value = np.array([(fit.effects[k].parameters[p.name] - p.null) / (0.5 * p.width) for k, p in fit.free])
    there = ~(fit.active & (np.abs(value) < 1e-9))
    free = [pair for pair, kept in zip(fit.free, there, strict=True) if kept]
    if {k for k, p in free if not p.nonlinear and not p.beside} != set(range(len(fit.effects))):
        # An effect of size zero explains nothing
        return replace(one, log_evidence=-np.inf, with_unknown=-np.inf, linear=null(space))
    slopes = -0.5 * fit.jacobian[:, there]
    errors = [space.form_error(a.effect, observations.predict([a]) - observations.base) for a in fit.effects]
    columns = np.concatenate([slopes, *errors], axis=1)
    linear = of_sizes(
        fit.whitened_residual + slopes @ value[there],
        columns,
        _families(free),
        np.arange(slopes.shape[1], columns.shape[1]),
        density_of(campaign),
    )
    return replace(
        one,
        log_evidence=linear.log_evidence,
        fit=fit,
        linear=linear,
        with_unknown=with_unknown_cause(space, linear),
    )


def _families(free: Sequence[tuple[int, EffectParameter]]) -> list[IntArray]:
    """The amplitudes that share a size: each by itself, with those that go with it alone."""
    found: dict[tuple[int, str], list[int]] = {}
    for j, (k, p) in enumerate(free):
        if not p.nonlinear:
            found.setdefault((k, p.beside or p.name), []).append(j)
    return [np.array(family) for family in found.values()]
