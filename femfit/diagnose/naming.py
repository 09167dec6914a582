"""Decides what is missing: gate, score, refit the best few, form the class of what cannot be told apart, gate again.

The decision uses three numbers of a candidate: its weighted sum of squares, the part of the structured excess over the
noise that it explains, and whether the gate passes after it. A name is given only where the gate passes (``named``) or
where next to nothing of the excess is left (``form_insufficient``): a greedy choice without the gate would name some
known effect for every unknown one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.diagnose.columns import EffectColumns, effect_columns, why_untestable
from femfit.diagnose.diagnosis import Gate, ScoredEffect, Verdict
from femfit.diagnose.gate import PatternSpace, pattern_space, tail_probability
from femfit.diagnose.noise import estimate_noise
from femfit.diagnose.observations import Observations
from femfit.diagnose.refit import Refit, bounded_amplitudes, refit
from femfit.diagnose.whitening import NoiseModel, Whitening, chains_of, orthonormal_basis
from femfit.effects.effect import Effect

_SEEN = 0.05
"""Part of an effect's length beside fitted ones below which nothing can be said of it."""

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
    second : float
        Part that each of two effects must explain beyond the other.
    tie, tie_share : float
        Two explanations are not told apart where their weighted sums of squares differ by less than ``tie``, or by less
        than ``tie_share`` of what the better one explains.
    refitted, paired : int
        How many of the best single effects are refitted, and how many are tried in pairs with every other.
    """

    gate: float = 0.01
    after: float = 0.005
    enough: float = 0.97
    enough_of_two: float = 0.99
    second: float = 0.01
    tie: float = 9.0
    tie_share: float = 0.02
    refitted: int = 8
    paired: int = 8


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, or two, refitted to the readings.

    Parameters
    ----------
    fit : Refit
        With bounds.
    cost : float
        Weighted sum of squares plus a price for every parameter.
    excess : float
        Structured excess that it leaves.
    gate : Gate
        The test after it.
    further : float
        Smallest p-value of a further effect beside it, times the number of effects.
    """

    fit: Refit
    cost: float
    excess: float
    gate: Gate
    further: float

    def passes(self, levels: Levels) -> bool:
        """Whether it leaves neither structure nor anything for a further effect to explain."""
        return min(self.gate.p_value, self.further) > levels.after


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything that the decision rests on.

    Parameters
    ----------
    observations : Observations
        M readings.
    whitening : Whitening
        Of their noise.
    patterns : PatternSpace
        Of the gate.
    columns : tuple of (EffectColumns, FloatArray)
        Every testable effect at every combination of shape constants, with its whitened columns.
    untestable : mapping of str to str
        Why the others cannot be tested.
    """

    observations: Observations
    whitening: Whitening
    patterns: PatternSpace
    columns: tuple[tuple[EffectColumns, FloatArray], ...]
    untestable: Mapping[str, str]

    @property
    def noise(self) -> NoiseModel:
        """Of the campaign."""
        return self.whitening.noise

    @property
    def known_misfit(self) -> float:
        """Squared length, in whitened units, of the model's own misfit to the sweep that it was fitted to."""
        tolerance, sigma = self.observations.tolerance, self.noise.sigma[self.observations.channel]
        return float(np.sum((tolerance / sigma) ** 2))

    @property
    def rest(self) -> FloatArray:
        """Whitened residual of the model, shape (M,)."""
        return self.whitening.full(self.observations.residual)

    def of(self, observations: Observations) -> "Evidence":
        """The same for other readings at the same settings, with their own noise estimate."""
        noise = estimate_noise(observations)
        if noise is None:
            noise = self.noise
        whitening = Whitening(observations, noise, self.whitening.chains)
        columns = tuple((one, whitening.full(one.columns)) for one, _ in self.columns)
        return Evidence(observations, whitening, pattern_space(observations, whitening), columns, self.untestable)


