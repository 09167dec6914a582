"""Learns a remainder from readings: the parts that pay, their coefficients, and the same without each run in turn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.effect import AddedEffect
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of, orthonormal_basis
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.checked_refit import UnseenError, beside_random, channel_rms, left_out_groups
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
        for one in self.coefficients:
            if one is part:
                return slice(before, before + part.count)
            before += one.count
        raise KeyError(part.kind)


def columns_at(
    observations: Observations, parts: Sequence[Part], coefficients: Mapping[Part, FloatArray] | None = None
) -> list[FloatArray]:
    """Change of every reading with each coefficient of each part, by differences; each of shape (M, count)."""
    here = dict(coefficients or {})
    base = observations.predict([added(effect_of(here))]) if here else observations.base
    result = []
    for part in parts:
        own = here.get(part, np.zeros(part.count))
        columns = np.empty((len(base), part.count))
        for k in range(part.count):
            moved = own.copy()
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
    whitened = [whitening.full(one) for one in columns]
    gram = Gram.of(whitened, whitening.full(whitening.observations.residual))
    sets = [
        _fitted(whitening, [parts[k] for k in chosen], [columns[k] for k in chosen], [*chosen.values()])
        for chosen in sets_that_pay(gram, [part.roots for part in parts])
    ]
    worth = [one.evidence - PRICE * len(one.coefficients) for one in sets]
    if max(worth, default=0.0) <= 0.0:
        return Learnt({}, np.zeros((0, 0)), np.zeros((len(gram.target), 0)), 0.0)
    best = int(np.argmax(worth))
    near = (one for k, one in enumerate(sets) if k != best and worth[k] > worth[best] - POSSIBLE)
    return replace(sets[best], alternatives=tuple(tuple(part.kind for part in one.coefficients) for one in near))


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
        linear = residual + sum(one @ coefficients[part] for part, one in zip(parts, columns, strict=True))
        gram = Gram.of([whitening.full(one) for one in columns], whitening.full(linear))
        found = posterior(gram, chosen, not_negative)
        wanted = {part: found.mean[k] for k, part in enumerate(parts)}
        coefficients = _stepped(whitening, roots, coefficients, wanted)
    fall = float(np.sum(whitening.full(observations.residual) ** 2)) - _cost(whitening, roots, coefficients)
    return Learnt(
        coefficients, found.covariance, np.concatenate(columns, axis=1), 0.5 * (fall - complexity(gram, chosen))
    )


def _cost(whitening: Beside, roots: Sequence[FloatArray], coefficients: Mapping[Part, FloatArray]) -> float:
    """Penalised sum of squares."""
    misfit = whitening.full(_misfit(whitening.observations, coefficients))
    sizes = zip(roots, coefficients.values(), strict=True)
    return float(misfit @ misfit) + sum(float(np.sum(np.linalg.solve(root, one) ** 2)) for root, one in sizes)


def _misfit(observations: Observations, coefficients: Mapping[Part, FloatArray]) -> FloatArray:
    """Recorded less predicted with a remainder, shape (M,)."""
    if not any(np.any(one) for one in coefficients.values()):
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
        whitening = whitening if noise is None else Whitening(observations, noise, whitening.chains)
    before, best = unseen_before(whitening), None
    for some in (range(len(parts)), [k for k, part in enumerate(parts) if not part.bends]):
        picked = [parts[k] for k in some], [columns[k] for k in some]
        learnt = learn(Beside(whitening, named), *picked)
        error = learnt_unseen(Beside(whitening, named), *picked) if learnt.effects else before
        one = Checked(learnt, whitening, error, before)
        best = one if best is None or one.error.chi2 < best.error.chi2 else best
        if not any(part.bends for part in learnt.coefficients):
            break
    assert best is not None  # noqa: S101  two were tried
    return best


def learnt_unseen(whitening: Beside, parts: Sequence[Part], columns: Sequence[FloatArray]) -> UnseenError:
    """The error on each run by what was learnt without it, choice of parts and smoothness included."""
    observations, noise = whitening.observations, whitening.whitening.noise
    group = left_out_groups(observations)
    as_read, beside = np.zeros(len(group)), np.zeros(len(group))
    chi2, effects = 0.0, {}
    for one in np.unique(group):
        out = group == one
        seen, unseen = _part(observations, noise, ~out), _part(observations, noise, out)
        effects[int(one)] = learn(Beside(seen, whitening.named[~out]), parts, [each[~out] for each in columns]).effects
        residual = unseen.observations.value - unseen.observations.predict(effects[int(one)])
        as_read[out], beside[out] = residual, beside_random(residual, unseen)
        chi2 += float(np.sum(unseen.full(residual) ** 2))
    return UnseenError(channel_rms(observations, as_read), channel_rms(observations, beside), chi2, effects)


def unseen_before(whitening: Whitening) -> UnseenError:
    """The same of the model as it is."""
    observations, noise = whitening.observations, whitening.noise
    group, residual = left_out_groups(observations), observations.residual
    beside, chi2 = np.zeros(len(group)), 0.0
    for one in np.unique(group):
        out = group == one
        own = _part(observations, noise, out)
        beside[out] = beside_random(residual[out], own)
        chi2 += float(np.sum(own.full(residual[out]) ** 2))
    return UnseenError(channel_rms(observations, residual), channel_rms(observations, beside), chi2, {})


def _part(observations: Observations, noise: NoiseModel, keep: BoolArray) -> Whitening:
    some = observations.select(keep)
    return Whitening(some, noise, chains_of(some))
