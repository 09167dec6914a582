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
from dataclasses import dataclass
from typing import Literal

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.effects.catalogue import effects_of
from femfit.effects.effect import AddedEffect
from femfit.effects.tolerances import TOLERANCE_SD, TOLERANCES
from femfit.effects.words import describe
from femfit.identify.constants import HARMS, HELPS, SETTLED
from femfit.identify.noise.whitening import NoiseModel, Whitening, random_columns
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


def unseen_error(
    observations: Observations,
    noise: NoiseModel,
    start: Sequence[Start],
    fixed: Mapping[str, Mapping[str, float]] | None = None,
    prior_sd: Mapping[str, float] | None = None,
    prior_mean: Mapping[str, float] | None = None,
) -> UnseenError:
    """Cross-validate effects over the runs of a campaign."""

    def fitted(keep: BoolArray) -> tuple[AddedEffect, ...]:
        readings = observations.select(keep)
        whitening = Whitening.granting(readings, noise)
        return refit(readings, whitening, start, fixed, prior_sd, prior_mean).effects

    return cross_validated(observations, noise, fitted)


def cross_validated(
    observations: Observations, noise: NoiseModel, fitted: Callable[[BoolArray], tuple[AddedEffect, ...]]
) -> UnseenError:
    """The error on each run by the effects that are fitted to the readings that stay, which have the shape (M,)."""
    group = left_out_groups(observations)
    beside, as_read = np.zeros(len(group)), np.zeros(len(group))
    chi2, effects = 0.0, {}
    for number in np.unique(group):
        out = group == number
        unseen, effects[int(number)] = observations.select(out), fitted(~out)
        residual = unseen.value - unseen.predict(effects[int(number)])
        whitening = Whitening(unseen, noise)
        as_read[out], beside[out] = residual, beside_random(residual, whitening)
        white = whitening.full(residual)
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
    start = [*starting_point(observations, whitening, visible, at_null=True), *_restart(alone.fit)]
    together = checked_refit(whitening, start, {effect.name: TOLERANCE_SD for effect in visible})
    helps = together.error.chi2 < alone.error.chi2 - HELPS
    limits = alone.error.rms_beside_random
    harms = any(rms > HARMS * limits[name] for name, rms in together.error.rms_beside_random.items())
    return together if base == "always" or (helps and not harms) else alone, dropped


def checked_refit(
    whitening: Whitening, start: Sequence[Start], prior_sd: Mapping[str, float] | None = None
) -> CheckedRefit:
    """A refit of what the data show: without amplitudes that they do not identify, and without extrapolated ends."""
    observations = whitening.observations
    fit = refit(observations, whitening, start, prior_sd=prior_sd)
    fixed = _unsettled(observations, fit)
    if fixed:
        fit = refit(observations, whitening, _restart(fit), fixed=fixed, prior_sd=prior_sd)
    identified = _identified(fit)
    if any(start_kept.count < start_full.count for start_kept, start_full in zip(identified, fit.start, strict=True)):
        fit = refit(observations, whitening, identified, fixed=fixed, prior_sd=prior_sd)
    error = unseen_error(observations, whitening.noise, _restart(fit), fixed, prior_sd)
    findings = tuple(finding("not-settled", name=name) for name in fixed)
    return CheckedRefit(fit, error, findings)


def better_alone(whitening: Whitening, effects: Refit, beside: Sequence[Start]) -> str:
    """The tolerances that were fitted beside effects, in words, where they explain more by themselves than these do."""
    if not beside:
        return ""
    observations = whitening.observations
    prior = {tolerance.name: TOLERANCE_SD for tolerance in beside}
    start = starting_point(observations, whitening, [tolerance.columns.effect for tolerance in beside])
    fit = refit(observations, whitening, start, prior_sd=prior)
    if fit.chi2 >= effects.chi2:
        return ""
    return "; ".join(clause for effect in fit.effects for clause in describe(effect, observations.nominal))


def _restart(fit: Refit) -> list[Start]:
    """A fit as the start of another."""
    return [start.continued(added) for start, added in zip(fit.start, fit.effects, strict=True)]


def _unsettled(observations: Observations, fit: Refit) -> dict[str, dict[str, float]]:
    """Time constants of changes of the circuit that are longer than the runs, with what they are held at instead.

    The new model runs with the end of such a change. A fit to its beginning says only its rate, and would put an end
    into the circuit that nobody has seen.
    """
    clock = observations.column("time_s" if "time_s" in observations.covariates else "order")
    longest = float(clock.max()) / SETTLED
    result: dict[str, dict[str, float]] = {}
    for k, p in fit.free:
        added = fit.effects[k]
        slow = p.nonlinear and p.name.endswith("_time") and added.parameters[p.name] > longest
        if slow and added.effect.circuit is not None:
            result[added.effect.name] = {p.name: max(longest, p.lower)}
    return result


def _identified(fit: Refit) -> list[Start]:
    """A fit as the start of another, without the amplitudes that the data do not identify; one stays at least.

    Their interval holds the null and more than their plausible range.
    """
    result = []
    for start, added in zip(_restart(fit), fit.effects, strict=True):
        keep = []
        for k, p in enumerate(start.columns.amplitudes):
            low, high = added.ci95.get(p.name, (np.nan, np.nan))
            if not (low < p.null < high and high - low > p.plausible[1] - p.plausible[0]):
                keep.append(k)
        result.append(start.part(keep) if keep else start)
    return result
