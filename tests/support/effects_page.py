"""The page docs/effects.md, made from the catalogue: ``python tests/support/effects_page.py`` writes it anew."""

from pathlib import Path

from femfit.effects.catalogue import BUILT_IN
from femfit.effects.effect import Effect, EffectParameter

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"

_HEAD = """\
# Effects that a model may lack

An effect is one physical reason why a bench may disagree with a model. `femfit diagnose` names effects, `femfit add`
fits them, and simulation, filters and export run them. They stand in `femfit/effects`.

Only effects that the device can have and the data can show are considered: a magnet's with a magnet, a core's with
iron, a drawn spring's with a spring in `[mechanics]`, a lacking spring without one, a sensor's with its readings.
`femfit diagnose` says of every other effect why it was left out.

| effect | what one sees | where it acts | the measurement that isolates it |
|---|---|---|---|
"""

_MIDDLE = """
## Parameters

A fitted value outside of the plausible range is reported as suspicious. A nonlinear parameter shapes the effect and
changes nothing while the others are zero; the number behind it is where the fit begins. The unit "of force_N" means a
part of the largest force in the model.

| effect | parameter | unit | plausible range | meaning |
|---|---|---|---|---|
"""


def page() -> str:
    """The whole text."""
    first = "".join(_row(effect) for effect in BUILT_IN)
    second = "".join(_parameter(effect, p) for effect in BUILT_IN for p in effect.parameters)
    sources = "".join(f"- `{effect.name}`: {effect.reference}\n" for effect in BUILT_IN)
    return f"{_HEAD}{first}{_MIDDLE}{second}\n## Sources\n\n{sources}"


def _row(effect: Effect) -> str:
    return f"| `{effect.name}` | {effect.symptom} | {', '.join(effect.acts_on)} | {effect.experiment} |\n"


def _parameter(effect: Effect, p: EffectParameter) -> str:
    unit = p.unit or (f"of {p.scale}" if p.scale else "1")
    usual = f"{p.plausible[0]:g} to {p.plausible[1]:g}" + (f" (nonlinear, {p.null:g})" if p.nonlinear else "")
    return f"| `{effect.name}` | `{p.name}` | {unit} | {usual} | {p.description} |\n"


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
