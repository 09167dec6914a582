"""The page on a comparison, a diagnosis, or what was added; its words stand in ``templates/bench``."""

import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from femfit import __version__
from femfit.effects.catalogue import device_effects
from femfit.effects.effect import AddedEffect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.add_result import AddResult
from femfit.identify.compare import Comparison
from femfit.identify.constants import LEVEL_AFTER
from femfit.identify.decision.diagnosis import Diagnosis, certainty_sentence, verdict_sentence
from femfit.identify.misfit import finer_model, measured_curves
from femfit.identify.observations import Observations
from femfit.identify.remainder import RemainderResult
from femfit.identify.settings import setting_cells
from femfit.identify.suggest import Suggestion
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.report.misfit_figures import (
    curves_figure,
    residual_maps_figure,
    worst_first,
)
from femfit.report.page import render
from femfit.report.style import NOTHING, Drawing, svg_uri
from femfit.tables.measurement import Measurement

SHOWN = 6
"""Most lines of a comparison at the head of its page, and most suggestions in the table."""

RANKED = 12
"""Most effects whose shares of the misfit are listed."""

SOURCE = "measurement"
"""What was measured is called where only its diagnosis is given."""


def render_diagnosis(
    diagnosis: Diagnosis,
    data: Measurement | None = None,
    *,
    suggestions: Sequence[Suggestion] = (),
    hashes: Sequence[tuple[str, str]] = (),
) -> str:
    """The report of a diagnosis as HTML text.

    The data are for what they say of themselves; hashes are files and their SHA-256.
    """
    observations, floor, source = diagnosis.observations, dict(diagnosis.noise_floor), data.source if data else SOURCE
    has_floor = bool(floor)
    scale = floor or dict.fromkeys(observations.channels, 1.0)
    effects = diagnosis.explanations[0].effects if diagnosis.explanations else ()
    facts, figures = _curves(diagnosis.model, observations, effects, floor)
    figures["misfit-maps"] = partial(residual_maps_figure, observations, scale, has_floor)
    facts |= {
        "title": f"{diagnosis.model.name}: the bench and the model",
        "lead": f"{source} beside the model's predictions",
        "summary": _summary(diagnosis, suggestions),
        "data": data,
        "diagnosis": diagnosis,
        "observations": observations,
        "verdict": verdict_sentence(diagnosis),
        "certainty": certainty_sentence(diagnosis) if diagnosis.missing else "",
        "classes": [effect for effect in diagnosis.missing if len(effect.members) > 1],
        "known": has_floor,
        "hashes": hashes,
        **_measured_facts(diagnosis),
    }
    sections = ["curves", "measured", "misfit", "provenance"]
    if diagnosis.decision is not None:
        sections += ["explained", "alternatives"]
        facts |= _explained(diagnosis)
    if diagnosis.verdict != "nothing_missing":
        sections.append("next")
        nominal = diagnosis.observations.nominal
        possible = device_effects(nominal.circuits, nominal.drawn)
        members = dict.fromkeys(name for effect in diagnosis.missing for name in effect.members if name in possible)
        facts["suggestions"] = suggestions[:SHOWN]
        facts["experiments"] = [(name, possible[name].experiment) for name in members]
    if effects:
        sections.append("fall")
        steps = [" + ".join(effect.name for effect in diagnosis.missing)]
        errors = [diagnosis.error_fall.rms_before, diagnosis.error_fall.rms_after]
        facts |= _error_fall(floor, steps, errors) | {"added": None, "quoted_source": shlex.quote(source)}
    return titled(_render(facts, sections, figures), titles_of(observations.nominal.drawn))


def render_comparison(comparison: Comparison) -> str:
    """The page on a comparison: the answer, measured points on the model's curves, maps of the misfit."""
    observations = comparison.observations
    floor = {channel.channel: channel.noise_floor for channel in comparison.channels if channel.noise_floor is not None}
    has_floor = len(floor) == len(comparison.channels)
    scale = floor if has_floor else dict.fromkeys(observations.channels, 1.0)
    facts, figures = _curves(comparison.model, observations, (), floor)
    figures["misfit-maps"] = partial(residual_maps_figure, observations, scale, has_floor)
    facts |= {
        "title": f"{comparison.model.name}: the bench and the model",
        "lead": "what was measured beside the model's predictions",
        "summary": [("", line) for line in str(comparison).splitlines() if line.strip()][:SHOWN],
        "diagnosis": None,
        "known": has_floor,
    }
    return _render(facts, ["curves", "misfit"], figures)


