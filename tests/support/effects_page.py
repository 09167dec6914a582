"""The page docs/effects.md, made from the catalogue: ``python tests/support/effects_page.py`` writes it anew."""

from pathlib import Path

from femfit.effects.catalogue import BUILT_IN
from femfit.effects.effect import Effect, EffectParameter

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"

_HEAD = """\
# Effects that a model may lack

Each is one file in `femfit/effects`, with a family of shapes where one formula would miss what happens. `femfit
diagnose` names them, `femfit add` fits them, plant, filters and export run them. *Usual* is the range outside of which
a fitted value is reported as suspicious; parameters marked *shape* are constants of the family and do nothing alone. A
value that is *of* something is a part of that quantity's largest value in the model.

| effect | what one sees | where it acts | the measurement that isolates it |
|---|---|---|---|
"""

_MIDDLE = """
## Parameters

| effect | parameter | unit | usual | meaning |
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
