"""The page on a comparison, a diagnosis, or what was added; its words stand in ``templates/bench``."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from femfit import __version__
from femfit.core.arrays import FloatArray
from femfit.core.atomic import replacing
from femfit.effects.catalogue import all_effects
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.effects.words import smallest_visible
from femfit.identify.comparison.compare import Comparison
from femfit.identify.comparison.curves import measured_curves
from femfit.identify.comparison.fall import ErrorFall
from femfit.identify.decision.constants import LEVEL_AFTER
from femfit.identify.decision.diagnosis import Diagnosis, NamedEffect
from femfit.identify.decision.diagnosis_text import certainty_sentence, verdict_sentence
from femfit.identify.experiments.suggest import Suggestion
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import placed
from femfit.identify.refit.add_result import AddResult
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.report.explained_figures import ranking_figure, waterfall_figure
from femfit.report.misfit_figures import (
    covariate_figure,
    curves_figure,
    residual_maps_figure,
    settings_figure,
    worst_first,
)
from femfit.report.numbers import NOTHING, formula_markup, percent, plain, quantity, significant
from femfit.report.page import Drawing, picture_uri, render
from femfit.report.style import style
from femfit.tables.measurement import CHANNEL_WORDS, Measurement

SHOWN = 6
"""Suggestions in the table."""

DOTS_PER_INCH = 150

PANELS = 3
"""Most panels of a saved picture."""

SCALAR = (
    "coil_temperature_C", "magnet_temperature_C", "order", "elapsed", "branch", "run", "velocity_m_s",
    "current_rate_A_s",
)  # fmt: skip
"""Covariates that a map over distance and current does not show."""


@dataclass(frozen=True, eq=False)
class DiagnosisContent:
    """A diagnosis, and what was done about it."""

    diagnosis: Diagnosis
    suggestions: Sequence[Suggestion] = ()
    added: AddResult | None = None
    # Recorded minus what the model predicts with the effects that were added, or that the diagnosis names; shape (M,)
    after: FloatArray | None = None
    source: str = "measurement"
    test_object: str = ""
    notes: str = ""
    hashes: tuple[tuple[str, str], ...] = ()  # Files and their SHA-256

    @property
    def model(self) -> ActuatorModel:
        """The model that was diagnosed."""
        return self.diagnosis.model

    @property
    def observations(self) -> Observations:
        """The readings beside it."""
        return self.diagnosis.observations

    @property
    def recorded_motion(self) -> bool:
        """Whether readings are windows of a time series."""
        return "velocity_m_s" in self.observations.covariates


def content_of(
    data: Measurement | None,
    diagnosis: Diagnosis,
    *,
    suggestions: Sequence[Suggestion] = (),
    added: AddResult | None = None,
    hashes: tuple[tuple[str, str], ...] = (),
) -> DiagnosisContent:
    """The content of a measurement's diagnosis.

    Parameters
    ----------
    data : BenchTable or TimeSeries, or None
        What was measured, needed where something was added; otherwise for what it says of itself.
    """
    observations, after = diagnosis.observations, None
    if added is not None and data is not None:
        after = placed(added.model, data).residual
    elif diagnosis.explanations:
        after = observations.value - observations.predict(diagnosis.explanations[0].effects)
    about = {} if data is None else {"source": data.source, "test_object": data.test_object, "notes": data.notes}
    return DiagnosisContent(diagnosis, suggestions, added, after, hashes=hashes, **about)


def render_diagnosis(content: DiagnosisContent) -> str:
    """The report of a diagnosis as HTML text."""
    diagnosis, observations, floor = content.diagnosis, content.observations, dict(content.diagnosis.noise_floor)
    known = bool(floor)
    scale = floor or dict.fromkeys(observations.channels, 1.0)
    named = diagnosis.explanations[0].effects if diagnosis.explanations else ()
    effects = named if content.added is None else (*content.added.base, *content.added.added)
    facts, figures = _curves(content.model, observations, effects, floor)
    figures["settings"] = partial(settings_figure, observations)
    figures["misfit-maps"] = partial(residual_maps_figure, observations, [("", observations.residual)], scale, known)
    covariates = [name for name in diagnosis.where.covariates if name in SCALAR] if known else []
    if covariates:
        channel = diagnosis.where.channel
        values = observations.residual / scale[channel]
        figures["misfit-covariates"] = partial(covariate_figure, observations, values, channel, covariates)
    facts |= {
        "title": f"{content.model.name}: the bench and the model",
        "lead": f"{content.source} beside the model's predictions",
        "summary": _summary(content),
        "content": content,
        "diagnosis": diagnosis,
        "observations": observations,
        "verdict": verdict_sentence(diagnosis),
        "certainty": certainty_sentence(diagnosis) if diagnosis.missing else "",
        "classes": [one for one in diagnosis.missing if len(one.members) > 1],
        "known": known,
        "covariates": covariates,
        "misfit_rows": _misfit_rows(diagnosis),
        "versions": _versions(),
        **_measured_facts(content),
    }
    sections = ["curves", "measured", "misfit", "provenance"]
    if diagnosis.decision is not None:
        sections += ["explained", "alternatives"]
        more, drawn = _explained(diagnosis)
        facts, figures = facts | more, figures | drawn
    if diagnosis.verdict != "nothing_missing":
        sections.append("next")
        facts |= _next_facts(content)
    if diagnosis.campaign is not None and content.after is not None:
        sections.append("fall")
        added = content.added
        errors = [dict(step.rms) for step in added.steps] if added else _errors(diagnosis.error_fall)
        steps = [s.text for s in added.steps[1:]] if added else [" + ".join(one.name for one in diagnosis.missing)]
        more, drawn = _fall(observations, content.after, floor, steps, errors, added)
        facts |= more | {"quoted_source": shlex.quote(content.source)}
        figures |= drawn
    return _render(facts, sections, figures)


def render_comparison(comparison: Comparison) -> str:
    """The page on a comparison: the answer, measured points on the model's curves, maps of the misfit."""
    observations = comparison.observations
    floor, scale, known = noise_scale(comparison)
    facts, figures = _curves(comparison.model, observations, (), floor)
    figures["misfit-maps"] = partial(residual_maps_figure, observations, [("", observations.residual)], scale, known)
    facts |= {
        "title": f"{comparison.model.name}: the bench and the model",
        "lead": "what was measured beside the model's predictions",
        "summary": [("", line) for line in str(comparison).splitlines() if line.strip()][:SHOWN],
        "diagnosis": None,
        "known": known,
        "covariates": [],
    }
    return _render(facts, ["curves", "misfit"], figures)


