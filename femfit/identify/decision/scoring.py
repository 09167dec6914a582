"""Scores effects to first order: each alone, in pairs, and beside others.

References
----------
G. Schwarz, Annals of Statistics 6 (1978) 461: the price of a parameter.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.identify.comparison.gate import tail_probability
from femfit.identify.decision.diagnosis import ScoredEffect
from femfit.identify.decision.evidence import Evidence
from femfit.identify.noise.whitening import orthonormal_basis
from femfit.identify.refit.refit import bounded_amplitudes
from femfit.identify.signatures.columns import EffectColumns

_SEEN = 0.05
"""Part of an effect's length beside fitted ones below which nothing can be said of it."""

Scored = tuple[EffectColumns, FloatArray, FloatArray, float]
"""(columns, whitened columns, amplitudes, fall of the sum of squares) of the shapes that pay for their parameter."""


def score_effects(evidence: Evidence, rest: FloatArray) -> tuple[tuple[ScoredEffect, ...], list[Scored]]:
    """Score every effect to first order.

    Parameters
    ----------
    rest : array, shape (M,)
        Whitened residual.

    Returns
    -------
    tuple of (tuple of ScoredEffect, list of Scored)
        Every effect, best first; and the testable ones with their best shapes and shape constants, in that order.
    """
    best: dict[str, Scored] = {}
    tries: dict[str, int] = {}
    price = parameter_price(rest)
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


def parameter_price(rest: FloatArray) -> float:
    """What a parameter must lower the sum of squares by: the logarithm of the number of readings.

    Parameters
    ----------
    rest : array, shape (M,)
        Whitened residual.
    """
    return float(np.log(max(len(rest), 2)))


def _worth(item: Scored, price: float) -> float:
    return item[3] - price * len(item[0].amplitudes)


def further_effects(
    evidence: Evidence, names: Sequence[str], rest: FloatArray, fitted: FloatArray
) -> tuple[list[Scored], float]:
    """What further effects explain beside fitted ones.

    Parameters
    ----------
    rest : array, shape (M,)
        Whitened residual that they leave.
    fitted : array, shape (M, p)
        Their whitened columns.

    Returns
    -------
    tuple of (list of Scored, float)
        The other effects, best first; and the smallest p-value, times the number of shapes that were tried
        (Bonferroni).
    """
    left = orthonormal_basis(fitted)
    rest = rest - left @ (left.T @ rest)
    smallest, tried, price = 1.0, 0, parameter_price(rest)
    best: dict[str, Scored] = {}
    for one, white in evidence.columns:
        name = one.effect.name
        if name in names:
            continue
        beside = white - left @ (left.T @ white)
        length, before = np.linalg.norm(beside, axis=0), np.linalg.norm(white, axis=0)
        seen = np.flatnonzero(length > _SEEN * before)
        tried += len(one.amplitudes)
        if not len(seen):
            continue
        part = replace(one, amplitudes=tuple(one.amplitudes[k] for k in seen), columns=one.columns[:, seen])
        found = _best_shapes(part, beside[:, seen], rest, price)
        p_value = tail_probability(found[3], len(found[0].amplitudes), evidence.patterns.degrees_of_freedom)
        smallest = min(smallest, p_value)
        if name not in best or _worth(found, price) > _worth(best[name], price):
            best[name] = found
    listed = sorted(best.values(), key=lambda item: -_worth(item, price))
    return listed, min(1.0, tried * smallest)


def best_pairs(rest: FloatArray, best: Sequence[Scored], leading: int, wanted: int) -> list[list[Scored]]:
    """The most promising pairs of effects to first order.

    Parameters
    ----------
    rest : array, shape (M,)
        Whitened residual.
    leading : int
        One of each pair is among so many best.

    Returns
    -------
    list of list of Scored
        Best first; the fall of each is the pair's.
    """
    columns = np.concatenate([item[1] for item in best], axis=1)
    left, triangle = np.linalg.qr(columns)  # the pairs' problems are solved in this small space
    target = left.T @ rest
    ends = np.cumsum([0] + [item[1].shape[1] for item in best])
    found = []
    for a, b in combinations(range(len(best)), 2):
        if a >= leading:
            continue
        both = np.concatenate([triangle[:, ends[k] : ends[k + 1]] for k in (a, b)], axis=1)
        bounds = np.concatenate([best[k][0].bounds for k in (a, b)], axis=1)
        amplitude, fall = bounded_amplitudes(target, both, bounds)
        split = ends[a + 1] - ends[a]
        start = [(best[a][0], best[a][1], amplitude[:split], fall), (best[b][0], best[b][1], amplitude[split:], fall)]
        found.append((fall - 2.0 * len(amplitude), start))
    found.sort(key=lambda item: item[0], reverse=True)
    return [start for _, start in found[:wanted]]
