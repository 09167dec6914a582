"""Adds effects to a model: a bounded refit to measurements, checked on runs left out.

Tolerances of the drawing (the magnet's strength, the turns, the resistance) may be fitted beside the effects, held by a
prior: without them an effect would mop up a base that is slightly off. They are used where they lower the weighted
error on runs left out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from femfit.core.errors import TableError, UsageError
from femfit.core.numerics import ABSOLUTE_ZERO_C
from femfit.core.results import Finding
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect, Effect
from femfit.identify.comparison.fall import error_fall
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.comparison.patterns import own_misfit_columns
from femfit.identify.decision.campaign import NO_NOISE, TOO_FEW, guessed_noises
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.scatter import beyond_noise
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import measurement_of, placed
from femfit.identify.refit.add_result import AddResult, Step
from femfit.identify.refit.checked_refit import (
    Base,
    CheckedRefit,
    better_alone,
    channel_rms,
    checked_refit,
    with_tolerances,
)
from femfit.identify.refit.filter_fall import filter_fall
from femfit.identify.refit.refit import Start, refit, starting_point
from femfit.identify.refit.sizes import effect_sizes, suspicious_values
from femfit.identify.remainder.add import add_remainder, without_remainder
from femfit.identify.remainder.parts import NAME as UNEXPLAINED
from femfit.identify.remainder.result import RemainderResult
from femfit.identify.signatures import why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement, TimeSeries


def add_effects(
    model: ActuatorModel | str | Path,
    data: Measurement | str | Path,
    effects: str | Sequence[str] | Diagnosis,
    *,
    base: Base = "auto",
    runs: Mapping[str, tuple[int, int]] | None = None,
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
        refitted. ``unexplained`` learns what all others leave, whatever its cause.
    base : {"auto", "always", "never"}
        Whether tolerances of the drawing are fitted beside the effects; ``auto`` where that helps on runs left out and
        makes no channel worse.
    runs : mapping of str to (int, int), optional
        Per effect that began or ended within the campaign, the first and the last run in which it acts, counted from
        1; by default as the diagnosis has it. The new model is that of the last run.
    coil_temperature_C, magnet_temperature_C : float or None
        At which the new model runs; None for the mean of what was recorded, or the model's own.

    Raises
    ------
    UsageError
        If no effect has a name, or a temperature is below absolute zero.
    TableError
        If the data cannot show an effect, their noise is unknown, or they are too few.

    Examples
    --------
    >>> model = ff.read_model("model.json")
    >>> better = ff.add_effects(model, "bench.csv", ["coil_temperature", "core_saturation"])
    >>> for one in better.fall.channels:
    ...     print(f"{one.channel}: {one.before_over_noise:.1f} -> {one.after_over_noise:.1f} times the noise")
    force_N: 2.2 -> 1.1 times the noise
    flux_linkage_Wb: 10.5 -> 1.0 times the noise
    hall_V: 1.6 -> 1.4 times the noise
    voltage_V: 15.0 -> 1.0 times the noise
    >>> ff.write_model(better.model, "better.json")
    """
    say = progress or (lambda _: None)
    say("Reading")
    temperatures = {"coil_temperature_C": coil_temperature_C, "magnet_temperature_C": magnet_temperature_C}
    _check_temperatures(temperatures)
    model, measured, names = model_of(model), measurement_of(data), _names(effects)
    if runs is None and isinstance(effects, Diagnosis):
        runs = {one.name: one.runs for one in effects.missing if one.runs}
    if UNEXPLAINED in names:
        others = [name for name in names if name != UNEXPLAINED]

        def named(one: ActuatorModel) -> AddResult:
            return add_effects(one, measured, others, base=base, runs=runs, progress=progress, **temperatures)

        return _with_remainder(without_remainder(model), measured, named if others else None, others, say)
    kept, given, new = _split(model, names, measured)
    whitening = whitening_beside(placed(with_effects(model, kept), measured))
    observations, wanted = whitening.observations, [*(added.effect for added in given), *new]
    for effect in wanted:
        if reason := why_untestable(effect, observations):
            raise TableError(f"Effect {effect.name} cannot be fitted to these data: {reason}. {effect.experiment}")
    say("Fitting the effects")
    start = in_their_runs(starting_point(observations, whitening, wanted), whitening, runs or {})
    partial = [refit(observations, whitening, start[:k]).effects for k in range(len(given) + 1, len(start))]
    alone = checked_refit(whitening, start)
    say("Fitting the tolerances of the drawing beside them")
    fitted, dropped = with_tolerances(whitening, alone, base)
    beside = len(fitted.fit.effects) - len(start)
    stages = [(effect.name, one) for effect, one in zip(new, [*partial, alone.fit.effects], strict=False)]
    stages += [("tolerances" if beside else "refit", fitted.fit.effects)] if beside or not new else []
    last = observations.runs - 1
    stay = tuple(replace(one, runs=None) for one in fitted.fit.effects if one.runs is None or one.runs[1] == last)
    after = with_effects(_at_temperature(model, observations, temperatures), (*kept, *stay))
    result = _result(
        after,
        kept,
        whitening,
        fitted,
        [("model", given), *stages],
        beside,
        dropped,
        better_alone(whitening, alone.fit, fitted.fit.start[:beside]),
    )
    if not isinstance(measured, TimeSeries):
        return result
    say("Running the filter over what was left out")
    return replace(result, filter=filter_fall(model, after, kept, measured, observations, fitted.error.effects))


