"""Fits effects to whitened readings within their bounds, nonlinear parameters included.

A fit starts from effects with their columns for given readings, and amplitudes.

References
----------
R. T. Birge, Physical Review 40 (1932) 207: intervals by external consistency.
M. A. Branch, T. F. Coleman and Y. Li, SIAM Journal on Scientific Computing 21 (1999) 1: bounded trust region.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from scipy import optimize

from femfit.core.errors import TableError
from femfit.core.numerics import NORMAL_95, BoolArray, FloatArray, first_best
from femfit.effects.effect import AddedEffect, Effect, EffectParameter
from femfit.identify.noise.whitening import Whitening
from femfit.identify.signatures import EffectColumns, effect_columns, why_untestable
from femfit.identify.words import sentence

NEXT_TO_BOUND, AS_GOOD = 1e-2, 1e-2
"""Numerical: a parameter within this of its bound, over its plausible range, stands at it where the weighted sum of
squares, whose standard deviation is 1 and more, rises by no more than this."""

SEEN_SHARE = 1e-3
"""Numerical: part of what an effect does, up to which that by a constant of its shape over its plausible range does not
matter: it is not fitted."""

MOST_EVALUATIONS = 60
"""Numerical: steps after which a search is ended; nearly all of them need fewer than twenty."""


@dataclass(frozen=True, eq=False)
class Start:
    """An effect as first-order columns, with amplitudes."""

    columns: EffectColumns  # In the readings' units, at given nonlinear parameters
    whitened: FloatArray  # The same with the noise whitened; shape (M, k)
    amplitude: FloatArray  # Counted from null; shape (k,)
    held: Mapping[str, float] = field(default_factory=dict)  # Values of parameters that are not fitted
    # What is known of its parameters beforehand: how far they are from their nulls, with this standard deviation
    prior_mean: float = 0.0
    prior_sd: float = np.inf

    @classmethod
    def at_null(cls, every: Sequence[EffectColumns], whitening: Whitening) -> tuple[Self, ...]:
        """The starts without any of some effects, whitened at once, which is several times faster."""
        if not every:
            return ()
        whitened = whitening.full(np.concatenate([variant.columns for variant in every], axis=1))
        parts = np.split(whitened, np.cumsum([variant.columns.shape[1] for variant in every])[:-1], axis=1)
        return tuple(
            cls(variant, columns, np.zeros(columns.shape[1])) for variant, columns in zip(every, parts, strict=True)
        )

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.columns.effect.name

    @property
    def count(self) -> int:
        """Number of amplitudes."""
        return len(self.columns.amplitudes)

    @property
    def half_ranges(self) -> FloatArray:
        """Half of the plausible ranges of the amplitudes, shape (k,)."""
        return np.array([0.5 * p.width for p in self.columns.amplitudes])

    def continued(self, added: AddedEffect) -> "Start":
        """The start at the parameters where a fit ended."""
        nonlinear = {p.name: added.parameters[p.name] for p in added.effect.parameters if p.nonlinear}
        amplitude = np.array([added.parameters[p.name] - p.null for p in self.columns.amplitudes])
        return replace(self, columns=replace(self.columns, shape=nonlinear), amplitude=amplitude)


def starting_point(whitening: Whitening, effects: Sequence[Effect]) -> list[Start]:
    """Amplitudes of effects to first order, bounded, with the nonlinear parameters that fit best."""
    target = whitening.residual
    chosen: list[Start] = []
    for effect in effects:
        if reason := why_untestable(effect, whitening.observations):
            raise TableError(f"Effect {effect.name} cannot be fitted to these data: {reason}. {effect.experiment}")
        variants = Start.at_null(effect_columns(effect, whitening.observations), whitening)
        if not variants:
            raise TableError(sentence("refusals", "unseen", effect))
        tries = [fitted_together(target, [*chosen, variant]) for variant in variants]
        chosen = tries[first_best([fall for _, fall in tries])][0]
    return chosen


def fitted_together(target: FloatArray, starts: Sequence[Start]) -> tuple[list[Start], float]:
    """Starts with the bounded amplitudes that together fit a whitened target, (M,), best, and the fall of its square.

    References
    ----------
    P. B. Stark and R. L. Parker, Computational Statistics 10 (1995) 129: bounded-variable least squares.
    """
    columns = np.concatenate([start.whitened for start in starts], axis=1)
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    low, high = np.concatenate([start.columns.bounds for start in starts], axis=1) * size
    orthonormal, triangle = np.linalg.qr(columns / size)
    y = orthonormal.T @ target
    scaled = np.linalg.lstsq(triangle, y, rcond=1e-9)[0]
    if np.any(scaled < low) or np.any(scaled > high):
        scaled = optimize.lsq_linear(triangle, y, bounds=(low, np.maximum(high, low + 1e-300)), method="bvls").x
    left_over = y - triangle @ scaled
    parts = np.split(scaled / size, np.cumsum([start.count for start in starts])[:-1])
    begun = [replace(start, amplitude=values) for start, values in zip(starts, parts, strict=True)]
    return begun, float(y @ y - left_over @ left_over)


@dataclass(frozen=True, eq=False)
class Refit:
    """Effects fitted to the readings."""

    effects: tuple[AddedEffect, ...]
    free: tuple[tuple[int, EffectParameter], ...]  # Fitted parameters: number of the effect, and which
    whitened_residual: FloatArray  # What the fit leaves of the readings, whitened; shape (M,)
    # Whitened change of the residual with the free parameters, each over its plausible range; shape (M, p)
    jacobian: FloatArray
    active: BoolArray  # Whether the parameter stands at a bound; shape (p,)
    # What is known of the free parameters beforehand, each over its plausible range; zero for nothing; shape (p,)
    precision: FloatArray
    start: tuple[Start, ...]
    converged: bool = True  # Whether no step lowers the sum of squares any more; false where the search was ended

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the free parameters, each over its plausible range; zero for those at a bound; shape (p, p).

        What the fit leaves beyond the noise, of the model's own misfit say, counts as noise (Birge, 1932); what is
        known beforehand stays as well known.
        """
        moving = np.flatnonzero(~self.active)
        result = np.zeros((len(self.active), len(self.active)))
        columns = self.jacobian[:, moving]
        noise = max(1.0, self.chi2 / max(len(self.whitened_residual) - len(moving), 1))
        information = columns.T @ columns / noise + np.diag(self.precision[moving])
        result[np.ix_(moving, moving)] = np.linalg.pinv(information, hermitian=True)
        return result

    @cached_property
    def chi2(self) -> float:
        """Weighted sum of squares."""
        return float(self.whitened_residual @ self.whitened_residual)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(added.effect.name for added in self.effects)

    @property
    def restart(self) -> list[Start]:
        """The fit as the start of another."""
        return [start.continued(added) for start, added in zip(self.start, self.effects, strict=True)]


