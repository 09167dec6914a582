"""Refits of what the data show, checked on runs left out, with tolerances of the drawing beside where these help."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from femfit.core.finding import Finding
from femfit.effects.of_circuits import effects_of
from femfit.effects.tolerances import TOLERANCE_SD, TOLERANCES
from femfit.effects.words import describe
from femfit.identify.constants import HARMS, HELPS, SETTLED
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import Refit, refit
from femfit.identify.refit.start import Start, starting_point
from femfit.identify.refit.unseen import UnseenError, unseen_error
from femfit.identify.signatures.columns import effect_columns, why_untestable

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
    tolerances = effects_of({one.name: one for one in TOLERANCES}, observations.nominal.circuits).values()
    testable = [e for e in tolerances if e.name not in alone.fit.names and not why_untestable(e, observations)]
    visible = [effect for effect in testable if effect_columns(effect, observations)]
    dropped = [
        Finding("tolerance-dropped", "info", f"{effect.name} changes no reading here, so it was not fitted beside.")
        for effect in testable
        if effect not in visible
    ]
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
    if any(one.count < whole.count for one, whole in zip(identified, fit.start, strict=True)):
        fit = refit(observations, whitening, identified, fixed=fixed, prior_sd=prior_sd)
    error = unseen_error(observations, whitening.noise, _restart(fit), fixed, prior_sd)
    findings = tuple(
        Finding(
            "not-settled",
            "warning",
            f"{name} had not settled within the longest run: the new model runs with what these data showed, "
            "not with where it would settle.",
            "Record longer, or measure its end by itself.",
        )
        for name in fixed
    )
    return CheckedRefit(fit, error, findings)


def better_alone(whitening: Whitening, effects: Refit, beside: Sequence[Start]) -> str:
    """The tolerances that were fitted beside effects, in words, where they explain more by themselves than these do."""
    if not beside:
        return ""
    observations = whitening.observations
    prior = {one.name: TOLERANCE_SD for one in beside}
    start = starting_point(observations, whitening, [one.columns.effect for one in beside])
    fit = refit(observations, whitening, start, prior_sd=prior)
    if fit.chi2 >= effects.chi2:
        return ""
    return "; ".join(clause for one in fit.effects for clause in describe(one, observations.nominal))


def _restart(fit: Refit) -> list[Start]:
    """A fit as the start of another."""
    return [one.continued(added) for one, added in zip(fit.start, fit.effects, strict=True)]


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
    for one, added in zip(_restart(fit), fit.effects, strict=True):
        keep = []
        for k, p in enumerate(one.columns.amplitudes):
            low, high = added.ci95.get(p.name, (np.nan, np.nan))
            if not (low < p.null < high and high - low > p.plausible[1] - p.plausible[0]):
                keep.append(k)
        result.append(one.part(keep) if keep else one)
    return result
