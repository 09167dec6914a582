"""Searches the explanations that count: sets of effects, refitted best first, with and without an unknown cause."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy import special

from femfit.core.arrays import IntArray
from femfit.effects.effect import EffectParameter
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.constants import (
    EXPECTED_EFFECTS,
    IN_VAIN,
    LIKELIEST,
    LOOKED_AT,
    MOST_REFITS,
    UNKNOWN_CAUSE,
)
from femfit.identify.decision.effect_space import EffectSpace
from femfit.identify.decision.evidence import density_of, null, of_sizes, with_unknown_cause
from femfit.identify.decision.proposals import Explanation, pairs_of_two, with_one_more
from femfit.identify.refit.refit import refit

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