def _with_remainder(
    model: ActuatorModel,
    measured: Measurement,
    named: Callable[[ActuatorModel], AddResult] | None,
    others: Sequence[str],
    say: Callable[[str], None],
) -> AddResult:
    """What effects leave, learnt; they are fitted before it and once more beside it, since it bends what they fit."""

    def learnt(one: AddResult) -> RemainderResult:
        bare = without_remainder(one.model)
        return add_remainder(bare, measured, whitening_beside(placed(bare, measured)), one, others, say)

    if named is None:
        return add_remainder(model, measured, whitening_beside(placed(model, measured)), progress=say)
    first = learnt(named(model))
    if not first.parts:
        return first
    again = named(first.model)
    return learnt(replace(again, added=tuple(one for one in again.added if one.effect.name != UNEXPLAINED)))


def _result(
    model: ActuatorModel,
    kept: Sequence[AddedEffect],
    whitening: Whitening,
    fitted: CheckedRefit,
    stages: Sequence[tuple[str, Sequence[AddedEffect]]],
    beside: int,
    dropped: Sequence[Finding],
    alone: str,
) -> AddResult:
    """The result, with the model as it was as the first of the stages; ``beside`` counts the tolerances."""
    observations, noise, fit = whitening.observations, whitening.noise, fitted.fit
    misfits = [(text, observations.value - observations.predict(effects)) for text, effects in stages]
    sizes, patterns = effect_sizes(observations, fit), pattern_space(observations, whitening)
    fall = error_fall(observations, observations.predict(stages[0][1]), observations.predict(fit.effects), noise.known)
    return AddResult(
        model=model,
        added=fit.effects[beside:],
        base=fit.effects[:beside],
        kept=tuple(added.effect.name for added in kept),
        fall=fall,
        left_out=fitted.error.rms,
        floor=noise.known,
        floor_source=noise.source,
        steps=tuple(Step(text, channel_rms(observations, misfit)) for text, misfit in misfits),
        sizes=sizes,
        suspicious=suspicious_values(observations, fit, sizes, {added.effect.name for added in fit.effects[:beside]}),
        lack_of_fit_before=patterns.test(whitening.full(misfits[0][1])),
        lack_of_fit_after=patterns.test(fit.whitened_residual, fit.jacobian[:, ~fit.active]),
        readings=len(observations.value),
        runs=len(np.unique(observations.column("run"))),
        observations=observations,
        findings=(*observations.findings, *fitted.findings, *dropped, *guessed_noises(noise)),
        better_alone=alone,
        beyond_noise=beyond_noise(observations, noise, {one.channel: one.rms_after for one in fall.channels}),
    )


