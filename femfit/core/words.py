"""Templates of what results say.

A paragraph is one printed line, however it is broken; ``>`` before it stands for two blanks each, and ``fixed`` keeps
the blanks of a column.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from femfit.core.results import Finding, Severity
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
    """To so many digits, without trailing zeros, and in powers of ten only where it is very large or small."""
    return f"{float(f'{value:.{digits}g}'):.6g}"


class Words:
    """The templates of a room: each result has one, which is filled with its numbers and codes.

    Parameters
    ----------
    package : str
        Whose folder ``templates`` they stand in.
    filters, named : callable
        Filters beside those that write numbers, by their own names or by others.
    names : mapping of str to object
        What templates know beside the facts that fill them.
    """

    def __init__(
        self, package: str, *filters: Callable[..., Any], names: Mapping[str, Any], **named: Callable[..., Any]
    ) -> None:
        self._package, self._names = package, names
        self._filters = {each.__name__: each for each in (amount, amount_range, counted, *filters)} | named

    @cached_property
    def environment(self) -> "Environment":
        """The templates with their filters."""
        from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415  who prints nothing needs none

        environment = Environment(  # noqa: S701  plain text
            loader=PackageLoader(self._package), trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
        )
        environment.filters |= self._filters
        environment.filters |= {"oneline": lambda text: " ".join(text.split()), "sig": significant}
        environment.filters["fixed"] = lambda text: text.replace(" ", "\xa0")
        environment.globals |= {"zip": zip, **self._names}
        return environment

    def lines(self, template: str, macro: str, *facts: Any) -> Iterator[str]:
        """The lines that a macro of a template makes of facts."""
        module = self.environment.get_template(f"{template}.j2").module
        return lines_of(str(getattr(module, macro)(*facts)))

    def finding(self, code: str, column: str = "", size: float | None = None, words: str = "", **facts: Any) -> Finding:
        """A finding whose severity, text and remedy stand under its code, or under other words, in ``findings.j2``."""
        severity, text, remedy = (*self.lines("findings", words or code.replace("-", "_"), facts), "")[:3]
        return Finding(code, cast("Severity", severity), text, remedy, size, column)

    def sentence(self, template: str, macro: str, *facts: Any) -> str:
        """The same as one text."""
        return "\n".join(self.lines(template, macro, *facts))


def constants_of(module: ModuleType) -> dict[str, Any]:
    """Constants of a module by their names."""
    return {name: value for name, value in vars(module).items() if name.isupper()}
