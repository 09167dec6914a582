"""The page on a comparison, a diagnosis, or what was added; its words stand in ``templates/bench``."""

import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from femfit import __version__
from femfit.effects.effect import AddedEffect
from femfit.effects.words import titled, titles_of
from femfit.identify.add_result import AddResult
from femfit.identify.allowances import finer_model
from femfit.identify.compare import Comparison
from femfit.identify.decision.diagnosis import Diagnosis, certainty_sentence, verdict_sentence
from femfit.identify.misfit import ErrorFall, measured_curves
from femfit.identify.observations import Observations
from femfit.identify.remainder.result import RemainderResult
from femfit.identify.suggest import Suggestion
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.report.bench_facts import (
    error_fall,
    explained,
    measured_facts,
    next_facts,
)
from femfit.report.explained_figures import remainder_figure
from femfit.report.misfit_figures import (
    covariate_figure,
    curves_figure,
    residual_maps_figure,
    settings_figure,
    worst_first,
)
from femfit.report.page import render
from femfit.report.style import Drawing, svg_uri, write_picture
from femfit.tables.measurement import Measurement

SHOWN = 6
"""Most lines of a comparison at the head of its page."""

SOURCE = "measurement"
"""What was measured is called where only its diagnosis is given."""

DOTS_PER_INCH = 150

PANELS = 3
"""Most panels of a saved picture."""

SCALAR = (
    "coil_temperature_C", "magnet_temperature_C", "order", "elapsed", "branch", "run", "velocity_m_s",
    "current_rate_A_s",
)  # fmt: skip
"""Covariates that a map over distance and current does not show."""


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
    figures["settings"] = partial(settings_figure, observations)
    figures["misfit-maps"] = partial(
        residual_maps_figure, observations, [("", observations.residual)], scale, has_floor
    )
    covariates = [name for name in diagnosis.where.covariates if name in SCALAR] if has_floor else []
    if covariates:
        channel = diagnosis.where.channel
        values = observations.residual / scale[channel]
        figures["misfit-covariates"] = partial(covariate_figure, observations, values, channel, covariates)
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
        "covariates": covariates,
        "versions": _versions(),
        "hashes": hashes,
        **measured_facts(diagnosis),
    }
    sections = ["curves", "measured", "misfit", "provenance"]
    if diagnosis.decision is not None:
        sections += ["explained", "alternatives"]
        more, drawn = explained(diagnosis)
        facts, figures = facts | more, figures | drawn
    if diagnosis.verdict != "nothing_missing":
        sections.append("next")
        facts |= next_facts(diagnosis, suggestions)
    if effects:
        sections.append("fall")
        after = observations.value - observations.predict(effects)
        steps = [" + ".join(effect.name for effect in diagnosis.missing)]
        errors = [diagnosis.error_fall.rms_before, diagnosis.error_fall.rms_after]
        more, drawn = error_fall(observations, after, floor, steps, errors, None)
        facts |= more | {"quoted_source": shlex.quote(source)}
        figures |= drawn
    return titled(_render(facts, sections, figures), titles_of(observations.nominal.drawn))


def render_comparison(comparison: Comparison) -> str:
    """The page on a comparison: the answer, measured points on the model's curves, maps of the misfit."""
    observations = comparison.observations
    floor, scale, has_floor = noise_scale(comparison)
    facts, figures = _curves(comparison.model, observations, (), floor)
    figures["misfit-maps"] = partial(
        residual_maps_figure, observations, [("", observations.residual)], scale, has_floor
    )
    facts |= {
        "title": f"{comparison.model.name}: the bench and the model",
        "lead": "what was measured beside the model's predictions",
        "summary": [("", line) for line in str(comparison).splitlines() if line.strip()][:SHOWN],
        "diagnosis": None,
        "known": has_floor,
        "covariates": [],
    }
    return _render(facts, ["curves", "misfit"], figures)


def render_added(result: AddResult, hashes: Sequence[tuple[str, str]] = ()) -> str:
    """The page on effects that were added: measured points before and after, and how far the error fell."""
    observations, effects = result.observations, (*result.base, *result.added)
    effects_kept = tuple(added for added in result.model.effects if added.effect.name in result.kept)
    model = with_effects(result.model.without_effects, effects_kept)
    facts, figures = _curves(model, observations, effects, result.floor)
    after = observations.value - observations.predict(effects)
    errors, steps = [dict(step.rms) for step in result.steps], [step.text for step in result.steps[1:]]
    more, drawn = error_fall(observations, after, dict(result.floor), steps, errors, result)
    facts |= more | {
        "title": f"{result.model.name}: the bench and the model",
        "lead": "the model before and after the refit",
        "summary": [("", line.strip()) for line in str(result).splitlines() if line.strip()],
        "hashes": hashes,
        "versions": _versions(),
    }
    sections = ["curves", "fall", "provenance"]
    if isinstance(result, RemainderResult) and result.parts:
        sections.insert(1, "remainder")
        facts["remainder"] = result.sentences
        drawn["remainder"] = partial(remainder_figure, result.added[-1], observations)
    return titled(_render(facts, sections, figures | drawn), titles_of(observations.nominal.drawn))


def noise_scale(comparison: Comparison) -> tuple[dict[str, float], dict[str, float], bool]:
    """Noise of each channel in which it is known, what misfits are drawn in parts of, and whether that is noise."""
    floor = {channel.channel: channel.noise_floor for channel in comparison.channels if channel.noise_floor is not None}
    has_floor = len(floor) == len(comparison.channels)
    return floor, floor if has_floor else dict.fromkeys(comparison.observations.channels, 1.0), has_floor


def save_comparison_pictures(comparison: Comparison, directory: Path) -> list[Path]:
    """Write ``misfit-maps.png`` and ``misfit-CHANNEL-1.png`` and so on."""
    observations = comparison.observations
    floor, scale, has_floor = noise_scale(comparison)
    maps: Drawing = partial(residual_maps_figure, observations, [("", observations.residual)], scale, has_floor)
    figures = {"misfit-maps": maps}
    for channel, noise in floor.items():
        lines = [
            misfit_map.along[0]
            for misfit_map in comparison.maps
            if misfit_map.channel == channel and len(misfit_map.along) == 1
        ]
        names = [name for name in lines if name != "mount"]
        for first in range(0, len(names), PANELS):
            shown, misfit = names[first : first + PANELS], observations.residual / noise
            figures[f"misfit-{channel}-{1 + first // PANELS}"] = partial(
                covariate_figure, observations, misfit, channel, shown
            )
    files = [directory / f"{name}.png" for name in figures]
    for file, draw in zip(files, figures.values(), strict=True):
        write_picture(draw, file, DOTS_PER_INCH)
    return files


def _render(facts: Mapping[str, Any], sections: Sequence[str], figures: Mapping[str, Drawing]) -> str:
    drawn = {name: svg_uri(draw, name) for name, draw in figures.items()}
    return render("bench.html.j2", {**facts, "sections": sections}, drawn)


def _versions() -> list[tuple[str, str]]:
    return [("femfit", __version__), *((name, version(name)) for name in ("numpy", "scipy", "matplotlib"))]


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
        summary.append(("Error", f"{_worst(diagnosis.error_fall)}."))
    return summary


def _worst(fall: ErrorFall) -> str:
    """The fall of the error in the channel that was worst."""
    return str(max(fall.channels, key=lambda channel: channel.before_over_noise or 0.0))
