"""Adds effects to a model: a bounded refit to measurements, checked on runs left out.

Tolerances of the drawing (the magnet's strength, the turns, the resistance) may be fitted beside the effects, held by a
prior: without them an effect would mop up a base that is slightly off. They are used where they lower the weighted
error on runs left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect, Effect
from femfit.effects.tolerances import TOLERANCE_SD, TOLERANCES
from femfit.effects.words import describe
from femfit.identify.comparison.fall import error_fall
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.decision.campaign import NO_NOISE, TOO_FEW, guessed_noises
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import model_of, placed
from femfit.identify.refit.add_result import AddResult, Step
from femfit.identify.refit.refit import Refit, refit
from femfit.identify.refit.sizes import effect_sizes, suspicious_values
from femfit.identify.refit.start import Start, starting_point
from femfit.identify.refit.unseen import UnseenError, channel_rms, unseen_error
from femfit.identify.signatures.columns import effect_columns, why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement
from femfit.tables.measurement_file import read_measurement

_HELPS = 9.0
"""Conventional: fall of the weighted error on runs left out from which tolerances are used (three deviations)."""

_HARMS = 1.05
"""Assumed: rise of a channel's error on runs left out from which they are not, whatever the other channels gain."""

_SETTLED = 2.0
"""Assumed: time constants that the longest run must last for it to show where an effect settles (to 14 %)."""

Base = Literal["auto", "always", "never"]