def is_plausible(added: AddedEffect, parameter: EffectParameter) -> bool:
    """Whether a fitted parameter, or part of its interval, lies in its plausible range.

    An amplitude that is not there is plausible as well.
    """
    value = added.parameters[parameter.name]
    low, high = added.ci95.get(parameter.name, (value, value))
    within = low <= parameter.plausible[1] and high >= parameter.plausible[0]
    return within or value == parameter.null


def plausible(added: AddedEffect) -> bool:
    """Whether every fitted parameter of an effect may be as large as it usually is."""
    return all(is_plausible(added, p) for p in added.effect.parameters)


def refit(whitening: Whitening, start: Sequence[Start]) -> Refit:
    """Fit effects within their bounds, all parameters that these readings see and that are not held."""
    observations = whitening.observations
    free = tuple(
        (k, p)
        for k, effect in enumerate(start)
        for p in (*effect.columns.amplitudes, *_seen_nonlinear(effect, whitening))
        if p.name not in effect.held
    )
    initial = []
    for k, effect in enumerate(start):  # nonlinear parameters that nothing depends on stand where they usually are
        moved = {p.name for number, p in free if number == k}
        usual = {p.name: p.null for p in effect.columns.effect.parameters if p.nonlinear and p.name not in moved}
        initial.append(effect.columns.parameters(effect.amplitude) | usual | dict(effect.held))
    width = np.array([p.width for _, p in free])
    low, high = (np.array([getattr(p, end) for _, p in free]) / width for end in ("lower", "upper"))
    expected = np.array([p.null + start[k].prior_mean for k, p in free]) / width
    root = width / np.array([start[k].prior_sd for k, _ in free])
    x0 = np.clip(np.array([initial[k][p.name] for k, p in free]) / width, low, high)
    places = [(k, p.name) for k, p in free]

    def effects_at(x: FloatArray) -> tuple[AddedEffect, ...]:
        values = [dict(parameters) for parameters in initial]
        for (k, name), scaled in zip(places, x * width, strict=True):
            values[k][name] = float(scaled)
        return tuple(
            AddedEffect(effect.columns.effect, v, runs=effect.columns.runs)
            for effect, v in zip(start, values, strict=True)
        )

    @lru_cache(maxsize=1)  # slopes are asked for where the residual was
    def predicted(x: tuple[float, ...]) -> FloatArray:
        """Readings, and their slopes by the free parameters."""
        return observations.predicted(effects_at(np.array(x)), places)

    def with_prior(x: FloatArray) -> FloatArray:
        return np.concatenate([whitening.full(observations.value - predicted(tuple(x))[:, 0]), root * (x - expected)])

    def slopes(x: FloatArray) -> FloatArray:
        return np.concatenate([whitening.full(-width * predicted(tuple(x))[:, 1:]), np.diag(root)])

    inner = np.clip(x0, low + 1e-6, high - 1e-6)
    limits: dict[str, Any] = {"xtol": 1e-6, "ftol": 1e-8, "max_nfev": MOST_EVALUATIONS}
    solution = optimize.least_squares(with_prior, inner, slopes, bounds=(low, high), x_scale="jac", **limits)
    x = _at_bounds(with_prior, solution.x, low, high)
    active, readings = (x == low) | (x == high), len(observations.value)
    residual, jacobian = with_prior(x)[:readings], np.asarray(solution.jac)[:readings]
    fit = Refit(effects_at(x), free, residual, jacobian, active, root**2, tuple(start), bool(solution.status > 0))
    # 95 % intervals of what moves the prediction and is off its bounds, from the curvature
    half = NORMAL_95 * np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    intervals: list[dict[str, tuple[float, float]]] = [{} for _ in start]
    for j in np.flatnonzero(~active & np.any(fit.jacobian != 0.0, axis=0)):
        k, name = places[j]
        intervals[k][name] = (float((x[j] - half[j]) * width[j]), float((x[j] + half[j]) * width[j]))
    effects = tuple(replace(added, ci95=ci95) for added, ci95 in zip(fit.effects, intervals, strict=True))
    return replace(fit, effects=effects)