def _names(effects: str | Sequence[str] | Diagnosis) -> list[str]:
    if isinstance(effects, Diagnosis):
        if not effects.missing:
            left = f" Add {UNEXPLAINED} to learn what it leaves." if effects.verdict == UNEXPLAINED else ""
            raise TableError(
                f"The diagnosis names no effect, so there is nothing to add. Give the names of effects.{left}"
            )
        return [one.name for one in effects.missing]
    names = [effects] if isinstance(effects, str) else list(effects) if isinstance(effects, Iterable) else []
    if not names:
        raise TableError(
            "No effect is given, so there is nothing to add. Give names that list_effects has, or a diagnosis."
        )
    return names


def in_their_runs(starts: Sequence[Start], whitening: Whitening, runs: Mapping[str, tuple[int, int]]) -> list[Start]:
    """Effects with those that began or ended within the campaign in their runs alone, counted from 1."""
    observations = whitening.observations
    result = []
    for one in starts:
        first, last = runs.get(one.name, (1, observations.runs))
        if not 1 <= first <= last <= observations.runs:
            raise UsageError(
                f"{one.name} must act from a run to a later one of 1 to {observations.runs}; instead received "
                f"{first} to {last}."
            )
        if (first, last) != (1, observations.runs):
            columns = one.columns.in_runs((first - 1, last - 1), observations.column("run").astype(int))
            one = replace(one, columns=columns, whitened=whitening.full(columns.columns))  # noqa: PLW2901
        result.append(one)
    return result


def _split(
    model: ActuatorModel, names: Sequence[str], data: Measurement
) -> tuple[tuple[AddedEffect, ...], tuple[AddedEffect, ...], list[Effect]]:
    """(effects that stay as they are, those that are refitted, those that are new).

    An effect of the model stays where these data cannot show it; one that the user names is never among those.
    """
    drawn = {name: one.effect for one in model.drawn for name in (one.key, one.subject)}
    wanted = [drawn.get(name) or effect_by_name(name) for name in dict.fromkeys(names)]
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


def whitening_beside(observations: Observations) -> Whitening:
    """The noise of readings beside the model without what is refitted; TableError where it is unknown."""
    noise = estimate_noise(observations)
    if noise is None:
        raise TableError(str(NO_NOISE))
    whitening = Whitening(observations, noise, chains_of(observations), own_misfit_columns(observations))
    if not pattern_space(observations, whitening).groups:
        raise TableError(str(TOO_FEW))
    return whitening


def _check_temperatures(given: Mapping[str, float | None]) -> None:
    for name, temperature in given.items():
        if temperature is not None and not ABSOLUTE_ZERO_C < temperature < np.inf:
            raise UsageError(
                f"The {name.split('_')[0]}'s temperature must be above absolute zero, {ABSOLUTE_ZERO_C:g} °C; instead "
                f"received {temperature:g} °C. Leave it out for what was recorded."
            )


def _at_temperature(
    model: ActuatorModel, observations: Observations, given: Mapping[str, float | None]
) -> ActuatorModel:
    """The model at the temperatures where it is to run: as given, else as recorded in the mean."""

    def chosen(name: str, own: float) -> float:
        temperature, recorded = given[name], observations.covariates[name].dropna()
        if temperature is not None:
            return temperature
        return round(float(recorded.mean()), 1) if len(recorded) else own

    return replace(
        model,
        coil_temperature_C=chosen("coil_temperature_C", model.coil_temperature_C),
        magnet_temperature_C=chosen("magnet_temperature_C", model.magnet_temperature_C),
    )