def render_added(result: AddResult) -> str:
    """The page on effects that were added: measured points before and after, and how far the error fell."""
    observations, effects = result.observations, (*result.base, *result.added)
    kept = tuple(one for one in result.model.effects if one.effect.name in result.kept)
    model = with_effects(result.model.without_effects, kept)
    facts, figures = _curves(model, observations, effects, result.floor)
    after = observations.value - observations.predict(effects)
    errors, steps = [dict(step.rms) for step in result.steps], [step.text for step in result.steps[1:]]
    more, drawn = _fall(observations, after, dict(result.floor), steps, errors, result)
    facts |= more | {
        "title": f"{result.model.name}: the bench and the model",
        "lead": "the model before and after the refit",
        "summary": [("", line.strip()) for line in str(result).splitlines() if line.strip()],
        "content": {"hashes": ()},
        "versions": _versions(),
    }
    return _render(facts, ["curves", "fall", "provenance"], figures | drawn)


def noise_scale(comparison: Comparison) -> tuple[dict[str, float], dict[str, float], bool]:
    """Noise of each channel in which it is known, what misfits are drawn in parts of, and whether that is noise."""
    floor = {one.channel: one.noise_floor for one in comparison.channels if one.noise_floor is not None}
    known = len(floor) == len(comparison.channels)
    return floor, floor if known else dict.fromkeys(comparison.observations.channels, 1.0), known


def save_comparison_pictures(comparison: Comparison, directory: Path) -> list[Path]:
    """Write ``misfit-maps.png`` and ``misfit-CHANNEL-1.png`` and so on."""
    observations = comparison.observations
    floor, scale, known = noise_scale(comparison)
    figures = {"misfit-maps": residual_maps_figure(observations, [("", observations.residual)], scale, known)}
    for channel, noise in floor.items():
        lines = [one.along[0] for one in comparison.maps if one.channel == channel and len(one.along) == 1]
        names = [name for name in lines if name != "mount"]
        for first in range(0, len(names), PANELS):
            shown, misfit = names[first : first + PANELS], observations.residual / noise
            figures[f"misfit-{channel}-{1 + first // PANELS}"] = covariate_figure(observations, misfit, channel, shown)
    files = []
    for name, figure in figures.items():
        files.append(directory / f"{name}.png")
        with style(), replacing(files[-1]) as unfinished:
            figure.savefig(unfinished, dpi=DOTS_PER_INCH)
    return files


