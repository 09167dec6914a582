"""Scores effects to first order: each alone, in pairs, and beside others.

References
----------
G. Schwarz, Annals of Statistics 6 (1978) 461: the price of a parameter.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.ties import first_best, ranked
from femfit.identify.comparison.lack_of_fit import tail_probability
from femfit.identify.constants import PAIR_PRICE, ROUNDING, SEEN
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.diagnosis import ScoredEffect
from femfit.identify.noise.whitening import orthonormal_basis
from femfit.identify.refit.start import Start, bounded_amplitudes, fitted_together


def parameter_price(whitened_residual: FloatArray) -> float:
    """What a parameter must lower the sum of squares by: the logarithm of the number of readings."""
    return float(np.log(max(len(whitened_residual), 2)))


def score_effects(campaign: Campaign, whitened_residual: FloatArray) -> tuple[tuple[ScoredEffect, ...], list[Start]]:
    """Score every effect to first order, best first.

    The second list has the testable ones, likewise, with their best amplitudes and nonlinear parameters.
    """
    price = parameter_price(whitened_residual)
    tries: dict[str, int] = {}
    for one in campaign.effects:
        tries[one.name] = tries.get(one.name, 0) + one.count
    starts = _best_of_each((_best_amplitudes(one, whitened_residual, price) for one in campaign.effects), price)
    scores = [
        ScoredEffect(one.name, min(1.0, tries[one.name] * _tail_probability(campaign, one)), one.fall, one.count)
        for one in starts
    ]
    absent = [ScoredEffect(name, 1.0, 0.0, 0, note=why) for name, why in campaign.untestable.items()]
    return (*scores, *absent), starts


def further_effects(
    campaign: Campaign, names: Sequence[str], whitened_residual: FloatArray, fitted: FloatArray
) -> tuple[list[Start], float]:
    """The other effects beside fitted ones, best first, and their smallest p-value.

    The residual is what the fitted effects, of whitened columns of shape (M, p), leave. The p-value counts times the
    number of amplitudes that were tried (Bonferroni).
    """
    basis = orthonormal_basis(fitted)
    residual = whitened_residual - basis @ (basis.T @ whitened_residual)
    tried, price = 0, parameter_price(residual)
    found = []
    for one in (one for one in campaign.effects if one.name not in names):
        beside = one.whitened - basis @ (basis.T @ one.whitened)
        seen = np.flatnonzero(np.linalg.norm(beside, axis=0) > SEEN * np.linalg.norm(one.whitened, axis=0))
        tried += one.count
        part = replace(one, whitened=beside).part(seen.tolist())
        if _open(part, ()):
            found.append(_best_amplitudes(part, residual, price))
    variance = campaign.expected_variance
    smallest = min((_tail_probability(campaign, one, variance) for one in found), default=1.0)
    return _best_of_each(found, price), min(1.0, tried * smallest)


def best_pairs(whitened_residual: FloatArray, best: Sequence[Start], leading: int, wanted: int) -> list[list[Start]]:
    """The most promising pairs of effects to first order."""
    if len(best) < 2:
        return []
    left, triangle = np.linalg.qr(np.concatenate([one.whitened for one in best], axis=1))
    target = left.T @ whitened_residual  # the pairs' problems are solved in this small space
    ends = np.cumsum([one.count for one in best])[:-1]
    small = [replace(one, whitened=part) for one, part in zip(best, np.split(triangle, ends, axis=1), strict=True)]
    pairs = []
    for places in combinations(range(len(best)), 2):
        if places[0] < leading:
            both, fall = fitted_together(target, [small[k] for k in places])
            pairs.append(
                [replace(one, whitened=best[k].whitened, fall=fall) for k, one in zip(places, both, strict=True)]
            )
    return ranked(pairs, lambda pair: pair[0].fall - PAIR_PRICE * sum(one.count for one in pair), ROUNDING)[:wanted]


def _tail_probability(campaign: Campaign, one: Start, variance: float = 1.0) -> float:
    return tail_probability(one.fall / variance, one.count, campaign.patterns.degrees_of_freedom)


def _best_amplitudes(one: Start, whitened_residual: FloatArray, price: float) -> Start:
    """The amplitudes of an effect's family that pay for their parameter: the best alone, then what it lacks."""
    chosen: list[int] = []
    amplitude, fall = np.zeros(0), 0.0
    while open_ := _open(one, chosen):
        trials = []
        for k in open_:
            picked = [*chosen, k]
            trials.append(
                (*bounded_amplitudes(whitened_residual, one.whitened[:, picked], one.columns.bounds[:, picked]), picked)
            )
        more, lower, picked = trials[first_best([trial[1] for trial in trials], ROUNDING)]
        if chosen and lower - fall < price:
            break
        amplitude, fall, chosen = more, lower, picked
    return _with_leaders(replace(one.part(chosen), amplitude=amplitude, fall=fall), whitened_residual, price)


def _open(one: Start, chosen: Sequence[int]) -> list[int]:
    """Amplitudes that may be added: not yet chosen, and those that go with another one only beside it."""
    names = {one.columns.amplitudes[k].name for k in chosen}
    amplitudes = enumerate(one.columns.amplitudes)
    return [k for k, p in amplitudes if k not in chosen and (not p.beside or p.beside in names)]


def _with_leaders(one: Start, whitened_residual: FloatArray, price: float) -> Start:
    """The start without the amplitudes whose leading one no longer pays for itself beside them.

    A preload that was fitted beside a stiffness may explain all of it: then it is no spring's.
    """
    leading = {p.beside for p in one.columns.amplitudes} - {""}
    if not leading:
        return one
    without = _best_part(one, [p.name not in leading for p in one.columns.amplitudes], whitened_residual)
    if one.fall - without.fall >= price:
        return one
    return _best_part(one, [not p.beside for p in one.columns.amplitudes], whitened_residual)


def _best_part(one: Start, keep: Sequence[bool], whitened_residual: FloatArray) -> Start:
    """Some of the amplitudes alone, where they fit best."""
    part = one.part(np.flatnonzero(keep).tolist())
    amplitude, fall = bounded_amplitudes(whitened_residual, part.whitened, part.columns.bounds)
    return replace(part, amplitude=amplitude, fall=fall)


def _best_of_each(starts: Iterable[Start], price: float) -> list[Start]:
    """The best start of every effect, the best effect first; equal ones in the catalogue's order."""

    def worth(one: Start) -> float:
        return one.fall - price * one.count

    by_name: dict[str, list[Start]] = {}
    for one in starts:
        by_name.setdefault(one.name, []).append(one)
    best = [variants[first_best([worth(v) for v in variants], ROUNDING)] for variants in by_name.values()]
    return ranked(best, worth, ROUNDING)
