"""What commands print that is no result's own text: the words stand in ``templates``, the numbers come from below."""

from functools import cache
from typing import TYPE_CHECKING

from femfit.core.results import listing
from femfit.core.text import amount, counted

if TYPE_CHECKING:
    from jinja2 import Environment


def said(command: str, macro: str, *facts: object) -> str:
    """The text that a macro of a command's template makes of facts."""
    return str(getattr(_templates().get_template(f"{command}.txt.j2").module, macro)(*facts)).strip()


@cache
def _templates() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("femfit.cli"),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        autoescape=False,  # noqa: S701 - a terminal's text is no markup
    )
    environment.filters |= {"amount": amount, "counted": counted, "listing": listing}
    return environment
