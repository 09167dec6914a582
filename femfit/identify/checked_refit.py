"""Refits of what the data show, checked on runs left out, with tolerances of the drawing beside where these help.

Each run is left out in turn and the effects are fitted to the others, without any linearisation. Where a body was put
back and by what a run is offset as a whole no model can know, so these are predicted from the left-out run itself
before its error is counted: what remains is compared with the scatter of a single reading.

References
----------
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
G. K. Robinson, Statistical Science 6 (1991) 15: best linear unbiased prediction of random effects.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.effects.catalogue import effects_of
from femfit.effects.effect import AddedEffect
from femfit.effects.tolerances import TOLERANCE_SD, TOLERANCES
from femfit.effects.words import describe
from femfit.identify.constants import HARMS, HELPS, SETTLED
from femfit.identify.noise.whitening import Whitening, random_columns
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, Start, refit, starting_point
from femfit.identify.signatures import effect_columns, why_untestable
from femfit.identify.words import finding


@dataclass(frozen=True, eq=False)
class UnseenError:
    """Error on runs left out, all of them in turn; on quarters of a single run."""

    rms: Mapping[str, float]  # Root mean square of recorded minus predicted per channel
    rms_beside_random: Mapping[str, float]  # The same with each run's own re-mount and offset predicted from that run
    chi2: float  # Weighted sum of squares over all noise, re-mounts and offsets
    # What was fitted without each group, by its number, as the rows are grouped
    effects: Mapping[int, tuple[AddedEffect, ...]]


def unseen_error(whitening: Whitening, fit: Refit) -> UnseenError:
    """Cross-validate the effects of a fit over the runs of a campaign."""

    def fitted(keep: BoolArray) -> tuple[AddedEffect, ...]:
        readings = whitening.observations.select(keep)
        return refit(Whitening.granting(readings, whitening.noise), fit.restart).effects

    return cross_validated(whitening, fitted)


def cross_validated(whitening: Whitening, fitted: Callable[[BoolArray], tuple[AddedEffect, ...]]) -> UnseenError:
    """The error on each run by the effects that are fitted to the readings that stay, which have the shape (M,)."""
    observations = whitening.observations
    group = left_out_groups(observations)
    beside, as_read = np.zeros(len(group)), np.zeros(len(group))
    chi2, effects = 0.0, {}
    for number in np.unique(group):
        out = group == number
        unseen, effects[int(number)] = observations.select(out), fitted(~out)
        residual, alone = unseen.value - unseen.predict(effects[int(number)]), Whitening(unseen, whitening.noise)
        as_read[out], beside[out] = residual, beside_random(residual, alone)
        white = alone.full(residual)
        chi2 += float(white @ white)
    return UnseenError(observations.rms(as_read), observations.rms(beside), chi2, effects)


def left_out_groups(observations: Observations) -> IntArray:
    """The run of each reading, shape (M,); with a single run, four stretches of it."""
    run = observations.column("run").astype(int)
    if len(np.unique(run)) > 1:
        return run
    order: FloatArray = observations.column("order")
    return np.asarray(np.searchsorted(np.quantile(order, [0.25, 0.5, 0.75]), order))


def beside_random(residual: FloatArray, whitening: Whitening) -> FloatArray:
    """A residual, shape (M,), without the best linear unbiased prediction of its re-mounts and runs."""
    columns, deviations = random_columns(whitening.observations, whitening.noise.mount_m, whitening.noise.run)
    columns = columns * deviations
    white = whitening.serial(columns)
    size = np.linalg.solve(white.T @ white + np.eye(white.shape[1]), white.T @ whitening.serial(residual))
    return np.asarray(residual - columns @ size)


Base = Literal["auto", "always", "never"]


@dataclass(frozen=True, eq=False)
class CheckedRefit:
    """A refit, its error on runs left out, and what was held."""

    fit: Refit
    error: UnseenError
    findings: tuple[Finding, ...] = ()


def with_tolerances(whitening: Whitening, alone: CheckedRefit, base: Base) -> tuple[CheckedRefit, list[Finding]]:
    """The refit with the tolerances beside the effects, where wanted, and what was dropped."""
    observations = whitening.observations
    tolerances = effects_of(
        {tolerance.name: tolerance for tolerance in TOLERANCES}, observations.nominal.circuits
    ).values()
    testable = [e for e in tolerances if e.name not in alone.fit.names and not why_untestable(e, observations)]
    visible = [effect for effect in testable if effect_columns(effect, observations)]
    dropped = [finding("tolerance-dropped", name=effect.name) for effect in testable if effect not in visible]
    if base == "never" or not visible:
        return alone, [] if base == "never" else dropped
    drawn = [
        replace(tolerance, amplitude=np.zeros(tolerance.count), prior_sd=TOLERANCE_SD)
        for tolerance in starting_point(whitening, visible)
    ]
    together = checked_refit(whitening, [*drawn, *alone.fit.restart])
    helps = together.error.chi2 < alone.error.chi2 - HELPS
    limits = alone.error.rms_beside_random
    harms = any(rms > HARMS * limits[name] for name, rms in together.error.rms_beside_random.items())
    return together if base == "always" or (helps and not harms) else alone, dropped


def checked_refit(whitening: Whitening, start: Sequence[Start]) -> CheckedRefit:
    """A refit of what the data show: without amplitudes that they do not identify, and without extrapolated ends."""
    fit = refit(whitening, start)
    for values_of in (_unsettled, _unidentified):
        held = values_of(whitening.observations, fit)
        if any(held):
            restart = zip(fit.restart, held, strict=True)
            fit = refit(whitening, [replace(effect, held={**effect.held, **values}) for effect, values in restart])
    slow = [
        effect.name
        for effect in fit.start
        if any(p.name in effect.held for p in effect.columns.effect.parameters if p.nonlinear)
    ]
    findings = tuple(finding("not-settled", name=name) for name in slow)
    return CheckedRefit(fit, unseen_error(whitening, fit), findings)


def better_alone(whitening: Whitening, effects: Refit, beside: Sequence[Start]) -> str:
    """The tolerances that were fitted beside effects, in words, where they explain more by themselves than these do."""
    if not beside:
        return ""
    start = starting_point(whitening, [tolerance.columns.effect for tolerance in beside])
    fit = refit(whitening, [replace(tolerance, prior_sd=TOLERANCE_SD) for tolerance in start])
    if fit.chi2 >= effects.chi2:
        return ""
    nominal = whitening.observations.nominal
    return "; ".join(clause for effect in fit.effects for clause in describe(effect, nominal))


def _unsettled(observations: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect time constants of the circuit that are longer than the runs, held at these.

    The new model runs with the end of such a change. A fit to its beginning says only its rate, and would put an end
    into the circuit that nobody has seen.
    """
    clock = observations.column("time_s" if "time_s" in observations.covariates else "order")
    longest = float(clock.max()) / SETTLED
    held: list[dict[str, float]] = [{} for _ in fit.effects]
    for k, p in fit.free:
        added = fit.effects[k]
        slow = p.nonlinear and p.name.endswith("_time") and added.parameters[p.name] > longest
        if slow and added.effect.circuit is not None:
            held[k] = {p.name: max(longest, p.lower)}
    return held


def _unidentified(_: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect the amplitudes that the data do not identify, held at their nulls; one stays free at least.

    Their interval holds the null and more than their plausible range.
    """
    held: list[dict[str, float]] = []
    for start, added in zip(fit.start, fit.effects, strict=True):
        free = [p for p in start.columns.amplitudes if p.name not in start.held]
        limits = [(p, *added.ci95.get(p.name, (np.nan, np.nan))) for p in free]
        vague = {p.name: p.null for p, low, high in limits if low < p.null < high and high - low > p.width}
        held.append(vague if len(vague) < len(free) else {})
    return held