@dataclass(frozen=True, eq=False)
class Decision:
    """What is missing, before it is put into words.

    Parameters
    ----------
    verdict : str
        As in :class:`femfit.diagnose.diagnosis.Diagnosis`.
    chosen : Candidate or None
        What the verdict names.
    classes : tuple of tuple of str
        Per named effect, what cannot be told from it, itself first.
    before : Gate
        The first test.
    excess : float
        Structured excess of the model.
    scores : tuple of ScoredEffect
        Every effect, best first.
    candidates : tuple of Candidate
        Those refitted, best first.
    """

    verdict: Verdict
    chosen: Candidate | None
    classes: tuple[tuple[str, ...], ...]
    before: Gate
    excess: float
    scores: tuple[ScoredEffect, ...]
    candidates: tuple[Candidate, ...]


def gather(observations: Observations, effects: Sequence[Effect]) -> Evidence | None:
    """Estimate the noise and compute every effect's columns.

    Parameters
    ----------
    observations : Observations
        M readings.
    effects : sequence of Effect
        To be considered.

    Returns
    -------
    Evidence or None
        None where there is no noise floor.
    """
    noise = estimate_noise(observations)
    if noise is None:
        return None
    whitening = Whitening(observations, noise, chains_of(observations))
    untestable, columns = {}, []
    for effect in effects:
        reason = why_untestable(effect, observations)
        found = [] if reason else effect_columns(effect, observations)
        if not found:
            untestable[effect.name] = reason or "it changes no reading at these settings"
        columns += [(one, whitening.full(one.columns)) for one in found]
    return Evidence(observations, whitening, pattern_space(observations, whitening), tuple(columns), untestable)


def decide(evidence: Evidence, levels: Levels) -> Decision:
    """Name what is missing, or say that nothing or nothing known is.

    Parameters
    ----------
    evidence : Evidence
        From :func:`gather`.
    levels : Levels
        Error rates.

    Returns
    -------
    Decision
        See :class:`Levels` for the rule.
    """
    rest = evidence.rest
    before, excess = evidence.patterns.test(rest), evidence.patterns.excess(rest)
    scores, best = _scored(evidence, rest)
    # What the gate cannot see of an effect between its patterns counts as well
    excess = max(excess, max((s.chi2_fall - s.degrees_of_freedom for s in scores), default=0.0))
    smallest = min((s.p_value for s in scores), default=1.0) * max(len(best), 1)
    if min(before.p_value, smallest) > 0.5 * levels.gate or excess < _KNOWN_MISFIT * evidence.known_misfit:
        return Decision("nothing_missing", None, (), before, excess, scores, ())
    singles = _refitted(evidence, [[item] for item in best[: levels.refitted]])
    chosen = _first_passing(singles, levels, excess)
    if chosen is not None:
        return _named("named", chosen, singles, levels, before, excess, scores)
    pairs = _refitted(evidence, _best_pairs(rest, best, levels)) if len(best) > 1 else []
    pairs = [pair for pair in pairs if _both_needed(pair, singles, levels, excess)]
    chosen = _first_passing(pairs, levels, excess)
    if chosen is not None:
        return _named("named", chosen, pairs, levels, before, excess, scores)
    for found, share in ((singles, levels.enough), (pairs, levels.enough_of_two)):
        enough = [one for one in found if one.excess <= (1.0 - share) * excess]
        if enough:
            return _named("form_insufficient", min(enough, key=_cost), found, levels, before, excess, scores)
    return Decision("unexplained", None, (), before, excess, scores, tuple(sorted(singles + pairs, key=_cost)))


def _cost(candidate: Candidate) -> float:
    return candidate.cost


Scored = tuple[EffectColumns, FloatArray, FloatArray, float]
"""(columns, whitened columns, amplitudes, fall of the sum of squares)."""


