"""Explanations, and what goes on from them to first order: one more effect, throughout or in some runs, or a pair."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import linalg

from femfit.core.arrays import FloatArray
from femfit.identify.decision.constants import FORM_SPREAD, IN_PART, PAIRED, SIZES
from femfit.identify.decision.effect_space import EffectSpace, half_ranges
from femfit.identify.decision.evidence import Linear, mean_of_logs, null, sizes_of
from femfit.identify.refit.refit import Refit
from femfit.identify.refit.start import Start


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
