"""Fits effects to whitened readings: bounded and linear for scoring, bounded and nonlinear for what is named.

References
----------
M. A. Branch, T. F. Coleman and Y. Li, SIAM Journal on Scientific Computing 21 (1999) 1: bounded trust region.
P. B. Stark and R. L. Parker, Computational Statistics 10 (1995) 129: bounded-variable least squares.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize, stats

from femfit.core.arrays import BoolArray, FloatArray
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.observations import Observations
from femfit.identify.signatures.columns import EffectColumns

_NEXT_TO, _AS_GOOD = 1e-2, 1e-2
"""A parameter within this of its bound, over its plausible range, stands at it where the weighted sum of squares, whose
standard deviation is 1 and more, rises by no more than this."""

Start = tuple[EffectColumns, FloatArray]
"""An effect with its amplitudes, counted from null, to start from."""


@dataclass(frozen=True, eq=False)
class Refit:
    """Effects fitted to the readings.

    Parameters
    ----------
    free : tuple of (int, EffectParameter)
        Fitted parameters: number of the effect, and which.
    rest : array, shape (M,)
        Whitened residual.
    jacobian : array, shape (M, p)
        Whitened change of the residual with the free parameters, each over its plausible range.
    active : array of bool, shape (p,)
        Whether the parameter stands at a bound.
    precision : array, shape (p,)
        Of what is known of the free parameters beforehand, each over its plausible range; zero for nothing.
    start : tuple of EffectColumns
        Of every effect, as the fit was started.
    """

    effects: tuple[AddedEffect, ...]
    free: tuple[tuple[int, EffectParameter], ...]
    rest: FloatArray
    jacobian: FloatArray
    active: BoolArray
    precision: FloatArray
    start: tuple[EffectColumns, ...]

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the free parameters, each over its plausible range; zero for those at a bound; shape (p, p)."""
        moving = np.flatnonzero(~self.active)
        result = np.zeros((len(self.active), len(self.active)))
        columns = self.jacobian[:, moving]
        information = columns.T @ columns + np.diag(self.precision[moving])
        result[np.ix_(moving, moving)] = np.linalg.pinv(information, hermitian=True)
        return result

    @cached_property
    def chi2(self) -> float:
        """Weighted sum of squares."""
        return float(self.rest @ self.rest)

    def trace(self, k: int) -> FloatArray:
        """What effect number k changes in the whitened residual, to first order in its amplitudes, shape (M,)."""
        used = [j for j, (of, p) in enumerate(self.free) if of == k and not p.nonlinear]
        values = [
            (self.effects[k].parameters[p.name] - p.null) / (p.plausible[1] - p.plausible[0])
            for p in (self.free[j][1] for j in used)
        ]
        return np.asarray(self.jacobian[:, used] @ np.array(values))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(added.effect.name for added in self.effects)

    @property
    def sane(self) -> tuple[bool, ...]:
        """Of each effect, whether every parameter, or part of its interval, lies in its usual range."""
        return tuple(all(usual(added, p) for p in added.effect.parameters) for added in self.effects)


def continued(columns: EffectColumns, added: AddedEffect) -> Start:
    """An effect's columns and amplitudes as a fit left them: where another one starts.

    Returns
    -------
    tuple of (EffectColumns, array of shape (k,))
        With the fitted shape constants; amplitudes count from null.
    """
    shape = {p.name: added.parameters[p.name] for p in added.effect.parameters if p.nonlinear}
    amplitude = np.array([added.parameters[p.name] - p.null for p in columns.amplitudes])
    return replace(columns, shape=shape), amplitude


def usual(added: AddedEffect, parameter: EffectParameter) -> bool:
    """Whether a fitted parameter, or part of its interval, lies in its usual range.

    Returns
    -------
    bool
        True also of an amplitude that is not there.
    """
    value = added.parameters[parameter.name]
    if value == parameter.null:
        return True  # of an effect with several amplitudes, one that is not there
    low, high = added.ci95.get(parameter.name, (value, value))
    return low <= parameter.plausible[1] and high >= parameter.plausible[0]


def bounded_amplitudes(target: FloatArray, columns: FloatArray, bounds: FloatArray) -> tuple[FloatArray, float]:
    """Bounded linear least squares in few unknowns.

    Parameters
    ----------
    target : array, shape (M,)
        Whitened residual, or its projection onto the columns' space.
    columns : array, shape (M, k)
        Whitened.
    bounds : array, shape (2, k)
        Lower and upper.

    Returns
    -------
    tuple of (array of shape (k,), float)
        Amplitudes, and by how much they lower the sum of squares.
    """
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    left, triangle = np.linalg.qr(columns / size)
    y = left.T @ target
    scaled = np.linalg.lstsq(triangle, y, rcond=1e-9)[0]
    if np.any(scaled < bounds[0] * size) or np.any(scaled > bounds[1] * size):
        low, high = bounds[0] * size, bounds[1] * size
        scaled = optimize.lsq_linear(triangle, y, bounds=(low, np.maximum(high, low + 1e-300)), method="bvls").x
    rest = y - triangle @ scaled
    return scaled / size, float(y @ y - rest @ rest)


