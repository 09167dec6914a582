"""Learns a remainder from readings: the parts that pay, their coefficients, and the same without each run in turn.

Which parts a remainder has, and how large and how smooth each is, follows from the restricted likelihood of penalised
splines. Whitened readings y = X beta + noise, with beta ~ N(0, t^2 K) in each part. K is the correlation of a smooth
function, so that 1 / t^2 is the penalty on what is large or rough. With Phi = X t K^(1/2) of all parts together and the
likelihood without any of them as the unit,

    log p = (z'z - log det(I + Phi'Phi)) / 2,    z = (I + Phi'Phi)^(-1/2) Phi'y.

Nothing beside the penalised coefficients is fitted, so that restricted likelihood and likelihood are one.

References
----------
S. N. Wood, Journal of the Royal Statistical Society B 73 (2011) 3: smoothing by restricted likelihood.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg, optimize

from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.effect import AddedEffect
from femfit.identify.checked_refit import UnseenError, cross_validated
from femfit.identify.decision.evidence import Linear, LogDensity
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening, orthonormal_basis
from femfit.identify.observations import Observations
from femfit.identify.remainder.constants import BEGUN, HALVINGS, LEAST_SHARE, POSSIBLE, PRICE, ROUNDS, SIZES
from femfit.identify.remainder.parts import BRAKE, Part, effect_of, parts_of


@dataclass(frozen=True, eq=False)
class Learnt:
    """A remainder: what each part's coefficients are, and how well they are known."""

    coefficients: Mapping[Part, FloatArray]
    covariance: FloatArray  # Of all coefficients, in the order of the parts
    columns: Mapping[Part, FloatArray]  # Change of every reading with each of them, in the readings' units; (M, count)
    evidence: float  # Log of the likelihood over that without a remainder
    # Kinds of the parts of other sets that a twentieth of the likelihood, with its price, leaves possible
    alternatives: tuple[tuple[str, ...], ...] = ()

    @property
    def effects(self) -> tuple[AddedEffect, ...]:
        """The remainder as an effect, none where nothing pays."""
        return (effect_of(self.coefficients),) if self.coefficients else ()

    @property
    def every_column(self) -> FloatArray:
        """The columns of all parts beside each other."""
        return np.concatenate(list(self.columns.values()), axis=1)


def columns_at(
    observations: Observations, parts: Sequence[Part], coefficients: Mapping[Part, FloatArray] | None = None
) -> list[FloatArray]:
    """Change of every reading with each coefficient of each part, by differences; each of shape (M, count)."""
    here = dict(coefficients or {})
    base = observations.predict([effect_of(here)]) if here else observations.base
    result = []
    for part in parts:
        free = here.get(part, np.zeros(part.count))
        columns = np.empty((len(base), part.count))
        for k in range(part.count):
            moved = free.copy()
            moved[k] += part.step
            columns[:, k] = (observations.predict([effect_of({**here, part: moved})]) - base) / part.step
        result.append(columns)
    return result


@dataclass(frozen=True, eq=False)
class Beside:
    """Whitening with what named effects can still explain taken out, so that a remainder leaves it to them."""

    whitening: Whitening
    named: FloatArray  # Change of every reading with each of their parameters; shape (M, q)

    @property
    def observations(self) -> Observations:
        """The readings."""
        return self.whitening.observations

    @cached_property
    def _basis(self) -> FloatArray:
        return orthonormal_basis(self.whitening.full(self.named))

    def full(self, x: FloatArray) -> FloatArray:
        """Whitened, and orthogonal to the named effects' columns, for x of shape (M,) or (M, k)."""
        white = self.whitening.full(x)
        return np.asarray(white - self._basis @ (self._basis.T @ white))


def learn(whitening: Beside, parts: Sequence[Part], columns: Sequence[FloatArray]) -> Learnt:
    """The remainder of largest evidence less the price of its parts; the columns are those without any.

    Sets of parts are found to first order; where a part bends what it acts on, the likelihood at the fit counts
    (Laplace's).
    """
    residual = whitening.full(whitening.observations.residual)
    readings = Penalised(residual, [whitening.full(block) for block in columns])
    sets = [
        _fitted(whitening, [parts[k] for k in chosen], [columns[k] for k in chosen], [*chosen.values()])
        for chosen in sets_that_pay(readings, [part.roots for part in parts])
    ]
    worth = [candidate.evidence - PRICE * len(candidate.coefficients) for candidate in sets]
    if max(worth, default=0.0) <= 0.0:
        return Learnt({}, np.zeros((0, 0)), {}, 0.0)
    best = int(np.argmax(worth))
    near = (candidate for k, candidate in enumerate(sets) if k != best and worth[k] > worth[best] - POSSIBLE)
    return replace(
        sets[best], alternatives=tuple(tuple(part.kind for part in candidate.coefficients) for candidate in near)
    )


