"""The words of results: each result has one template in ``templates``, which is filled with its numbers and codes."""

from functools import cache
from typing import TYPE_CHECKING, Any

from femfit.core.words import lines_of, templates_of
from femfit.estimate import constants

if TYPE_CHECKING:
    from jinja2 import Environment


def sentence(template: str, macro: str, *facts: Any) -> str:
    """The lines that a macro of a template makes of facts."""
    return "\n".join(lines_of(str(getattr(_environment().get_template(f"{template}.j2").module, macro)(*facts))))


@cache
def _environment() -> "Environment":
    environment = templates_of("femfit.estimate")
    environment.globals |= {name: value for name, value in vars(constants).items() if name.isupper()}
    environment.globals["zip"] = zip
    return environment
