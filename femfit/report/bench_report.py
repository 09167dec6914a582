"""The page on a comparison, a diagnosis, or what was added; its words stand in ``templates/bench``."""

import shlex
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from femfit import __version__
from femfit.effects.catalogue import device_effects
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.before_after import AddResult
from femfit.identify.compare import Comparison
from femfit.identify.constants import LEVEL_AFTER
from femfit.identify.decision.diagnose import Diagnosis, said_of
from femfit.identify.misfit import sweep_words
from femfit.identify.settings import setting_cells
from femfit.identify.suggest import Suggestion
from femfit.identify.words import sentence
from femfit.report.figures import figures_of
from femfit.report.misfit_figures import bench_of
from femfit.report.page import render
from femfit.report.style import NOTHING, svg_uri
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
    observations, evidence, source = diagnosis.observations, diagnosis.campaign, data.source if data else SOURCE
    recorded_motion = "velocity_m_s" in observations.covariates  # readings are windows of a time series
    distinct = not recorded_motion and "mount" in observations.given  # whether mounts are told from runs
    verdict = said_of(diagnosis, "verdict")
    certainty = said_of(diagnosis, "certainty") if diagnosis.missing else ""
    facts: dict[str, Any] = {
        "lead": f"{source} beside the model's predictions",
        "summary": _summary(diagnosis, suggestions, verdict, certainty),
        "data": data,
        "diagnosis": diagnosis,
        "verdict": verdict,
        "certainty": certainty,
        "classes": [effect for effect in diagnosis.missing if len(effect.members) > 1],
        "hashes": hashes,
        "recorded_motion": recorded_motion,
        "runs": len(np.unique(observations.covariates["run"])),
        "mounts": len(np.unique(observations.covariates["mount"])) if distinct else 0,
        "settings": len(np.unique(setting_cells(observations))),
        "noise": None if evidence is None else evidence.noise,
        "findings": observations.findings if evidence is None else diagnosis.findings,
        "quoted_source": shlex.quote(source),
    }
    sections = ["curves", "measured", "misfit", "provenance"]
    if evidence is not None:
        sections += ["explained", "alternatives"]
        facts |= _explained(diagnosis)
    if diagnosis.verdict != "nothing_missing":
        sections.append("next")
        possible = device_effects(observations.nominal.circuits, observations.nominal.drawn)
        members = dict.fromkeys(name for effect in diagnosis.missing for name in effect.members if name in possible)
        facts["suggestions"] = suggestions[:SHOWN]
        facts["experiments"] = [(name, possible[name].experiment) for name in members]
    if bench_of(diagnosis).effects:
        sections.append("fall")
        facts |= {"added": None, "named": diagnosis.missing, "error_fall": diagnosis.error_fall}
    return _render(diagnosis, facts, sections)


def render_comparison(comparison: Comparison) -> str:
    """The page on a comparison: the answer, measured points on the model's curves, maps of the misfit."""
    summary = [("", line) for line in str(comparison).splitlines() if line.strip()][:SHOWN]
    facts = {"lead": "what was measured beside the model's predictions", "summary": summary, "diagnosis": None}
    return _render(comparison, facts, ["curves", "misfit"])


def render_added(result: AddResult) -> str:
    """The page on effects that were added: measured points before and after, and how far the error fell."""
    lines = [line.strip() for line in str(result).splitlines() if line.strip()]
    facts = {
        "added": result,
        "named": [added.effect for added in result.added],
        "error_fall": result.fall,
        "lead": "the model before and after the refit",
        "summary": [("", line) for line in lines],
        "hashes": (),
        "remainder": lines[:1],
    }
    return _render(result, facts, ["curves", *(["remainder"] if result.parts else []), "fall", "provenance"])


def _render(result: Comparison | Diagnosis | AddResult, facts: Mapping[str, Any], sections: Sequence[str]) -> str:
    drawn = {name: svg_uri(draw, name) for name, draw in figures_of(result).items()}
    versions = [("femfit", __version__), *((name, version(name)) for name in ("numpy", "scipy", "matplotlib"))]
    shared = {
        "title": f"{result.model.name}: the bench and the model",
        "observations": result.observations,
        "bench": bench_of(result),
        "level": LEVEL_AFTER,
        "versions": versions,
        "sections": sections,
    }
    page = render("bench.html.j2", {**shared, **facts}, drawn)
    return titled(page, titles_of(result.observations.nominal.drawn))


def _summary(
    diagnosis: Diagnosis, suggestions: Sequence[Suggestion], verdict: str, certainty: str
) -> list[tuple[str, str]]:
    summary = [("Verdict", verdict)]
    if diagnosis.where.channel:
        summary.append(("Where", diagnosis.where.sentence))
    if certainty:
        summary.append(("How certain", certainty))
    if suggestions or diagnosis.own_misfit:
        finer = sentence("allowances", "finer_model", sweep_words(diagnosis.model)["finer"])
        summary.append(("Next", suggestions[0].text if suggestions else finer))
    if diagnosis.missing:
        fall = diagnosis.error_fall
        summary.append(("Error", f"{max(fall.channels, key=lambda channel: channel.before_over_noise or 0.0)}."))
    return summary


def _explained(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the verdict names, how much each effect explains alone, and what the data could have shown."""
    nominal, excess = diagnosis.observations.nominal, max(diagnosis.excess, 1e-12)
    effects = device_effects(nominal.circuits, nominal.drawn)
    testable = [score for score in diagnosis.ranking if not score.note]
    shares = [(s.name, (s.chi2_fall - s.degrees_of_freedom) / excess, s.explained_share) for s in testable[:RANKED]]
    return {
        "explained": [(effect, effects.get(effect.name)) for effect in diagnosis.missing],
        "shares": shares if diagnosis.verdict != "nothing_missing" else [],
        "detectable": [
            (name, smallest_visible(effects[name], amplitudes, nominal) or NOTHING)
            for name, amplitudes in diagnosis.detectable.items()
            if name in effects
        ],
        "hidden": [score for score in diagnosis.ranking if score.note],
    }