def _fitted(
    whitening: Beside, parts: Sequence[Part], columns: Sequence[FloatArray], roots: Sequence[FloatArray]
) -> Learnt:
    """Parts with given priors, fitted to the readings."""
    observations, chosen = whitening.observations, dict(enumerate(roots))
    coefficients = {part: np.zeros(part.count) for part in parts}
    not_negative = {k: np.ones(part.count, bool) for k, part in enumerate(parts) if part.kind == BRAKE}
    for step in range(ROUNDS if any(part.bends for part in parts) else 1):
        columns = columns_at(observations, parts, coefficients) if step else columns
        residual = _misfit(observations, coefficients)
        linear = residual + sum(block @ coefficients[part] for part, block in zip(parts, columns, strict=True))
        readings = Penalised(whitening.full(linear), [whitening.full(block) for block in columns])
        mean, covariance = posterior(readings, chosen, not_negative)
        wanted = {part: mean[k] for k, part in enumerate(parts)}
        coefficients = _stepped(whitening, roots, coefficients, wanted)
    fall = float(np.sum(whitening.full(observations.residual) ** 2)) - _cost(whitening, roots, coefficients)
    log_evidence = 0.5 * (fall - readings.having(chosen).solved.log_det)
    return Learnt(coefficients, covariance, dict(zip(parts, columns, strict=True)), log_evidence)


def _cost(whitening: Beside, roots: Sequence[FloatArray], coefficients: Mapping[Part, FloatArray]) -> float:
    """Penalised sum of squares."""
    misfit = whitening.full(_misfit(whitening.observations, coefficients))
    sizes = zip(roots, coefficients.values(), strict=True)
    return float(misfit @ misfit) + sum(float(np.sum(np.linalg.solve(root, free) ** 2)) for root, free in sizes)


def _misfit(observations: Observations, coefficients: Mapping[Part, FloatArray]) -> FloatArray:
    """Recorded less predicted with a remainder, shape (M,)."""
    if not any(np.any(free) for free in coefficients.values()):
        return observations.residual
    return observations.value - observations.predict([effect_of(coefficients)])


def _stepped(
    whitening: Beside,
    roots: Sequence[FloatArray],
    here: Mapping[Part, FloatArray],
    wanted: Mapping[Part, FloatArray],
) -> dict[Part, FloatArray]:
    """The step that is wanted, halved until it lowers the penalised sum of squares."""
    if not any(part.bends for part in wanted):
        return dict(wanted)
    before, length = _cost(whitening, roots, here), 1.0
    for _ in range(HALVINGS):
        there = {part: here[part] + length * (wanted[part] - here[part]) for part in wanted}
        if _cost(whitening, roots, there) < before:
            return there
        length *= 0.5
    return dict(here)


@dataclass(frozen=True, eq=False)
class Checked:
    """A remainder, the noise beside it, and its error on runs left out."""

    learnt: Learnt
    whitening: Whitening
    error: UnseenError
    before: UnseenError  # Of the model as it is


def learn_checked(whitening: Whitening, named: FloatArray | None = None) -> Checked:
    """Learn a remainder; of one with and one without parts that bend the setting, the better on runs left out.

    Parameters
    ----------
    named : array, shape (M, q), or None
        Change of every reading with each parameter of effects that are fitted beside it.
    """
    named = np.zeros((len(whitening.observations.value), 0)) if named is None else named
    observations = whitening.observations
    parts = parts_of(observations)
    columns = columns_at(observations, parts)
    first = learn(Beside(whitening, named), parts, columns)
    if first.effects:  # a misfit that is taken away is no scatter of mounts and runs
        clean = observations.with_values(observations.value - observations.predict(first.effects) + observations.base)
        noise = estimate_noise(clean)
        whitening = whitening if noise is None else Whitening(observations, noise)
    noise = whitening.noise
    before = cross_validated(whitening, lambda _: ())

    def checked(numbers: Sequence[int]) -> Checked:
        """What some of the parts learn, held against what they learn without each run, choice and smoothness too."""
        some, changes = [parts[k] for k in numbers], [columns[k] for k in numbers]

        def learnt_from(keep: BoolArray) -> tuple[AddedEffect, ...]:
            readings = observations.select(keep)
            beside = Beside(Whitening(readings, noise), named[keep])
            return learn(beside, some, [change[keep] for change in changes]).effects

        learnt = learn(Beside(whitening, named), some, changes)
        error = cross_validated(whitening, learnt_from) if learnt.effects else before
        return Checked(learnt, whitening, error, before)

    every = checked(range(len(parts)))
    if not any(part.bends for part in every.learnt.coefficients):
        return every
    straight = checked([k for k, part in enumerate(parts) if not part.bends])
    return min(every, straight, key=lambda tried: tried.error.chi2)


