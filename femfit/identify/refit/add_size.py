"""How large an added effect is in each channel, and whether that is plausible."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from scipy import stats

from femfit.core.arrays import FloatArray
from femfit.effects.effect import AddedEffect
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.add_result import EffectSize
from femfit.identify.refit.refit import Refit, usual

_STEP = 1e-3
"""Step of a difference over a parameter's plausible range."""

_LEAST_CHANGE = 1e-6
"""Of the channel's largest value: less is rounding."""


def effect_sizes(observations: Observations, fit: Refit) -> tuple[EffectSize, ...]:
    """The largest change that each effect makes of each channel within the data.

    Parameters
    ----------
    fit : Refit
        Of the effects; amplitudes of the base count as effects too.

    Returns
    -------
    tuple of EffectSize
        One an effect and channel that it changes, with the interval that the parameters' covariance gives.
    """
    largest = [float(np.abs(observations.base[observations.of(name)]).max()) for name in observations.channels]
    result = []
    for k, added in enumerate(fit.effects):
        change = _change(observations, fit.effects, k)
        for c, channel in enumerate(observations.channels):
            here = np.flatnonzero(observations.channel == c)
            at = here[np.argmax(np.abs(change[here]))] if len(here) else -1
            if at < 0 or abs(change[at]) < _LEAST_CHANGE * largest[c]:
                continue
            half = stats.norm.isf(0.025) * _standard_error(observations, fit, k, int(at))
            result.append(
                EffectSize(
                    effect=added.effect.name,
                    channel=channel,
                    change=float(change[at]),
                    ci95=(float(change[at] - half), float(change[at] + half)),
                    of_largest=float(change[at]) / largest[c],
                    distance_m=float(observations.column("distance_m")[at]),
                    current_A=float(observations.column("current_A")[at]),
                )
            )
    return tuple(result)


def _change(observations: Observations, effects: tuple[AddedEffect, ...], k: int) -> FloatArray:
    """What the predictions gain by effect k, the others in place."""
    return observations.predict(effects) - observations.predict(effects[:k] + effects[k + 1 :])


def _standard_error(observations: Observations, fit: Refit, k: int, at: int) -> float:
    """Of the change that effect k makes at one reading, to first order."""
    own = [j for j, (number, _) in enumerate(fit.free) if number == k and not fit.active[j]]
    here = observations.select(np.arange(len(observations.value)) == at)
    slopes = []
    for j in own:
        added, p = fit.effects[k], fit.free[j][1]
        value, step = added.parameters[p.name], _STEP * (p.plausible[1] - p.plausible[0])
        ends = (min(value + step, p.upper), max(value - step, p.lower))
        moved = [
            (*fit.effects[:k], replace(added, parameters={**added.parameters, p.name: x}), *fit.effects[k + 1 :])
            for x in ends
        ]
        up, down = (float(here.predict(effects)[0]) for effects in moved)
        slopes.append((up - down) / (ends[0] - ends[1]) * (p.plausible[1] - p.plausible[0]))
    slope = np.array(slopes)
    return float(np.sqrt(max(slope @ fit.covariance[np.ix_(own, own)] @ slope, 0.0))) if own else 0.0


def suspicious_values(fit: Refit, sizes: tuple[EffectSize, ...], beside: Collection[str]) -> tuple[str, ...]:
    """What is unusual of fitted parameters.

    Parameters
    ----------
    beside : collection of str
        Tolerances of the drawing that were fitted beside the effects: these may well be zero.

    Returns
    -------
    tuple of str
        One plain sentence each: outside of the usual range, at a bound, or a size that may be none.
    """
    result = []
    for added in fit.effects:
        name = added.effect.name
        for p in added.effect.parameters:
            value, (low, high) = added.parameters[p.name], p.plausible
            if not usual(added, p):
                span = f"{low:.3g} to {high:.3g}{f' {p.unit}' if p.unit else ''}"
                result.append(
                    f"{name}: {p.name} = {value:.3g} is unusual ({span} is usual): check it by another measurement."
                )
    for j in np.flatnonzero(fit.active):
        k, p = fit.free[j]
        added = fit.effects[k]
        value = added.parameters[p.name]
        if abs(value - p.null) > 1e-3 * (p.plausible[1] - p.plausible[0]):
            result.append(f"{added.effect.name}: {p.name} = {value:.3g} stands at its bound, so it has no interval.")
    for added in fit.effects:
        name = added.effect.name
        if name not in beside and all(s.ci95[0] <= 0.0 <= s.ci95[1] for s in sizes if s.effect == name):
            result.append(f"{name} may be absent: the 95 % interval of its change includes none in every channel.")
    return tuple(result)