def _scored(evidence: Evidence, rest: FloatArray) -> tuple[tuple[ScoredEffect, ...], list[Scored]]:
    """Score every effect to first order; per effect its best shapes and shape constants, best effect first."""
    best: dict[str, Scored] = {}
    tries: dict[str, int] = {}
    price = _price(rest)
    for one, white in evidence.columns:
        found = _best_shapes(one, white, rest, price)
        name = one.effect.name
        tries[name] = tries.get(name, 0) + len(one.amplitudes)
        if name not in best or _worth(found, price) > _worth(best[name], price):
            best[name] = found
    scores = []
    for name, (one, _, _, fall) in best.items():
        degrees = len(one.amplitudes)
        p_value = min(1.0, tries[name] * tail_probability(fall, degrees, evidence.patterns.degrees_of_freedom))
        scores.append(ScoredEffect(name, p_value, fall, degrees))
    scores.sort(key=lambda s: s.chi2_fall - price * s.degrees_of_freedom, reverse=True)
    listed = [best[s.name] for s in scores]
    absent = [ScoredEffect(name, 1.0, 0.0, 0, note=why) for name, why in evidence.untestable.items()]
    return (*scores, *absent), listed


def _best_shapes(one: EffectColumns, white: FloatArray, rest: FloatArray, price: float) -> Scored:
    """The shapes of an effect's family that pay for their parameter: the best alone, then what it lacks."""
    chosen: list[int] = []
    amplitude, fall = np.zeros(0), 0.0
    while len(chosen) < len(one.amplitudes):
        trials = []
        for k in set(range(len(one.amplitudes))) - set(chosen):
            picked = [*chosen, k]
            trials.append((*bounded_amplitudes(rest, white[:, picked], one.bounds[:, picked]), picked))
        more, lower, picked = max(trials, key=lambda trial: trial[1])
        if chosen and lower - fall < price:
            break
        amplitude, fall, chosen = more, lower, picked
    part = replace(one, amplitudes=tuple(one.amplitudes[k] for k in chosen), columns=one.columns[:, chosen])
    return part, white[:, chosen], amplitude, fall


def _price(rest: FloatArray) -> float:
    """What a parameter must lower the sum of squares by: the logarithm of the number of readings (Schwarz, 1978)."""
    return float(np.log(max(len(rest), 2)))


def _worth(item: Scored, price: float) -> float:
    return item[3] - price * len(item[0].amplitudes)


def _refitted(evidence: Evidence, starts: Sequence[Sequence[Scored]]) -> list[Candidate]:
    """Refit combinations of effects, cheapest first."""
    result = []
    for start in starts:
        fit = refit(evidence.observations, evidence.whitening, [(one, amplitude) for one, _, amplitude, _ in start])
        constants = sum(p.shape for _, p in fit.free)
        price = _price(fit.rest) * (fit.used - 0.5 * constants)
        fitted = fit.jacobian[:, ~fit.active]
        result.append(
            Candidate(
                fit=fit,
                cost=fit.chi2 + price,
                excess=evidence.patterns.excess(fit.rest, fitted),
                gate=evidence.patterns.test(fit.rest, fitted),
                further=_further(evidence, fit.names, fit.rest, fitted),
            )
        )
    return sorted(result, key=_cost)


def _further(evidence: Evidence, names: Sequence[str], rest: FloatArray, fitted: FloatArray) -> float:
    """Smallest p-value of an effect beside fitted ones, for as many as were tried."""
    left = orthonormal_basis(fitted)
    rest = rest - left @ (left.T @ rest)
    smallest, tried, price = 1.0, 0, _price(rest)
    for one, white in evidence.columns:
        if one.effect.name in names:
            continue
        beside = white - left @ (left.T @ white)
        length, before = np.linalg.norm(beside, axis=0), np.linalg.norm(white, axis=0)
        seen = np.flatnonzero(length > _SEEN * before)
        tried += len(one.amplitudes)
        if len(seen):
            part = replace(one, amplitudes=tuple(one.amplitudes[k] for k in seen), columns=one.columns[:, seen])
            best, _, _, fall = _best_shapes(part, beside[:, seen], rest, price)
            p_value = tail_probability(fall, len(best.amplitudes), evidence.patterns.degrees_of_freedom)
            smallest = min(smallest, p_value)
    return min(1.0, tried * smallest)