def refit(
    observations: Observations,
    whitening: Whitening,
    start: Sequence[Start],
    fixed: Mapping[str, Mapping[str, float]] | None = None,
    prior_sd: Mapping[str, float] | None = None,
) -> Refit:
    """Fit effects within their bounds, all parameters that these readings see.

    Parameters
    ----------
    start : sequence of (EffectColumns, array of shape (k,))
        Effects with amplitudes to start from.
    fixed : mapping of str to mapping, or None
        Per effect, parameters that stay as they are.
    prior_sd : mapping of str to float, or None
        Per effect, the standard deviation about their nulls that its parameters are known to have beforehand.

    Returns
    -------
    Refit
        At the least weighted sum of squares that was found.
    """
    fixed, prior_sd = fixed or {}, prior_sd or {}
    initial = [one.parameters(amplitude) for one, amplitude in start]
    free = tuple(
        (k, p)
        for k, (one, _) in enumerate(start)
        for p in (*one.amplitudes, *_seen_constants(one, observations))
        if p.name not in fixed.get(one.effect.name, {})
    )
    for k, (one, _) in enumerate(start):  # constants that nothing depends on stand where they usually are
        seen = {p.name for number, p in free if number == k} | set(fixed.get(one.effect.name, {}))
        initial[k] |= {p.name: p.null for p in one.effect.parameters if p.nonlinear and p.name not in seen}
    width = np.array([p.plausible[1] - p.plausible[0] for _, p in free])
    low = np.array([p.lower for _, p in free]) / width
    high = np.array([p.upper for _, p in free]) / width
    null = np.array([p.null for _, p in free]) / width
    root = width / np.array([prior_sd.get(start[k][0].effect.name, np.inf) for k, _ in free])
    x0 = np.clip(np.array([initial[k][p.name] for k, p in free]) / width, low, high)

    def effects_at(x: FloatArray) -> tuple[AddedEffect, ...]:
        values = [dict(parameters) for parameters in initial]
        for (k, p), scaled, w in zip(free, x, width, strict=True):
            values[k][p.name] = float(scaled * w)
        return tuple(AddedEffect(one.effect, v) for (one, _), v in zip(start, values, strict=True))

    def rest(x: FloatArray) -> FloatArray:
        return whitening.full(observations.value - observations.predict(effects_at(x)))

    def with_prior(x: FloatArray) -> FloatArray:
        return np.concatenate([rest(x), root * (x - null)])

    inner = np.clip(x0, low + 1e-6, high - 1e-6)
    solution = optimize.least_squares(
        with_prior,
        inner,
        bounds=(low, high),
        method="trf",
        x_scale="jac",
        diff_step=np.full(len(x0), 1e-5),
        xtol=1e-6,
        ftol=1e-8,
        max_nfev=60,
    )
    x = _at_bounds(with_prior, solution.x, low, high)
    best = rest(x)
    active, jacobian = (x == low) | (x == high), np.asarray(solution.jac)[: len(best)]
    fit = Refit(effects_at(x), free, best, jacobian, active, root**2, tuple(one for one, _ in start))
    return replace(fit, effects=_with_intervals(fit, x, width))


def _at_bounds(
    residual: Callable[[FloatArray], FloatArray], x: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """A solution with those parameters at their bounds that are next to them and as good there.

    An interior method ends at a last bit's distance from a bound; a parameter that is not there must not count as one
    that was fitted.
    """
    chi2 = float(np.sum(residual(x) ** 2))
    for bound in (low, high):
        for j in np.flatnonzero(np.abs(x - bound) < _NEXT_TO):
            there = x.copy()
            there[j] = bound[j]
            moved = float(np.sum(residual(there) ** 2))
            if moved <= chi2 + _AS_GOOD:
                x, chi2 = there, moved
    return x


def _seen_constants(one: EffectColumns, observations: Observations) -> list[EffectParameter]:
    """The shape constants that change what the effect's amplitudes do to these readings."""
    constants = [p for p in one.effect.parameters if p.nonlinear]
    some = np.array([0.1 * (p.plausible[1] - p.plausible[0]) for p in one.amplitudes])
    values = one.parameters(np.where(some <= one.bounds[1], some, -some))
    here = observations.predict([AddedEffect(one.effect, values)])

    def seen(p: EffectParameter) -> bool:
        step = 0.1 * (p.plausible[1] - p.plausible[0])
        other = values[p.name] + (step if values[p.name] + step <= p.upper else -step)
        return bool(np.any(observations.predict([AddedEffect(one.effect, values | {p.name: other})]) != here))

    return [p for p in constants if seen(p)]


def _with_intervals(fit: Refit, x: FloatArray, width: FloatArray) -> tuple[AddedEffect, ...]:
    """The effects with 95 % intervals of what moves the prediction and is off its bounds, from the curvature."""
    intervals: list[dict[str, tuple[float, float]]] = [{} for _ in fit.effects]
    half = stats.norm.isf(0.025) * np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    for j in np.flatnonzero(~fit.active & np.any(fit.jacobian != 0.0, axis=0)):
        k, p = fit.free[j]
        intervals[k][p.name] = (float((x[j] - half[j]) * width[j]), float((x[j] + half[j]) * width[j]))
    return tuple(AddedEffect(a.effect, a.parameters, ci) for a, ci in zip(fit.effects, intervals, strict=True))
