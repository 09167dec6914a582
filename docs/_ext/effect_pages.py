"""A page an effect, made from the catalogue, with its signature on a small levitation rig drawn."""

from dataclasses import replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from effect_signature import Signature, effect_signature
from femfit.device.load import actuator_from_toml
from femfit.device.mechanics import Spring
from femfit.effects.catalogue import BUILT_IN
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, Effect, EffectParameter
from femfit.effects.words import describe
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import nominal_of

ROOT = Path(__file__).parents[2]

WHERE = {
    "bench": "what the bench records",
    "magnetics": "the magnetic field",
    "force": "the force on the moving part",
    "circuit": "the electric circuit",
    "motion": "the motion",
    "sensor": "a sensor",
}
CHANNELS = {
    "force_N": ("force", "mN", 1e3),
    "flux_linkage_Wb": ("flux linkage", "µWb", 1e6),
    "hall_V": ("Hall voltage", "mV", 1e3),
    "voltage_V": ("voltage", "mV", 1e3),
    "rest_distance_m": ("distance at rest", "µm", 1e6),
    "acceleration_m_s2": ("acceleration", "m/s²", 1.0),
    "current_rate_A_s": ("rate of the current", "A/s", 1.0),
}


PANELS_WIDE = 3
SMALLEST_SHARE = 1e-6
SPRING = Spring(1.0, 0.01, 45e-3)
"""Of the rig where an effect is one of a drawn spring: 1 N/m, with a preload of 10 mN at 45 mm."""


def pages() -> dict[str, str]:
    """Every page and picture by its file name."""
    plain = _model()
    sprung = replace(plain, motion=replace(plain.require_motion(), springs=(SPRING,)))
    result = {"effects/index.md": _index()}
    for effect in BUILT_IN:
        model = sprung if "spring" in effect.needs else plain
        signature = effect_signature(model, effect)
        result[f"effects/{effect.name}.md"] = _page(signature, nominal_of(model))
        result[f"effects/{effect.name}.svg"] = _picture(signature)
    return result


def _model() -> ActuatorModel:
    """The rig of the examples, from a sweep of few points that takes two seconds."""
    text = (ROOT / "geometry" / "emaws-rig.toml").read_text(encoding="utf-8")
    lines = [
        "distance_mm = [15, 16, 17.5, 19, 21, 23, 26, 30, 36, 45]" if line.startswith("distance_mm = {") else line
        for line in text.splitlines()
    ]
    with TemporaryDirectory() as directory:
        return fit_model(run_sweep(actuator_from_toml("\n".join(lines)), Path(directory), workers=1)).model


def _index() -> str:
    rows = "".join(f"| [{_title(effect)}]({effect.name}.md) | {effect.symptom} |\n" for effect in BUILT_IN)
    names = "\n".join(effect.name for effect in BUILT_IN)
    return f"{_INDEX}{rows}\n```{{toctree}}\n:hidden:\n{names}\nAll in one table </effects>\n```\n"


def _page(signature: Signature, nominal: Nominal) -> str:
    effect = signature.effect
    acts = " and ".join(WHERE.get(place, place) for place in effect.acts_on)
    rows = "".join(_row(p) for p in effect.parameters)
    numbers = [f"`{name}` = {value:.3g}" for name, value in signature.parameters.items()]
    drawn = "; ".join(describe(AddedEffect(effect, signature.parameters), nominal) or numbers)
    calibrations = "".join(f"- {one.instruction}\n" for one in effect.calibrations)
    direct = f"\n## A direct check\n\n{calibrations}" if calibrations else ""
    spring = (
        "The rig was given a spring of 1 N/m with a preload of 10 mN at 45 mm. " if "spring" in effect.needs else ""
    )
    return (
        f"# {_title(effect)}\n\n`{effect.name}` changes {acts}.\n\n**What one sees.** {effect.symptom}\n\n"
        f"**How to isolate it.** {effect.experiment}\n\n"
        f"## Its signature\n\n![What {effect.name} changes over distance and current]({effect.name}.svg)\n\n"
        "What the effect adds to each reading of the levitation rig `geometry/emaws-rig.toml`. Each line is a current, "
        f"from the smallest (light) to the largest (dark). {spring}{signature.conditions} Drawn here: {drawn}.\n\n"
        f"## Its numbers\n\n| parameter | unit | plausible range | meaning |\n|---|---|---|---|\n{rows}{direct}\n"
        f"## Source\n\n{effect.reference}\n"
    )


def _row(p: EffectParameter) -> str:
    unit = p.unit or (f"part of the {p.scale.replace('_', ' ')}" if p.scale else "1")
    low, high = p.plausible
    return f"| `{p.name}` | {unit} | {low:g} to {high:g} | {p.description} |\n"


def _title(effect: Effect) -> str:
    return effect.name.replace("_", " ").capitalize()


def _picture(signature: Signature) -> str:
    """One panel a channel that changes: the change over distance, a line a current."""
    shown = [name for name in signature.visible if name in CHANNELS and _matters(signature, name)]
    wide = min(len(shown), PANELS_WIDE)
    high = -(-len(shown) // wide)
    figure = Figure(figsize=(2.7 * wide + 0.3, 2.5 * high), layout="constrained")
    FigureCanvasSVG(figure)
    panels = figure.subplots(high, wide, squeeze=False).ravel()
    for panel in panels[len(shown) :]:
        panel.set_axis_off()
    lines = range(0, len(signature.current_A), 2)
    for panel, name in zip(panels, shown, strict=False):
        title, unit, factor = CHANNELS[name]
        for k in lines:
            shade = 0.25 + 0.75 * k / max(lines)
            colour = (0.0, 0.35 * (2 - shade) * 0.75, 0.7, 0.25 + 0.75 * shade * shade)
            panel.plot(1e3 * signature.distance_m, factor * signature.change[name][:, k], color=colour, lw=1.2)
        panel.axhline(0.0, color="0.6", lw=0.6)
        largest = float(f"{factor * float(np.nanmax(np.abs(signature.plain[name]))):.3g}")
        panel.set_title(f"{title} ({unit})\nof {largest:,g} at most", fontsize=9)
        panel.set_xlabel("distance (mm)")
    text = StringIO()
    with rc_context({"svg.hashsalt": signature.effect.name}):  # the same file each time
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


def _matters(signature: Signature, name: str) -> bool:
    """Whether a change can be seen beside the reading at all."""
    change, plain = np.abs(signature.change[name]), np.abs(signature.plain[name])
    return bool(np.nanmax(change) > SMALLEST_SHARE * np.nanmax(plain))


_INDEX = """\
# Effects

An effect is one physical reason why a bench may disagree with a model. `femfit diagnose` compares the data with each of
them, `femfit add` fits one to the data, and a model with effects simulates, filters and exports like any other.

| effect | what one sees |
|---|---|
"""