def _render(facts: Mapping[str, Any], sections: Sequence[str], figures: Mapping[str, Drawing]) -> str:
    drawn = {name: picture_uri(name, draw) for name, draw in figures.items()}
    return render("bench.html.j2", {**facts, "sections": sections}, drawn)


def _versions() -> list[tuple[str, str]]:
    return [("femfit", __version__), *((name, version(name)) for name in ("numpy", "scipy", "matplotlib"))]


def _curves(
    model: ActuatorModel, observations: Observations, effects: Sequence[AddedEffect], floor: Mapping[str, float]
) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """Each channel's readings on the model's curves before and after, the worst channel first."""
    curves = worst_first(measured_curves(model, observations, after=effects, noise=dict(floor)))
    names = list(dict.fromkeys(one.effect.name for one in effects))
    drawn: dict[str, Drawing] = {
        f"curves-{one.channel}": partial(curves_figure, one, fitted=bool(effects)) for one in curves
    }
    return {"curves": curves, "effects": names}, drawn


def _summary(content: DiagnosisContent) -> list[tuple[str, str]]:
    diagnosis = content.diagnosis
    said = [("Verdict", verdict_sentence(diagnosis))]
    if diagnosis.where.channel:
        said.append(("Where", diagnosis.where.sentence))
    if diagnosis.missing:
        said.append(("How certain", certainty_sentence(diagnosis)))
    if content.suggestions:
        said.append(("Next", content.suggestions[0].text))
    if content.added is not None:
        names = " and ".join(added.effect.name for added in content.added.added)
        said.append(("Added", f"{names}. {_worst(content.added.fall)}."))
    elif diagnosis.missing:
        said.append(("Error", f"{_worst(diagnosis.error_fall)}."))
    return said


def _worst(fall: ErrorFall) -> str:
    """The fall of the error in the channel that was worst."""
    return str(max(fall.channels, key=lambda one: one.before_over_noise or 0.0))


def _measured_facts(content: DiagnosisContent) -> dict[str, Any]:
    observations, evidence = content.observations, content.diagnosis.campaign
    told = not content.recorded_motion and "mount" in observations.given  # whether mounts are told from runs
    facts: dict[str, Any] = {
        "runs": len(np.unique(observations.covariates["run"])),
        "mounts": len(np.unique(observations.covariates["mount"])) if told else 0,
        "noise": None if evidence is None else evidence.noise,
        "findings": observations.findings if evidence is None else content.diagnosis.findings,
    }
    if evidence is None:
        return facts
    noise, rows = evidence.noise, []
    for c, name in enumerate(noise.channels):
        values = np.abs(observations.value[observations.of(name)])
        source, sigma = noise.source.get(name, ""), float(noise.sigma[c])
        known = f"{significant(float(noise.repeats[c]), 3)} repeats" if source == "repeats" else source
        known = {"guess": "a guess", "": "not known"}.get(known, known)
        share = percent(sigma / float(values.max())) if source and values.max(initial=0.0) > 0.0 else NOTHING
        own = (quantity(sigma, name), known, share, quantity(float(noise.run[c]), name, 2))
        shown = own if source else (NOTHING, known, NOTHING, NOTHING)
        rows.append((CHANNEL_WORDS[name], f"{len(values):,}", *shown, f"{noise.rho[c]:.2f}"))
    return facts | {"noise_rows": rows}


def _misfit_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    rms = {one.channel: one.rms_before for one in diagnosis.error_fall.channels}
    rows: list[tuple[str, ...]] = []
    for name in diagnosis.observations.channels:
        largest = float(np.abs(diagnosis.observations.residual[diagnosis.observations.of(name)]).max())
        floor = diagnosis.noise_floor.get(name)
        noise = (quantity(floor, name), significant(rms[name] / floor, 3)) if floor else (NOTHING, NOTHING)
        rows.append((CHANNEL_WORDS[name], quantity(rms[name], name), quantity(largest, name), *noise))
    return rows


def _explained(diagnosis: Diagnosis) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """What the verdict names, how it ranks, and what the data could have shown."""
    effects, nominal = all_effects(), diagnosis.observations.nominal
    facts = {
        "named": [
            (one, effects[one.name].symptom if one.name in effects else "", _parameter_rows(one))
            for one in diagnosis.missing
        ],
        "detectable": [
            (name, smallest_visible(effects[name], amplitudes, nominal) or NOTHING)
            for name, amplitudes in diagnosis.detectable.items()
            if name in effects
        ],
        "hidden": [score for score in diagnosis.ranking if score.note],
    }
    testable = [score for score in diagnosis.ranking if not score.note]
    if diagnosis.verdict == "nothing_missing" or not testable or diagnosis.decision is None:
        return facts, {}
    named = [one.name for one in diagnosis.missing]
    members = [name for one in diagnosis.missing for name in one.members[1:]]
    return facts, {"ranking-effects": partial(ranking_figure, testable, diagnosis.decision.excess, named, members)}


