"""The numbers in the tables of a report on a bench, with the figures that belong to them."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.effects.catalogue import device_effects
from femfit.effects.words import smallest_visible
from femfit.identify.add_result import AddResult
from femfit.identify.constants import LEVEL_AFTER
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.observations import Observations
from femfit.identify.settings import setting_cells
from femfit.identify.suggest import Suggestion
from femfit.report.explained_figures import ranking_figure, waterfall_figure
from femfit.report.misfit_figures import residual_maps_figure
from femfit.report.style import NOTHING, Drawing

SHOWN = 6
"""Suggestions in the table."""


def measured_facts(diagnosis: Diagnosis) -> dict[str, Any]:
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


def explained(diagnosis: Diagnosis) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """What the verdict names, how it ranks, and what the data could have shown."""
    nominal = diagnosis.observations.nominal
    effects = device_effects(nominal.circuits, nominal.drawn)
    facts = {
        "named": [(effect, effects.get(effect.name)) for effect in diagnosis.missing],
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
    named = [effect.name for effect in diagnosis.missing]
    members = [name for effect in diagnosis.missing for name in effect.members[1:]]
    return facts, {"ranking-effects": partial(ranking_figure, testable, diagnosis.excess, named, members)}


def next_facts(diagnosis: Diagnosis, advice: Sequence[Suggestion]) -> dict[str, Any]:
    """The measurement that would decide."""
    decision, nominal = diagnosis.decision, diagnosis.observations.nominal
    effects = device_effects(nominal.circuits, nominal.drawn)
    nearest = None
    best = next(iter(decision.fits.values()), None) if decision else None
    if best is not None and diagnosis.campaign is not None:
        free = best.jacobian[:, ~best.active]
        excess = diagnosis.campaign.patterns.excess(best.whitened_residual, free)
        share = 1.0 - excess / diagnosis.excess if diagnosis.excess > 0.0 else 0.0
        nearest = (best.names, float(np.clip(share, 0.0, 1.0)))
    suggestions = []
    for measurement in advice[:SHOWN]:
        pairs = sorted(
            ((*_unlike(a, b), sigma) for a, b, sigma in measurement.separates), key=lambda pair: round(pair[2], 6)
        )
        suggestions.append((measurement, pairs, [" and ".join(_unlike(a, b)) for a, b in measurement.remains]))
    names = dict.fromkeys(name for effect in diagnosis.missing for name in effect.members if name in effects)
    return {
        "nearest": nearest,
        "suggestions": suggestions,
        "experiments": [(name, effects[name].experiment) for name in names],
    }


def _unlike(a: str, b: str) -> tuple[str, str]:
    """Two explanations without the effects that both have."""
    first, second = a.split(" + "), b.split(" + ")
    differences = [name for name in first if name not in second], [name for name in second if name not in first]
    return " + ".join(differences[0]) or a, " + ".join(differences[1]) or b


def error_fall(
    observations: Observations,
    after: FloatArray,
    floor: dict[str, float],
    steps: Sequence[str],
    errors: Sequence[dict[str, float]],
    added: AddResult | None,
) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """Error before, after and the noise floor per channel, with maps of what is left."""
    facts = {
        "added": added,
        "level": LEVEL_AFTER,
        "steps": [f"with {name}" for name in steps],
        "errors": errors,
        "floor": floor,
        "tolerances": [
            (name.removesuffix("_error"), value)
            for parameter in (added.base if added else ())
            for name, value in parameter.parameters.items()
        ],
    }
    maps = [("before", observations.residual), ("after", after)]
    return facts, {
        "waterfall": partial(waterfall_figure, list(zip(("model", *steps), errors, strict=True)), floor),
        "after-maps": partial(residual_maps_figure, observations, maps, floor, sigma=True),
    }