def _at_bounds(
    residual: Callable[[FloatArray], FloatArray], x: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """A solution with those parameters at their bounds that are next to them and as good there.

    An interior method ends at a last bit's distance from a bound; a parameter that is not there must not count as one
    that was fitted.
    """
    chi2 = float(np.sum(residual(x) ** 2))
    for bound in (low, high):
        for j in np.flatnonzero(np.abs(x - bound) < NEXT_TO_BOUND):
            there = x.copy()
            there[j] = bound[j]
            moved = float(np.sum(residual(there) ** 2))
            if moved <= chi2 + AS_GOOD:
                x, chi2 = there, moved
    return x


def _seen_nonlinear(start: Start, whitening: Whitening) -> list[EffectParameter]:
    """The nonlinear parameters that change what the effect's amplitudes do to these readings by a part that matters."""
    columns, observations = start.columns, whitening.observations
    some = np.array([0.0 if p.name in start.held else 0.1 * p.width for p in columns.amplitudes])
    values = columns.parameters(np.where(some <= columns.bounds[1], some, -some))
    nonlinear = [p for p in columns.effect.parameters if p.nonlinear]
    for p in nonlinear:  # where a parameter usually stands it may have no slope
        values[p.name] += 0.1 * p.width * (1.0 if values[p.name] + 0.1 * p.width <= p.upper else -1.0)
    predicted = observations.predicted([AddedEffect(columns.effect, values)], [(0, p.name) for p in nonlinear])
    changes = np.column_stack([predicted[:, 0] - observations.base, predicted[:, 1:] * [p.width for p in nonlinear]])
    effect, *lengths = np.linalg.norm(whitening.full(changes), axis=0)
    return [p for p, length in zip(nonlinear, lengths, strict=True) if length > SEEN_SHARE * effect]
