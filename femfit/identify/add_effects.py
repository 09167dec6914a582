"""Adds effects to a model: a bounded refit to measurements, checked on runs left out, and what it says."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import TableError, UsageError
from femfit.core.numerics import ABSOLUTE_ZERO_C, FloatArray
from femfit.core.results import Finding, Plotted
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect, Effect, EffectParameter
from femfit.effects.words import titled, titles_of
from femfit.estimate.follow import followed
from femfit.identify.bench import measurement_of, placed
from femfit.identify.constants import FILTER_WORSE, HARMS, HELPS
from femfit.identify.decision.campaign import gather
from femfit.identify.decision.diagnose import Diagnosis
from femfit.identify.decision.remarks import guessed_noises
from femfit.identify.lack_of_fit import LackOfFit, pattern_space
from femfit.identify.left_out import checked_refit, unseen_error
from femfit.identify.misfit import ErrorFall, beyond_noise, error_fall
from femfit.identify.noise.components import beside_effects
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import TEMPERATURES, Observations
from femfit.identify.refit import Refit, Start, is_plausible, starting_point
from femfit.identify.remainder import NAME as UNEXPLAINED
from femfit.identify.remainder import PARTS, learn_remainder
from femfit.identify.signatures import why_untestable
from femfit.identify.words import Result, plain, printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement, TimeSeries


@dataclass(frozen=True, eq=False, repr=False)
class AddResult(Plotted, Result):
    """Effects added to a model; printed, it is what ``femfit add`` prints.

    Parameters
    ----------
    model : ActuatorModel
        With the effects, ready to be written.
    added : tuple of AddedEffect
        The effects that were fitted, in order, with 95 % intervals.
    kept : tuple of str
        Effects that the model had before and that these data cannot refit.
    fall : ErrorFall
        Error before and after, over all readings.
    left_out : mapping of str to float
        Root mean square per channel on readings that were not fitted: each run in turn, or quarters of a single run.
    floor : mapping of str to float
        Standard deviation of one reading, in the channels in which it is known.
    suspicious : tuple of str
        What is unusual of the fitted parameters, one sentence each.
    observations : Observations
        The readings beside the model without what was refitted.
    beyond_noise : mapping of str to float
        Channels whose error after is more than 1.2 times what declared noise, or repeats, show, in times the noise.
    filter : dict of str to dict, or None
        Mean square of the innovations of the model's filter, which should be 1, over a record's beginning ``before``
        and ``after``, None where it no longer runs through; None of a bench table, and where the model had no filter
        for the record.
    inductance_H : dict of str to float
        Least inductance over the validity domain ``before`` and ``after``, of several circuits the least eigenvalue.
    parts : tuple of str, or None
        What a remainder, the effect ``unexplained``, changes: ``coenergy``, or the channel that is read wrongly; none
        where nothing beyond the noise is left, and None where none was sought.
    fall_unseen : float
        By how much the remainder lowers the weighted sum of squares on runs left out.
    beside : AddResult or None
        Effects that were added before the remainder.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "core_saturation")
    >>> force = better.fall.channels[0]
    >>> force.rms_after < force.rms_before
    True
    """

    data = (
        *("added", "kept", "left_out", "floor", "floor_source", "readings", "runs"),
        *("suspicious", "lack_of_fit_before", "lack_of_fit_after", "findings", "accepted", "beyond_noise", "filter"),
        *("objections", "error_fall=fall", "coil_temperature_C=model.coil_temperature_C"),
        "magnet_temperature_C=model.magnet_temperature_C",
    )

    model: ActuatorModel
    added: tuple[AddedEffect, ...]
    kept: tuple[str, ...]
    fall: ErrorFall
    left_out: Mapping[str, float]
    floor: Mapping[str, float]
    floor_source: Mapping[str, str]
    suspicious: tuple[str, ...]
    lack_of_fit_before: LackOfFit
    lack_of_fit_after: LackOfFit
    readings: int
    runs: int
    observations: Observations
    findings: tuple[Finding, ...] = ()
    beyond_noise: Mapping[str, float] = field(default_factory=dict)
    filter: Mapping[str, Mapping[str, float | None]] | None = None
    inductance_H: Mapping[str, float] = field(default_factory=dict)
    parts: tuple[str, ...] | None = None
    fall_unseen: float = 0.0
    beside: "AddResult | None" = None

    @property
    def accepted(self) -> bool:
        """Whether nothing speaks against the new model."""
        return not self.objections

    @property
    def objections(self) -> tuple[str, ...]:
        """What speaks against the new model: the error on runs left out, and what keeps it from running.

        ``risen``: that error is larger in some channel, and smaller in none; ``inductance``: it is not positive
        everywhere, as it was before; ``lost``: the filter does not run through; ``filter``: the mean square of its
        innovations is farther from 1 by more than a factor. Of a remainder ``unseen``: the error does not fall;
        ``risen``: it is larger in some channel; ``nothing``: none was learnt, nor are effects beside it accepted. What
        keeps a model with these alone from running counts as well.
        """
        if self.parts == ():
            return () if self.beside and self.beside.accepted else ("nothing",)
        before, after = self.filter["mean_square"].values() if self.filter else (1.0, 1.0)
        farther = before and after and abs(np.log(after)) > abs(np.log(before)) + np.log(FILTER_WORSE)
        turned = self.inductance_H.get("after", 1.0) <= 0.0 < self.inductance_H["before"]
        begun = self.beside.objections if self.beside else ()
        falls = any(HARMS * self.left_out[channel.channel] < channel.rms_before for channel in self.fall.channels)
        tests = {
            "inductance": turned or "inductance" in begun,
            "lost": after is None or "lost" in begun,
            "filter": farther,
            "unseen": self.parts is not None and self.fall_unseen <= HELPS,
            "risen": bool(self.risen) and (self.parts is not None or not falls),
        }
        return tuple(code for code, fails in tests.items() if fails)

    @property
    def risen(self) -> tuple[str, ...]:
        """Channels whose error on runs left out is larger than before."""
        channels = self.fall.channels
        return tuple(c.channel for c in channels if self.left_out[c.channel] > HARMS * c.rms_before)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        learnt = {"parts": plain(self.parts), "fall_unseen": self.fall_unseen}
        of_remainder = {"remainder": learnt, "beside": plain(self.beside)} if self.parts is not None else {}
        return super().to_dict() | of_remainder

    def __str__(self) -> str:
        text = printed("add", r=self) if self.parts is None else printed("remainder", r=self, words=PARTS)
        return titled(text, titles_of(self.observations.nominal.drawn))


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
        If no effect has a name, or a temperature is below absolute zero.
    TableError
        If the data cannot show an effect, their noise is unknown, or they are too few.

    Examples
    --------
    >>> model = ff.read_model("model.json")
    >>> better = ff.add_effects(model, "bench.csv", ["coil_temperature", "core_saturation"])
    >>> for one in better.fall.channels:
    ...     print(f"{one.channel}: {one.before_over_noise:.1f} -> {one.after_over_noise:.1f} times the noise")
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
        if temperature is not None and not ABSOLUTE_ZERO_C < temperature < np.inf:
            raise UsageError(sentence("refusals", "too_cold", name.split("_")[0], temperature, ABSOLUTE_ZERO_C))
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


def of_last_run(effects: Sequence[AddedEffect], observations: Observations) -> tuple[AddedEffect, ...]:
    """Effects that act in the last run, as a model has them whatever the run."""
    last = observations.runs - 1
    return tuple(replace(added, runs=None) for added in effects if added.runs is None or added.runs[1] == last)


def whitening_beside(observations: Observations) -> Whitening:
    """The noise of readings beside the model without what is refitted; TableError where it is unknown."""
    campaign = gather(observations, ())
    if isinstance(campaign, Finding):
        raise TableError(str(campaign))
    return campaign.whitening


def suspicious_values(observations: Observations, fit: Refit) -> tuple[str, ...]:
    """What is unusual of fitted parameters, one sentence each."""

    def clocked(p: EffectParameter) -> EffectParameter:
        """A time with the unit that these data count it in."""
        unit = "s" if "time_s" in observations.given else "readings"
        return replace(p, unit=unit) if p.unit == "readings or s" else p

    every = [(added, p) for added in fit.effects for p in added.effect.parameters]
    stuck = [(fit.effects[k], p) for k, p in (fit.free[j] for j in np.flatnonzero(fit.active))]
    limits = {
        a.effect.name: [(p.null, a.ci95.get(p.name, (p.null,))) for p in a.effect.amplitudes] for a in fit.effects
    }
    text = printed(
        "suspicious",
        fit=fit,
        unusual=[(added, clocked(p)) for added, p in every if not is_plausible(added, p)],
        ends=[(a, clocked(p)) for a, p in stuck if abs(a.parameters[p.name] - p.null) > 1e-3 * p.width],
        absent=[
            name for name, intervals in limits.items() if all(min(ci) <= null <= max(ci) for null, ci in intervals)
        ],
        nominal=observations.nominal,
        alone=lambda added, p: AddedEffect(added.effect, added.effect.null() | {p.name: added.parameters[p.name]}),
    )
    return tuple(text.splitlines())


def run_facts(before: ActuatorModel, after: ActuatorModel, measured: Measurement) -> dict[str, Any]:
    """The fields of a result that say how the models run: inductances, and of a record the filters."""
    models = {"before": before, "after": after}
    facts: dict[str, Any] = {"inductance_H": {name: model.smallest_inductance_H for name, model in models.items()}}
    first, last = (followed(m, measured) if isinstance(measured, TimeSeries) else None for m in models.values())
    if first is not None:
        ran = last if last and (last.lost_at_s is None or first.lost_at_s is not None) else None
        facts["filter"] = {"mean_square": {"before": first.mean_square, "after": ran and ran.mean_square}}
    return facts


def fit_facts(
    whitening: Whitening, before: Sequence[AddedEffect], after: Sequence[AddedEffect], fitted: FloatArray | None
) -> dict[str, Any]:
    """The fields of a result that follow from the readings, with the model's own effects before and all of them after.

    Parameters
    ----------
    fitted : array, shape (M, k), or None
        Whitened columns of what was fitted.
    """
    observations, noise = whitening.observations, whitening.noise
    first, last = observations.predict(before), observations.predict(after)
    patterns, fall = pattern_space(whitening), error_fall(observations, first, last, noise.known)
    return {
        "fall": fall,
        "floor": noise.known,
        "floor_source": noise.source,
        "lack_of_fit_before": patterns.test(whitening.full(observations.value - first)),
        "lack_of_fit_after": patterns.test(whitening.full(observations.value - last), fitted),
        "readings": len(observations.value),
        "runs": len(np.unique(observations.column("run"))),
        "observations": observations,
        "beyond_noise": beyond_noise(observations, noise, fall.rms_after),
    }
