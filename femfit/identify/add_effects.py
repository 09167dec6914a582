"""Adds effects to a model: a bounded refit to measurements, checked on runs left out, and what it says."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import TableError, UsageError
from femfit.core.results import Finding
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import TEMPERATURES
from femfit.effects.effect import AddedEffect, Effect
from femfit.identify.before_after import AddResult, fit_facts, of_last_run, run_facts, suspicious_values, unseen_error
from femfit.identify.bench import measurement_of, placed
from femfit.identify.constants import SETTLED
from femfit.identify.decision.campaign import gather
from femfit.identify.decision.diagnose import Diagnosis
from femfit.identify.decision.remarks import guessed_noises
from femfit.identify.misfit import ErrorFall
from femfit.identify.noise.components import beside_effects
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, Start, refit, starting_point
from femfit.identify.remainder import NAME as UNEXPLAINED
from femfit.identify.remainder import learn_remainder
from femfit.identify.signatures import why_untestable
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement
from femfit.tables.units import possible_range


def add_effects(
    model: ActuatorModel | str | Path,
    data: Measurement | str | Path,
    effects: str | Sequence[str] | Diagnosis,
    *,
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
    runs : mapping of str to (int, int), optional
        Per effect that began or ended within the campaign, the first and the last run in which it acts, counted from
        1; by default as the diagnosis has it. The new model is that of the last run.
    coil_temperature_C : float or None
        Temperature of the winding at which the new model runs; by default the recorded mean, or the model's own.
    magnet_temperature_C : float or None
        Temperature of the magnet at which the new model runs; by default the recorded mean, or the model's own.

    Raises
    ------
    UsageError
        If no effect has a name, or a temperature is below absolute zero or beyond what any part bears.
    TableError
        If the data cannot show an effect, their noise is unknown, or they are too few.

    Examples
    --------
    >>> model = ff.read_model("model.json")
    >>> better = ff.add_effects(model, "bench.csv", ["coil_temperature", "core_saturation"])
    >>> for fall in better.fall.channels:
    ...     print(f"{fall.channel}: {fall.before_over_noise:.1f} -> {fall.after_over_noise:.1f} times the noise")
    force_N: 2.2 -> 1.0 times the noise
    flux_linkage_Wb: 10.3 -> 1.0 times the noise
    hall_V: 1.6 -> 1.4 times the noise
    voltage_V: 15.3 -> 1.0 times the noise
    >>> ff.write_model(better.model, "better.json")
    """
    say = progress or (lambda _: None)
    say("Reading")
    temperatures: dict[str, Any] = dict(zip(TEMPERATURES, (coil_temperature_C, magnet_temperature_C), strict=True))
    for name, temperature in temperatures.items():
        low, high = possible_range(name)
        if temperature is not None and not low < temperature <= high:
            raise UsageError(sentence("refusals", "no_temperature", name.split("_")[0], temperature, low, high))
    model, measured, names = model_of(model), measurement_of(data), _names(effects)
    if runs is None and isinstance(effects, Diagnosis):
        runs = {effect.name: effect.runs for effect in effects.missing if effect.runs}
    if UNEXPLAINED in names:
        catalogued = [name for name in names if name != UNEXPLAINED]
        add = partial(add_effects, data=measured, effects=catalogued, runs=runs, progress=progress, **temperatures)
        return _with_remainder(model, measured, add, catalogued, say)
    staying, refitted, new = _split(model, names, measured)
    whitening = whitening_beside(placed(with_effects(model, staying), measured))
    observations, wanted = whitening.observations, [*(added.effect for added in refitted), *new]
    say("Fitting the effects")
    start = in_their_runs(starting_point(whitening, wanted), whitening, runs or {})
    whitening = beside_effects(whitening, checked_refit(whitening, start)[0].effects)
    fit, held = checked_refit(whitening, start)
    stay = of_last_run(fit.effects, observations)
    # The temperatures where it is to run: as given, else as recorded in the mean
    means = observations.covariates[list(temperatures)].mean().dropna()
    recorded: dict[str, Any] = {str(name): round(float(mean), 1) for name, mean in means.items()}
    running = replace(model, **recorded | {name: t for name, t in temperatures.items() if t is not None})
    after = with_effects(running, (*staying, *stay))
    return AddResult(
        model=after,
        added=fit.effects,
        kept=tuple(added.effect.name for added in staying),
        left_out=unseen_error(whitening, fit),
        suspicious=suspicious_values(observations, fit),
        findings=(*observations.findings, *held, *guessed_noises(whitening.noise)),
        **run_facts(model, after, measured),
        **fit_facts(whitening, refitted, fit.effects, fit.jacobian[:, ~fit.active]),
    )


def checked_refit(whitening: Whitening, start: Sequence[Start]) -> tuple[Refit, tuple[Finding, ...]]:
    """A refit of what the data show, and what was held: amplitudes that they do not identify, and extrapolated ends."""
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
    return fit, tuple(finding("not-settled", name=name) for name in slow)