def _best_pairs(rest: FloatArray, best: Sequence[Scored], levels: Levels) -> list[list[Scored]]:
    """The most promising pairs to first order."""
    columns = np.concatenate([item[1] for item in best], axis=1)
    left, triangle = np.linalg.qr(columns)  # the pairs' problems are solved in this small space
    target = left.T @ rest
    ends = np.cumsum([0] + [item[1].shape[1] for item in best])
    found = []
    for a, b in combinations(range(len(best)), 2):
        if a >= levels.paired:
            continue
        both = np.concatenate([triangle[:, ends[k] : ends[k + 1]] for k in (a, b)], axis=1)
        bounds = np.concatenate([best[k][0].bounds for k in (a, b)], axis=1)
        amplitude, fall = bounded_amplitudes(target, both, bounds)
        split = ends[a + 1] - ends[a]
        start = [(best[a][0], best[a][1], amplitude[:split], fall), (best[b][0], best[b][1], amplitude[split:], fall)]
        found.append((fall - 2.0 * len(amplitude), start))
    found.sort(key=lambda item: item[0], reverse=True)
    return [start for _, start in found[: levels.refitted]]


def _first_passing(candidates: Sequence[Candidate], levels: Levels, excess: float) -> Candidate | None:
    """The cheapest candidate after which the gate passes, unless a cheaper one fails it by far less misfit."""
    passing = [c for c in candidates if c.passes(levels) and c.excess < 0.5 * excess]
    return min(passing, key=_cost) if passing else None


def _both_needed(pair: Candidate, singles: Sequence[Candidate], levels: Levels, excess: float) -> bool:
    """Whether each of two effects explains a share that the other cannot."""
    alone = {one.fit.names[0]: one for one in singles}
    for name in pair.fit.names:
        if name in alone and alone[name].fit.chi2 - pair.fit.chi2 < max(levels.tie, levels.second * excess):
            return False
    return True


def _named(
    verdict: Verdict,
    chosen: Candidate,
    rivals: Sequence[Candidate],
    levels: Levels,
    before: Gate,
    excess: float,
    scores: tuple[ScoredEffect, ...],
) -> Decision:
    """The decision with the classes: rivals whose misfit is hardly larger, with the other effect the same."""
    reach = max(levels.tie, levels.tie_share * excess)
    close = [r for r in rivals if r.cost - chosen.cost <= reach]
    order = np.argsort([-_share(chosen, name) for name in chosen.fit.names], kind="stable")
    classes = []
    for k in order:
        name = chosen.fit.names[k]
        others = set(chosen.fit.names) - {name}
        members = [name]
        for rival in close:
            rest = set(rival.fit.names) - others
            if others <= set(rival.fit.names) and len(rest) == 1:
                members += [n for n in rest if n not in members]
        classes.append(tuple(members))
    return Decision(verdict, chosen, tuple(classes), before, excess, scores, tuple(rivals))


def _share(chosen: Candidate, name: str) -> float:
    """How much of the whitened readings one effect of a candidate changes."""
    columns = [j for j, (k, _) in enumerate(chosen.fit.free) if chosen.fit.names[k] == name]
    values = np.array(
        [
            chosen.fit.effects[chosen.fit.free[j][0]].parameters[chosen.fit.free[j][1].name]
            / (chosen.fit.free[j][1].sane[1] - chosen.fit.free[j][1].sane[0])
            for j in columns
            if not chosen.fit.free[j][1].shape
        ]
    )
    used = [j for j in columns if not chosen.fit.free[j][1].shape]
    return float(np.linalg.norm(chosen.fit.jacobian[:, used] @ values))
