"""The words of simulations: each result has one template in ``templates``, which is filled with its numbers and codes.

Paragraphs become lines as in :mod:`femfit.core.words`.
"""

from functools import cache
from math import degrees, isfinite
from typing import TYPE_CHECKING, Any

from femfit.core.text import quoted
from femfit.core.words import lines_of, templates_of
from femfit.model.sensors import HALL
from femfit.simulation import constants

if TYPE_CHECKING:
    from jinja2 import Environment


def sentence(template: str, macro: str, *facts: Any) -> str:
    """The lines that a macro of a template makes of facts."""
    return "\n".join(lines_of(str(getattr(_environment().get_template(f"{template}.j2").module, macro)(*facts))))


def sensor_word(name: str) -> str:
    """A sensor as it is written."""
    return "Hall" if name == HALL else name


@cache
def _environment() -> "Environment":
    environment = templates_of("femfit.simulation")
    written = (degrees, isfinite, quoted, sensor_word)
    environment.filters |= {function.__name__: function for function in written}
    environment.globals |= {name: value for name, value in vars(constants).items() if name.isupper()}
    environment.globals["zip"] = zip
    return environment