def _parameter_rows(one: NamedEffect) -> list[tuple[str, ...]]:
    effect, rows = all_effects().get(one.name), list[tuple[str, ...]]()
    known = {} if effect is None else {p.name: p for p in effect.parameters}
    for name, value in one.parameters.items():
        p, (low, high) = known.get(name), one.ci95.get(name, (np.nan, np.nan))
        interval = f"{significant(low, 3)} … {significant(high, 3)}" if np.isfinite(low) else _no_interval(value, p)
        usual = f"{plain(p.plausible[0])} … {plain(p.plausible[1])}" if p else NOTHING
        unit = formula_markup(p.unit) if p else ""
        rows.append((p.description if p else name, significant(value, 4), interval, usual, unit))
    return rows


def _no_interval(value: float, parameter: EffectParameter | None) -> str:
    if parameter is None or parameter.nonlinear or value not in {parameter.lower, parameter.upper}:
        return NOTHING
    return "at its bound"


def _next_facts(content: DiagnosisContent) -> dict[str, Any]:
    """The measurement that would decide."""
    diagnosis, decision, effects = content.diagnosis, content.diagnosis.decision, all_effects()
    nearest = None
    if decision is not None and decision.candidates:
        best = decision.candidates[0]
        share = 1.0 - best.excess / decision.excess if decision.excess > 0.0 else 0.0
        nearest = (best.fit.names, float(np.clip(share, 0.0, 1.0)))
    suggestions = []
    for one in list(content.suggestions)[:SHOWN]:
        pairs = sorted(((*_unlike(a, b), sigma) for a, b, sigma in one.separates), key=lambda pair: round(pair[2], 6))
        suggestions.append((one, pairs, [" and ".join(_unlike(a, b)) for a, b in one.remains]))
    names = dict.fromkeys(name for one in diagnosis.missing for name in one.members if name in effects)
    return {
        "nearest": nearest,
        "suggestions": suggestions,
        "experiments": [(name, effects[name].experiment) for name in names],
    }


def _unlike(a: str, b: str) -> tuple[str, str]:
    """Two explanations without the effects that both have."""
    first, second = a.split(" + "), b.split(" + ")
    left = [name for name in first if name not in second], [name for name in second if name not in first]
    return " + ".join(left[0]) or a, " + ".join(left[1]) or b


def _errors(fall: ErrorFall) -> list[dict[str, float]]:
    return [{c.channel: c.rms_before for c in fall.channels}, {c.channel: c.rms_after for c in fall.channels}]


def _fall(
    observations: Observations,
    after: FloatArray,
    floor: dict[str, float],
    steps: Sequence[str],
    errors: Sequence[dict[str, float]],
    added: AddResult | None,
) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """Error before, after and the noise floor per channel, with maps of what is left."""
    rows = []
    for name in errors[0]:
        noise = (quantity(floor[name], name), f"{errors[-1][name] / floor[name]:.2f}") if name in floor else ()
        values = (quantity(one[name], name) for one in errors)
        rows.append((CHANNEL_WORDS[name], *values, *(noise or (NOTHING, NOTHING))))
    facts = {
        "added": added,
        "level": LEVEL_AFTER,
        "steps": [f"with {name}" for name in steps],
        "fall_rows": rows,
        "tolerances": [
            (name.removesuffix("_error"), value)
            for one in (added.base if added else ())
            for name, value in one.parameters.items()
        ],
        "size_rows": [
            (
                size.effect,
                CHANNEL_WORDS[size.channel],
                quantity(size.change, size.channel),
                " … ".join(quantity(end, size.channel) for end in size.ci95),
                percent(size.of_largest),
                f"{quantity(size.distance_m, 'm')}, {quantity(size.current_A, 'A')}",
            )
            for size in (added.sizes if added else ())
        ],
    }
    maps = [("before", observations.residual), ("after", after)]
    return facts, {
        "waterfall": partial(waterfall_figure, list(zip(("model", *steps), errors, strict=True)), floor),
        "after-maps": partial(residual_maps_figure, observations, maps, floor, sigma=True),
    }