@dataclass(frozen=True, eq=False)
class _Readings:
    """Readings beside the model without what is refitted, and their noise."""

    observations: Observations
    noise: NoiseModel
    whitening: Whitening


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A refit, its error on runs left out, and what was held."""

    fit: Refit
    error: UnseenError
    findings: tuple[Finding, ...] = ()


def add_effects(
    model: ActuatorModel | str | Path,
    data: Measurement | str | Path,
    effects: str | Sequence[str] | Diagnosis,
    *,
    base: Base = "auto",
    coil_temperature_C: float | None = None,
    magnet_temperature_C: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> AddResult:
    """Refit a model with effects.

    Parameters
    ----------
    model : ActuatorModel or path
        Effects that it has already are refitted with the new ones where the data can show them.
    data : BenchTable or TimeSeries, or a path
        What was measured.
    effects : str, sequence of str, or Diagnosis
        Effects of the catalogue in the order of adding, or what a diagnosis names; one that the model has already is
        refitted.
    base : {"auto", "always", "never"}
        Whether tolerances of the drawing are fitted beside the effects; ``auto`` where that helps on runs left out and
        makes no channel worse.
    coil_temperature_C, magnet_temperature_C : float or None
        At which the new model runs; None for the mean of what was recorded, or the model's own.

    Raises
    ------
    ModelFileError
        If no effect has a name.
    TableError
        If the data cannot show an effect, their noise is unknown, or they are too few.

    Examples
    --------
    >>> model = ff.read_model("model.json")
    >>> better = ff.add_effects(model, "bench.csv", ["coil_temperature", "core_saturation"])
    >>> for one in better.fall.channels:
    ...     print(f"{one.channel}: {one.before_over_noise:.1f} -> {one.after_over_noise:.1f} times the noise")
    force_N: 2.3 -> 1.1 times the noise
    flux_linkage_Wb: 10.6 -> 1.0 times the noise
    hall_V: 1.6 -> 1.4 times the noise
    voltage_V: 15.1 -> 1.0 times the noise
    >>> ff.write_model(better.model, "better.json")
    """
    say = progress or (lambda _: None)
    say("Reading")
    model = model_of(model)
    measured = read_measurement(data) if isinstance(data, str | Path) else data
    kept, given, new = _split(model, _names(effects), measured)
    readings = _readings(placed(with_effects(model, kept), measured))
    observations, whitening = readings.observations, readings.whitening
    wanted = [*(added.effect for added in given), *new]
    for effect in wanted:
        if reason := why_untestable(effect, observations):
            raise TableError(f"Effect {effect.name} cannot be fitted to these data: {reason}. {effect.experiment}")
    say("Fitting the effects")
    start = starting_point(observations, whitening, wanted)
    partial = [refit(observations, whitening, start[:k]).effects for k in range(len(given) + 1, len(start))]
    alone = _fitted(readings, start)
    say("Fitting the tolerances of the drawing beside them")
    fitted, dropped = _with_tolerances(readings, alone, base)
    better_alone = _better_alone(readings, alone.fit, fitted.fit.start[: len(fitted.fit.start) - len(start)])
    fit, beside = fitted.fit, len(fitted.fit.effects) - len(start)
    before, after = observations.predict(given), observations.predict(fit.effects)
    stages = [(effect.name, one) for effect, one in zip(new, [*partial, alone.fit.effects], strict=False)]
    stages += [("tolerances" if beside else "refit", fit.effects)] if beside or not new else []
    sizes = effect_sizes(observations, fit)
    patterns = pattern_space(observations, whitening)
    known = {name: sd for name, sd in readings.noise.floor.items() if name in readings.noise.source}
    return AddResult(
        model=with_effects(
            _at_temperature(model, observations, coil_temperature_C, magnet_temperature_C), (*kept, *fit.effects)
        ),
        added=fit.effects[beside:],
        base=fit.effects[:beside],
        kept=tuple(added.effect.name for added in kept),
        fall=error_fall(observations, before, after, known),
        left_out=fitted.error.rms,
        floor=known,
        floor_source=readings.noise.source,
        steps=(
            Step("model", channel_rms(observations, observations.value - before)),
            *(
                Step(text, channel_rms(observations, observations.value - observations.predict(e)))
                for text, e in stages
            ),
        ),
        sizes=sizes,
        suspicious=suspicious_values(observations, fit, sizes, {added.effect.name for added in fit.effects[:beside]}),
        lack_of_fit_before=patterns.test(whitening.full(observations.value - before)),
        lack_of_fit_after=patterns.test(fit.whitened_residual, fit.jacobian[:, ~fit.active]),
        readings=len(observations.value),
        runs=len(np.unique(observations.column("run"))),
        observations=observations,
        findings=(*observations.findings, *fitted.findings, *dropped, *guessed_noises(readings.noise)),
        better_alone=better_alone,
    )


def _better_alone(readings: _Readings, effects: Refit, beside: Sequence[Start]) -> str:
    """The tolerances that were fitted beside effects, in words, where they explain more by themselves than these do."""
    if not beside:
        return ""
    observations, whitening = readings.observations, readings.whitening
    prior = {one.name: TOLERANCE_SD for one in beside}
    start = starting_point(observations, whitening, [one.columns.effect for one in beside])
    fit = refit(observations, whitening, start, prior_sd=prior)
    if fit.chi2 >= effects.chi2:
        return ""
    return "; ".join(clause for one in fit.effects for clause in describe(one, observations.nominal))


def _names(effects: str | Sequence[str] | Diagnosis) -> list[str]:
    if isinstance(effects, Diagnosis):
        if not effects.missing:
            raise TableError("The diagnosis names no effect, so there is nothing to add. Give the names of effects.")
        return [one.name for one in effects.missing]
    names = [effects] if isinstance(effects, str) else list(effects)
    if not names:
        raise TableError(
            "No effect is given, so there is nothing to add. Give names that list_effects has, or a diagnosis."
        )
    return names


def _split(
    model: ActuatorModel, names: Sequence[str], data: Measurement
) -> tuple[tuple[AddedEffect, ...], tuple[AddedEffect, ...], list[Effect]]:
    """(effects that stay as they are, those that are refitted, those that are new).

    An effect of the model stays where these data cannot show it; one that the user names is never among those.
    """
    wanted = [effect_by_name(name) for name in dict.fromkeys(names)]
    named = {effect.name for effect in wanted}
    bare = placed(with_effects(model, ()), data) if model.effects else None
    stays = [
        bare is not None and added.effect.name not in named and bool(why_untestable(added.effect, bare))
        for added in model.effects
    ]
    kept = tuple(added for added, stay in zip(model.effects, stays, strict=True) if stay)
    given = tuple(added for added, stay in zip(model.effects, stays, strict=True) if not stay)
    present = {added.effect.name for added in given}
    return kept, given, [effect for effect in wanted if effect.name not in present]


def _readings(observations: Observations) -> _Readings:
    noise = estimate_noise(observations)
    if noise is None:
        raise TableError(str(NO_NOISE))
    whitening = Whitening(observations, noise, chains_of(observations))
    if not pattern_space(observations, whitening).groups:
        raise TableError(str(TOO_FEW))
    return _Readings(observations, noise, whitening)


def _fitted(readings: _Readings, start: Sequence[Start], prior_sd: Mapping[str, float] | None = None) -> _Fitted:
    """A refit of what the data show: without amplitudes that they do not identify, and without extrapolated ends."""
    observations, whitening = readings.observations, readings.whitening
    fit = refit(observations, whitening, start, prior_sd=prior_sd)
    fixed = _unsettled(observations, fit)
    if fixed:
        fit = refit(observations, whitening, _restart(fit), fixed=fixed, prior_sd=prior_sd)
    identified = _identified(fit)
    if any(one.count < whole.count for one, whole in zip(identified, fit.start, strict=True)):
        fit = refit(observations, whitening, identified, fixed=fixed, prior_sd=prior_sd)
    error = unseen_error(observations, readings.noise, _restart(fit), fixed, prior_sd)
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
    return _Fitted(fit, error, findings)


def _restart(fit: Refit) -> list[Start]:
    """A fit as the start of another."""
    return [one.continued(added) for one, added in zip(fit.start, fit.effects, strict=True)]


def _unsettled(observations: Observations, fit: Refit) -> dict[str, dict[str, float]]:
    """Time constants of changes of the circuit that are longer than the runs, with what they are held at instead.

    The new model runs with the end of such a change. A fit to its beginning says only its rate, and would put an end
    into the circuit that nobody has seen.
    """
    clock = observations.column("time_s" if "time_s" in observations.covariates else "order")
    longest = float(clock.max()) / _SETTLED
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


def _with_tolerances(readings: _Readings, alone: _Fitted, base: Base) -> tuple[_Fitted, list[Finding]]:
    """The refit with the tolerances beside the effects, where wanted, and what was dropped."""
    observations = readings.observations
    testable = [e for e in TOLERANCES if e.name not in alone.fit.names and not why_untestable(e, observations)]
    visible = [effect for effect in testable if effect_columns(effect, observations)]
    dropped = [
        Finding("tolerance-dropped", "info", f"{effect.name} changes no reading here, so it was not fitted beside.")
        for effect in testable
        if effect not in visible
    ]
    if base == "never" or not visible:
        return alone, [] if base == "never" else dropped
    start = [*starting_point(observations, readings.whitening, visible, at_null=True), *_restart(alone.fit)]
    together = _fitted(readings, start, {effect.name: TOLERANCE_SD for effect in visible})
    helps = together.error.chi2 < alone.error.chi2 - _HELPS
    limits = alone.error.rms_beside_random
    harms = any(rms > _HARMS * limits[name] for name, rms in together.error.rms_beside_random.items())
    return together if base == "always" or (helps and not harms) else alone, dropped


def _at_temperature(
    model: ActuatorModel, observations: Observations, coil_C: float | None, magnet_C: float | None
) -> ActuatorModel:
    """The model at the temperatures where it is to run."""

    def chosen(option: float | None, name: str, own: float) -> float:
        recorded = observations.covariates[name].to_numpy()
        recorded = recorded[np.isfinite(recorded)]
        if option is not None:
            return option
        return round(float(recorded.mean()), 1) if len(recorded) else own

    return replace(
        model,
        coil_temperature_C=chosen(coil_C, "coil_temperature_C", model.coil_temperature_C),
        magnet_temperature_C=chosen(magnet_C, "magnet_temperature_C", model.magnet_temperature_C),
    )
