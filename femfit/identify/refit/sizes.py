"""How large an added effect is in each channel, and whether that is plausible."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.core.text import amount, amount_in, amount_range, rounded
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.effects.words import describe, range_of, size_of
from femfit.identify.constants import COLUMN_STEP, LEAST_CHANGE
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import Refit, is_plausible
from femfit.tables.measurement import CHANNEL_WORDS


@dataclass(frozen=True)
class EffectSize:
    """What an added effect changes of one channel, where it changes it most within the data."""

    effect: str
    channel: str
    change: float
    ci95: tuple[float, float]
    # ``change`` over the largest magnitude that the base predicts for this channel; None where it predicts nothing
    of_largest: float | None
    distance_m: float
    current_A: float

    def __str__(self) -> str:
        share = abs(self.of_largest or 0.0)
        part = f", {100.0 * share:.2g} % of its largest" if share <= 1.0 else f", {rounded(share, 2)} times its largest"
        return (
            f"changes the {CHANNEL_WORDS[self.channel]} by up to {amount_in(self.change, *self.ci95, self.channel)} "
            f"(95 %: {amount_range(*self.ci95, self.channel)}){part if self.of_largest is not None else ''}, at "
            f"{amount(self.distance_m, 'distance_m', 3)} and {amount(self.current_A, 'current_A')}"
        )


def effect_sizes(observations: Observations, fit: Refit) -> tuple[EffectSize, ...]:
    """The largest change that each effect makes of each channel within the data, with its 95 % interval."""
    weight = np.ones_like(observations.value) if observations.weight is None else observations.weight
    base = observations.base / weight
    largest = [float(np.abs(base[observations.of(name)]).max()) for name in observations.channels]
    result = []
    for k, added in enumerate(fit.effects):
        change = _change(observations, fit.effects, k) / weight
        for c, channel in enumerate(observations.channels):
            here = np.flatnonzero(observations.channel == c)
            at = here[np.argmax(np.abs(change[here]))] if len(here) else -1
            if at < 0 or abs(change[at]) < LEAST_CHANGE * largest[c]:
                continue
            half = stats.norm.isf(0.025) * _standard_error(observations, fit, k, int(at)) / weight[at]
            result.append(
                EffectSize(
                    effect=added.effect.name,
                    channel=channel,
                    change=float(change[at]),
                    ci95=(float(change[at] - half), float(change[at] + half)),
                    of_largest=float(change[at]) / largest[c] if largest[c] else None,
                    distance_m=float(observations.column("distance_m")[at]),
                    current_A=float(observations.column("current_A")[at]),
                )
            )
    return tuple(result)


def _change(observations: Observations, effects: tuple[AddedEffect, ...], k: int) -> FloatArray:
    """What the predictions gain by effect k, the others in place."""
    return observations.predict(effects) - observations.predict(effects[:k] + effects[k + 1 :])


def _standard_error(observations: Observations, fit: Refit, k: int, at: int) -> float:
    """The variance of the change that effect k makes at one reading, to first order."""
    own = [j for j, (number, _) in enumerate(fit.free) if number == k and not fit.active[j]]
    here = observations.select(np.arange(len(observations.value)) == at)
    slopes = []
    for j in own:
        added, p = fit.effects[k], fit.free[j][1]
        value, step = added.parameters[p.name], COLUMN_STEP * (p.plausible[1] - p.plausible[0])
        ends = (min(value + step, p.upper), max(value - step, p.lower))
        moved = [
            (*fit.effects[:k], replace(added, parameters={**added.parameters, p.name: x}), *fit.effects[k + 1 :])
            for x in ends
        ]
        up, down = (float(here.predict(effects)[0]) for effects in moved)
        slopes.append((up - down) / (ends[0] - ends[1]) * (p.plausible[1] - p.plausible[0]))
    slope = np.array(slopes)
    return float(np.sqrt(max(slope @ fit.covariance[np.ix_(own, own)] @ slope, 0.0))) if own else 0.0


def suspicious_values(
    observations: Observations, fit: Refit, sizes: tuple[EffectSize, ...], beside: Collection[str]
) -> tuple[str, ...]:
    """What is unusual of fitted parameters, one sentence each.

    Tolerances of the drawing that were fitted beside the effects may well be zero.
    """
    nominal, result = observations.nominal, list[str]()
    if not fit.converged:
        result.append("The fit was ended before it had settled: do not trust these sizes. Start from fewer effects.")
    for added in fit.effects:
        for p in (_clocked(p, observations) for p in added.effect.parameters if not is_plausible(added, p)):
            result.append(
                f"{_words(added, p, nominal)}. That is unusual: {range_of(p, *p.plausible, nominal)} is usual. Check "
                "it by another measurement."
            )
    for k, p in at_bounds(fit):
        result.append(
            f"{_words(fit.effects[k], _clocked(p, observations), nominal)}. That is the end of its range, not a "
            "measured size: do not trust the new model where it matters."
        )
    for added in fit.effects:
        name = added.effect.name
        if name not in beside and all(s.ci95[0] <= 0.0 <= s.ci95[1] for s in sizes if s.effect == name):
            result.append(f"{name} may be absent: no change of any channel differs from zero with 95 % confidence.")
    return tuple(result)


def at_bounds(fit: Refit) -> list[tuple[int, EffectParameter]]:
    """Parameters that stand at a bound other than their null, each with the number of its effect."""
    ends = [fit.free[j] for j in np.flatnonzero(fit.active)]
    return [
        (k, p)
        for k, p in ends
        if abs(fit.effects[k].parameters[p.name] - p.null) > 1e-3 * (p.plausible[1] - p.plausible[0])
    ]


def _clocked(p: EffectParameter, observations: Observations) -> EffectParameter:
    """A time with the unit that these data count it in."""
    unit = "s" if "time_s" in observations.given else "readings"
    return replace(p, unit=unit) if p.unit == "readings or s" else p


def _words(added: AddedEffect, p: EffectParameter, nominal: Nominal) -> str:
    """An effect's parameter as a clause."""
    value = added.parameters[p.name]
    alone = AddedEffect(added.effect, added.effect.null() | {p.name: value})
    clauses = [] if p.nonlinear else describe(alone, nominal)
    what = clauses[0] if clauses else f"{p.description.rstrip('.')}: {size_of(p, value, nominal)}"
    return f"{added.effect.name}: {what}"