@dataclass(frozen=True, eq=False)
class Penalised:
    """Whitened readings, and the whitened columns of each part that they may have."""

    target: FloatArray  # Shape (M,)
    columns: Sequence[FloatArray]  # Each of shape (M, count)

    def having(self, chosen: Mapping[int, FloatArray]) -> Linear:
        """The readings with parts that are known to N(0, L L'), given the numbers and roots L of these."""
        blocks = [self.columns[k] @ root for k, root in chosen.items()]
        columns = np.concatenate([np.zeros((len(self.target), 0)), *blocks], axis=1)
        return Linear.of(self.target, columns, LogDensity(len(self.target), np.inf))

    def best_root(
        self, number: int, chosen: Mapping[int, FloatArray], roots: Sequence[FloatArray]
    ) -> tuple[FloatArray, float]:
        """The root of largest likelihood of a part beside others, and the log of that over the one without the part."""
        beside, block = self.having({k: root for k, root in chosen.items() if k != number}), self.columns[number]
        gram, along = beside.products(block)
        best = np.zeros_like(gram), 0.0
        for root in roots:
            inner = root.T @ gram @ root
            largest = float(np.linalg.eigvalsh(inner)[-1])
            if not largest > 0.0:
                continue
            sizes = np.geomspace(0.1, 1e4, SIZES) / np.sqrt(largest)
            gains = beside.with_more(inner, root.T @ along, sizes)[0] - beside.log_evidence
            k = int(np.argmax(gains))
            if gains[k] > best[1]:
                best = sizes[k] * root, float(gains[k])
        return best


def sets_that_pay(readings: Penalised, roots: Sequence[Sequence[FloatArray]]) -> list[dict[int, FloatArray]]:
    """Sets of parts, begun with each part that says much by itself, each part with the root of its prior covariance."""
    alone = {k: readings.best_root(k, {}, of_part) for k, of_part in enumerate(roots)}
    most = max((gain for _, gain in alone.values()), default=0.0)
    if most < PRICE:
        return []
    begun = [k for k, (_, gain) in alone.items() if gain >= max(PRICE, BEGUN * most)]
    sets = {frozenset(chosen): chosen for chosen in (_grown(readings, roots, {k: alone[k][0]}) for k in begun)}
    return list(sets.values())


def _grown(
    readings: Penalised, roots: Sequence[Sequence[FloatArray]], first: Mapping[int, FloatArray]
) -> dict[int, FloatArray]:
    """Add the part that adds most evidence, size each anew beside the others, and drop what no longer pays."""
    chosen, tried, none = dict(first), set(first), readings.having({}).log_evidence
    while len(tried) < len(roots):
        candidates = {k: readings.best_root(k, chosen, roots[k]) for k in range(len(roots)) if k not in tried}
        best = max(candidates, key=lambda k: candidates[k][1])
        if candidates[best][1] < max(PRICE, LEAST_SHARE * (readings.having(chosen).log_evidence - none)):
            break
        tried.add(best)
        chosen |= {best: candidates[best][0]}
        for _ in range(2):
            for k in tuple(chosen):
                chosen[k], gain = readings.best_root(k, chosen, roots[k])
                if gain < PRICE:
                    del chosen[k]
    return chosen


def posterior(
    readings: Penalised, chosen: Mapping[int, FloatArray], not_negative: Mapping[int, BoolArray]
) -> tuple[dict[int, FloatArray], FloatArray]:
    """Mean of the coefficients of each chosen part, some of them not negative, and the covariance of all together."""
    linear, root = readings.having(chosen), linalg.block_diag(*chosen.values())
    mean = root @ linear.amplitudes
    bounded = np.concatenate([not_negative.get(k, np.zeros(r.shape[0], bool)) for k, r in chosen.items()])
    if np.any(mean[bounded] < 0.0):
        upper = linear.solved.triangle.T @ np.linalg.inv(root)
        solved = optimize.lsq_linear(upper, upper @ mean, bounds=(np.where(bounded, 0.0, -np.inf), np.inf))
        mean = np.maximum(solved.x, np.where(bounded, 0.0, -np.inf))
    ends = np.cumsum([r.shape[0] for r in chosen.values()])[:-1]
    spread = root @ linalg.cho_solve((linear.solved.triangle, True), root.T)
    return dict(zip(chosen, np.split(mean, ends), strict=True)), spread