def render_added(result: AddResult) -> str:
    """The page on effects that were added: measured points before and after, and how far the error fell."""
    observations, effects = result.observations, result.added
    effects_kept = tuple(added for added in result.model.effects if added.effect.name in result.kept)
    model = with_effects(result.model.without_effects, effects_kept)
    facts, figures = _curves(model, observations, effects, result.floor)
    errors = [result.fall.rms_before, result.fall.rms_after]
    steps = [" + ".join(added.effect.name for added in effects) or "nothing added"]
    facts |= _error_fall(dict(result.floor), steps, errors) | {
        "added": result,
        "title": f"{result.model.name}: the bench and the model",
        "lead": "the model before and after the refit",
        "summary": [("", line.strip()) for line in str(result).splitlines() if line.strip()],
        "hashes": (),
    }
    sections = ["curves", "fall", "provenance"]
    if isinstance(result, RemainderResult) and result.parts:
        sections.insert(1, "remainder")
        facts["remainder"] = str(result).splitlines()[:1]
    return titled(_render(facts, sections, figures), titles_of(observations.nominal.drawn))


def _render(facts: Mapping[str, Any], sections: Sequence[str], figures: Mapping[str, Drawing]) -> str:
    drawn = {name: svg_uri(draw, name) for name, draw in figures.items()}
    versions = [("femfit", __version__), *((name, version(name)) for name in ("numpy", "scipy", "matplotlib"))]
    return render("bench.html.j2", {**facts, "versions": versions, "sections": sections}, drawn)


def _curves(
    model: ActuatorModel, observations: Observations, effects: Sequence[AddedEffect], floor: Mapping[str, float]
) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """Each channel's readings on the model's curves before and after, the worst channel first."""
    curves = worst_first(measured_curves(model, observations, after=effects, noise=dict(floor)))
    names = list(dict.fromkeys(effect.effect.name for effect in effects))
    drawn: dict[str, Drawing] = {
        f"curves-{curve.channel}": partial(curves_figure, curve, fitted=bool(effects)) for curve in curves
    }
    return {"curves": curves, "effects": names}, drawn


def _summary(diagnosis: Diagnosis, suggestions: Sequence[Suggestion]) -> list[tuple[str, str]]:
    summary = [("Verdict", verdict_sentence(diagnosis))]
    if diagnosis.where.channel:
        summary.append(("Where", diagnosis.where.sentence))
    if diagnosis.missing:
        summary.append(("How certain", certainty_sentence(diagnosis)))
    if suggestions or diagnosis.own_misfit:
        summary.append(("Next", suggestions[0].text if suggestions else finer_model(diagnosis.model)))
    if diagnosis.missing:
        fall = diagnosis.error_fall
        summary.append(("Error", f"{max(fall.channels, key=lambda channel: channel.before_over_noise or 0.0)}."))
    return summary


def _measured_facts(diagnosis: Diagnosis) -> dict[str, Any]:
    """What was read, of which channels, and how their noise is known."""
    observations, evidence = diagnosis.observations, diagnosis.campaign
    recorded_motion = "velocity_m_s" in observations.covariates  # readings are windows of a time series
    distinct = not recorded_motion and "mount" in observations.given  # whether mounts are told from runs
    return {
        "recorded_motion": recorded_motion,
        "runs": len(np.unique(observations.covariates["run"])),
        "mounts": len(np.unique(observations.covariates["mount"])) if distinct else 0,
        "settings": len(np.unique(setting_cells(observations))),
        "noise": None if evidence is None else evidence.noise,
        "findings": observations.findings if evidence is None else diagnosis.findings,
    }


def _explained(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the verdict names, how much each effect explains alone, and what the data could have shown."""
    nominal, excess = diagnosis.observations.nominal, max(diagnosis.excess, 1e-12)
    effects = device_effects(nominal.circuits, nominal.drawn)
    testable = [score for score in diagnosis.ranking if not score.note]
    shares = [(s.name, (s.chi2_fall - s.degrees_of_freedom) / excess, s.explained_share) for s in testable[:RANKED]]
    return {
        "named": [(effect, effects.get(effect.name)) for effect in diagnosis.missing],
        "shares": shares if diagnosis.verdict != "nothing_missing" else [],
        "detectable": [
            (name, smallest_visible(effects[name], amplitudes, nominal) or NOTHING)
            for name, amplitudes in diagnosis.detectable.items()
            if name in effects
        ],
        "hidden": [score for score in diagnosis.ranking if score.note],
    }


def _error_fall(
    floor: Mapping[str, float], steps: Sequence[str], errors: Sequence[Mapping[str, float]]
) -> dict[str, Any]:
    """Error per channel before, with each step, and the noise floor."""
    return {"level": LEVEL_AFTER, "steps": [f"with {name}" for name in steps], "errors": errors, "floor": floor}
