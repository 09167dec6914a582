"""The page docs/effects.md, made from the catalogue: ``python tests/support/effects_page.py`` writes it anew."""

from pathlib import Path

from jinja2 import Template

from femfit.effects.catalogue import BUILT_IN

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"


def page() -> str:
    """The whole text."""
    template = Path(__file__).with_name("effects.md.j2").read_text(encoding="utf-8")
    return Template(template, keep_trailing_newline=True).render(effects=BUILT_IN)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