def _unsettled(observations: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect time constants of the circuit that are longer than the runs, held at these.

    The new model runs with the end of such a change. A fit to its beginning says only its rate, and would put an end
    into the circuit that nobody has seen.
    """
    clock = observations.column("time_s" if observations.in_motion else "order")
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


def _with_remainder(
    model: ActuatorModel,
    measured: Measurement,
    add: Callable[[ActuatorModel], AddResult],
    catalogued: Sequence[str],
    say: Callable[[str], None],
) -> AddResult:
    """What effects leave, learnt; they are fitted before it and once more beside it, since it bends what they fit."""
    model, beside, first = with_effects(model, _catalogued(model.effects)), None, None
    for _ in range(2):
        if catalogued:
            beside = add(model)
            sure = tuple(sentence for sentence in beside.suspicious if not sentence.startswith(UNEXPLAINED))
            beside = replace(beside, added=_catalogued(beside.added), suspicious=sure)
            first, model = first or beside, with_effects(beside.model, _catalogued(beside.model.effects))
        say("Learning the remainder")
        whitening = whitening_beside(placed(model, measured))
        learnt, whitening, left_out, fall_unseen = learn_remainder(model, measured, whitening, catalogued)
        after = with_effects(model, (*model.effects, *learnt.effects))
        if learnt.effects:
            say("Running the filter before and after")
        result = AddResult(
            model=after,
            added=learnt.effects,
            kept=tuple(present.effect.name for present in model.effects),
            left_out=left_out,
            suspicious=beside.suspicious if beside else (),
            findings=(*whitening.observations.findings, *guessed_noises(whitening.noise)),
            parts=learnt.kinds,
            fall_unseen=fall_unseen,
            beside=beside,
            **(run_facts(model, after, measured) if learnt.effects else {}),
            **fit_facts(whitening, (), learnt.effects, learnt.decided),
        )
        if first is None or not result.parts:
            break
        model = after
    if first is None:
        return result
    before = first.fall.rms_before  # of the model as it was given
    fall = ErrorFall(tuple(replace(c, rms_before=before[c.channel]) for c in result.fall.channels))
    return replace(result, fall=fall, lack_of_fit_before=first.lack_of_fit_before)


def _catalogued(effects: Sequence[AddedEffect]) -> tuple[AddedEffect, ...]:
    """Effects without a remainder among them."""
    return tuple(added for added in effects if added.effect.name != UNEXPLAINED)


def _names(effects: str | Sequence[str] | Diagnosis) -> list[str]:
    if isinstance(effects, Diagnosis):
        if not effects.missing:
            remedy = f" Add {UNEXPLAINED} to learn what it leaves." if effects.verdict == UNEXPLAINED else ""
            raise TableError(sentence("refusals", "nothing_named", remedy))
        return [effect.name for effect in effects.missing]
    names = [effects] if isinstance(effects, str) else list(effects) if isinstance(effects, Iterable) else []
    if not names:
        raise TableError(sentence("refusals", "no_effect"))
    return names


def in_their_runs(starts: Sequence[Start], whitening: Whitening, runs: Mapping[str, tuple[int, int]]) -> list[Start]:
    """Effects with those that began or ended within the campaign in their runs alone, counted from 1."""
    observations = whitening.observations
    result = []
    for effect in starts:
        first, last = runs.get(effect.name, (1, observations.runs))
        if not 1 <= first <= last <= observations.runs:
            raise UsageError(sentence("refusals", "no_such_runs", effect.name, observations.runs, first, last))
        if (first, last) != (1, observations.runs):
            columns = effect.columns.in_runs((first - 1, last - 1), observations.column("run").astype(int))
            effect = replace(effect, columns=columns, whitened=whitening.full(columns.columns))  # noqa: PLW2901
        result.append(effect)
    return result


def _split(
    model: ActuatorModel, names: Sequence[str], data: Measurement
) -> tuple[tuple[AddedEffect, ...], tuple[AddedEffect, ...], list[Effect]]:
    """(effects that stay as they are, those that are refitted, those that are new).

    An effect of the model stays where these data cannot show it; one that the user names is never among those.
    """
    drawn = {name: number.effect for number in model.drawn for name in (number.key, number.subject)}
    wanted = [drawn.get(name) or effect_by_name(name) for name in dict.fromkeys(names)]
    named = {effect.name for effect in wanted}
    bare = placed(with_effects(model, ()), data) if model.effects else None
    shown = named | {added.effect.name for added in model.effects if bare and not why_untestable(added.effect, bare)}
    staying = tuple(added for added in model.effects if added.effect.name not in shown)
    refitted = tuple(added for added in model.effects if added.effect.name in shown)
    present = {added.effect.name for added in refitted}
    return staying, refitted, [effect for effect in wanted if effect.name not in present]


def whitening_beside(observations: Observations) -> Whitening:
    """The noise of readings beside the model without what is refitted; TableError where it is unknown."""
    campaign = gather(observations, ())
    if isinstance(campaign, Finding):
        raise TableError(str(campaign))
    return campaign.whitening
