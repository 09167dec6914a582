"""Learns a remainder from readings: the parts that pay, their coefficients, and the same without each run in turn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.effect import AddedEffect
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening, orthonormal_basis
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.checked_refit import UnseenError, cross_validated
from femfit.identify.remainder.constants import HALVINGS, POSSIBLE, PRICE, ROUNDS
from femfit.identify.remainder.evidence import Gram, complexity, posterior, sets_that_pay
from femfit.identify.remainder.parts import BRAKE, Part, added, effect_of, parts_of


@dataclass(frozen=True, eq=False)
class Learnt:
    """A remainder: what each part's coefficients are, and how well they are known."""

    coefficients: Mapping[Part, FloatArray]
    covariance: FloatArray  # Of all coefficients, in the order of the parts
    columns: FloatArray  # Change of every reading with each coefficient, in the readings' units; shape (M, k)
    evidence: float  # Log of the likelihood over that without a remainder
    # Kinds of the parts of other sets that a twentieth of the likelihood, with its price, leaves possible
    alternatives: tuple[tuple[str, ...], ...] = ()

    @property
    def effects(self) -> tuple[AddedEffect, ...]:
        """The remainder as an effect, none where nothing pays."""
        return (added(effect_of(self.coefficients)),) if self.coefficients else ()

    def own(self, part: Part) -> slice:
        """Where a part's coefficients stand among all."""
        before = 0
        for earlier in self.coefficients:
            if earlier is part:
                return slice(before, before + part.count)
            before += earlier.count
        raise KeyError(part.kind)


def columns_at(
    observations: Observations, parts: Sequence[Part], coefficients: Mapping[Part, FloatArray] | None = None
) -> list[FloatArray]:
    """Change of every reading with each coefficient of each part, by differences; each of shape (M, count)."""
    here = dict(coefficients or {})
    base = observations.predict([added(effect_of(here))]) if here else observations.base
    result = []
    for part in parts:
        free = here.get(part, np.zeros(part.count))
        columns = np.empty((len(base), part.count))
        for k in range(part.count):
            moved = free.copy()
            moved[k] += part.step
            columns[:, k] = (observations.predict([added(effect_of({**here, part: moved}))]) - base) / part.step
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
    whitened = [whitening.full(block) for block in columns]
    gram = Gram.of(whitened, whitening.full(whitening.observations.residual))
    sets = [
        _fitted(whitening, [parts[k] for k in chosen], [columns[k] for k in chosen], [*chosen.values()])
        for chosen in sets_that_pay(gram, [part.roots for part in parts])
    ]
    worth = [candidate.evidence - PRICE * len(candidate.coefficients) for candidate in sets]
    if max(worth, default=0.0) <= 0.0:
        return Learnt({}, np.zeros((0, 0)), np.zeros((len(gram.target), 0)), 0.0)
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
        gram = Gram.of([whitening.full(block) for block in columns], whitening.full(linear))
        estimate = posterior(gram, chosen, not_negative)
        wanted = {part: estimate.mean[k] for k, part in enumerate(parts)}
        coefficients = _stepped(whitening, roots, coefficients, wanted)
    fall = float(np.sum(whitening.full(observations.residual) ** 2)) - _cost(whitening, roots, coefficients)
    return Learnt(
        coefficients, estimate.covariance, np.concatenate(columns, axis=1), 0.5 * (fall - complexity(gram, chosen))
    )


def _cost(whitening: Beside, roots: Sequence[FloatArray], coefficients: Mapping[Part, FloatArray]) -> float:
    """Penalised sum of squares."""
    misfit = whitening.full(_misfit(whitening.observations, coefficients))
    sizes = zip(roots, coefficients.values(), strict=True)
    return float(misfit @ misfit) + sum(float(np.sum(np.linalg.solve(root, free) ** 2)) for root, free in sizes)


def _misfit(observations: Observations, coefficients: Mapping[Part, FloatArray]) -> FloatArray:
    """Recorded less predicted with a remainder, shape (M,)."""
    if not any(np.any(free) for free in coefficients.values()):
        return observations.residual
    return observations.value - observations.predict([added(effect_of(coefficients))])


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
    before, tried = cross_validated(observations, noise, lambda _: ()), list[Checked]()
    for numbers in (range(len(parts)), [k for k, part in enumerate(parts) if not part.bends]):
        some, changes = [parts[k] for k in numbers], [columns[k] for k in numbers]
        learnt = learn(Beside(whitening, named), some, changes)
        error = before
        if learnt.effects:  # by what is learnt without each run, choice of parts and smoothness included

            def learnt_from(
                keep: BoolArray, some: Sequence[Part] = some, changes: Sequence[FloatArray] = changes
            ) -> tuple[AddedEffect, ...]:
                readings = observations.select(keep)
                beside = Beside(Whitening(readings, noise), named[keep])
                return learn(beside, some, [change[keep] for change in changes]).effects

            error = cross_validated(observations, noise, learnt_from)
        tried.append(Checked(learnt, whitening, error, before))
        if not any(part.bends for part in learnt.coefficients):
            break
    return min(tried, key=lambda checked: checked.error.chi2)
