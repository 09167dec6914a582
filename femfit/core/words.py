"""Templates of what results say.

A paragraph is one printed line, however it is broken; ``>`` before it stands for two blanks each, and ``fixed`` keeps
the blanks of a column.
"""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from femfit.core.text import amount, amount_range, counted

if TYPE_CHECKING:
    from jinja2 import Environment


def lines_of(text: str) -> Iterator[str]:
    """The lines of a template that has been filled."""
    for paragraph in re.split(r"\n[ \t]*\n", text):
        line = re.sub(r"[ \t\n]+", " ", paragraph.strip(" \t\n"))
        if line:
            depth = len(line) - len(line.lstrip(">"))
            yield 2 * depth * " " + re.sub(r" ([.,;:])(?=\s|$)", r"\1", line[depth:].strip(" ")).replace("\xa0", " ")


def significant(value: float, digits: int = 3) -> str:
    """To so many digits, without trailing zeros."""
    return f"{value:.{digits}g}"


def templates_of(package: str) -> "Environment":
    """The templates of a room with the filters that write numbers."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415  who prints nothing needs none

    environment = Environment(  # noqa: S701  plain text
        loader=PackageLoader(package), trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    environment.filters |= {function.__name__: function for function in (amount, amount_range, counted)}
    environment.filters |= {"oneline": lambda text: " ".join(text.split()), "sig": significant}
    environment.filters["fixed"] = lambda text: text.replace(" ", "\xa0")
    return environment
