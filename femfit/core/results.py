"""How results are shown, what programs read of them, what is remarked on data, and values remembered with their object.

A remark has a code that programs match, and a sentence that people read.

Templates of what results say.

A paragraph is one printed line, however it is broken; ``>`` before it stands for two blanks each, and ``fixed`` keeps
the blanks of a column.
"""

import math
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, reduce, wraps
from html import escape
from importlib import import_module
from pathlib import PurePath
from types import ModuleType
from typing import TYPE_CHECKING, Any, Concatenate, Literal, ParamSpec, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np

from femfit.core.errors import UsageError
from femfit.core.text import amount, amount_range, counted, quoted


class Printed:
    """Shows the lines of a class's ``__str__`` in a notebook, and its name with the first of them at a prompt."""

    def __repr__(self) -> str:
        first, _, _ = str(self).partition("\n")
        return f"<{type(self).__name__}: {first}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


class Plotted(Printed):
    """Draws the figures of a result, too."""

    def plot(self, figure: str = "") -> "Figure":
        """Draw one of the figures that its page or picture has.

        Parameters
        ----------
        figure : str
            Name of the figure; the one that says most by default.

        Returns
        -------
        matplotlib.figure.Figure
            It knows nothing of pyplot; ``savefig`` writes it.

        Raises
        ------
        UsageError
            If there is no figure of this name, with the names that there are, or nothing to draw.

        Examples
        --------
        >>> import femfit as ff
        >>> ff.read_model("model.json").plot("stroke").savefig("stroke.png")
        """
        figures: dict[str, Callable[[], Figure]] = import_module("femfit.report.figures").figures_of(self)
        if not figures:
            raise UsageError(f"There is nothing to draw of {self!r}.")
        if figure not in {"", *figures}:
            raise UsageError(f"The figure must be {', '.join(figures)}; instead received {quoted(figure)}.")
        with import_module("femfit.report.style").style():
            return figures[figure or next(iter(figures))]()


class Result(Printed):
    """A result that programs read, too.

    ``data`` of its class, and of every record in it, names what they read, as ``name`` or as
    ``name=path.of.attributes``, which ends with None where one of them is None. Where no path leads there, ``data`` is
    a property with names and values. A record without ``data`` is read by its fields.
    """

    finite = False  # Whether NaN and infinity are null in ``to_dict``, too, as they are in every file

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return cast("dict[str, Any]", json_ready(self, finite=self.finite))


def json_ready(value: Any, *, finite: bool = True) -> Any:
    """What JSON can hold of a value: records as mappings, tuples and arrays as lists, paths as texts.

    NaN and infinity, which JSON does not have, are null, unless they need not be finite.
    """
    if is_dataclass(value):
        data = getattr(value, "data", None) or [field.name for field in fields(value)]
        value = data if isinstance(data, Mapping) else attributes(value, *data)
    elif isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: json_ready(item, finite=finite) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item, finite=finite) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    return None if finite and isinstance(value, float) and not math.isfinite(value) else value


def attributes(record: Any, *entries: str) -> dict[str, Any]:
    """Attributes of a record by their names, as ``data`` has its entries."""
    named = (entry.partition("=") for entry in entries)
    return {name: reduce(_attribute, (path or name).split("."), record) for name, _, path in named}


def _attribute(value: Any, name: str) -> Any:
    return None if value is None else getattr(value, name)


Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One remark about a table, a record or a model."""

    code: str  # Short and stable, such as ``suspected-unit``: what ``--accept`` takes and what programs compare
    # ``info``: nothing to do; ``warning``: look at it; ``error``: the data are refused unless the code is accepted
    severity: Severity
    text: str  # What was seen and what was done about it, in one or two whole sentences
    remedy: str = ""  # What the user should do; empty where there is nothing to do
    size: float | None = None  # How large it is, in the unit that the text names; shares as fractions
    column: str = ""  # The column that it concerns, where it concerns one

    def __str__(self) -> str:
        return f"{self.text} {self.remedy}".rstrip()

    @property
    def marked(self) -> str:
        """The sentence, behind the severity where there is something to do."""
        return str(self) if self.severity == "info" else f"{self.severity}: {self}"

    def accepted(self) -> "Finding":
        """Return the same finding as a warning, for a user who accepts it."""
        return replace(self, severity="warning", text=f"{self.text} (accepted)")


def listing(items: Iterable[object], limit: int = 8) -> str:
    """List the first items, as they may stand in a message, and say how many more there are."""
    items = list(items)
    shown = ", ".join(quoted(item) for item in items[:limit])
    return shown if len(items) <= limit else f"{shown} and {len(items) - limit} more"


Given = TypeVar("Given")
Found = TypeVar("Found")
P = ParamSpec("P")


_KEPT: WeakKeyDictionary[Any, dict[Hashable, Any]] = WeakKeyDictionary()
"""What :func:`kept` made, as long as its owner lives; nothing of it refers to the owner."""


Context = Callable[[], AbstractContextManager[None]]


def kept(owner: Any, key: Hashable, make: Callable[[], Found], within: Context = nullcontext) -> Found:
    """What is made for an immutable object under a key where it is not there, within a context.

    No pickle of the object has it. An array cannot be written to.
    """
    made = _KEPT.setdefault(owner, {})
    if key not in made:
        with within():
            made[key] = value = make()
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    return cast("Found", made[key])


def remembered(function: Callable[Concatenate[Given, P], Found]) -> Callable[Concatenate[Given, P], Found]:
    """A function of an immutable object that is called once for each, and for each of its further arguments.

    The results are :func:`kept` with the object.

    >>> class Coil: pass
    >>> ohms = remembered(lambda coil, turns=2: np.ones(turns))
    >>> coil = Coil()
    >>> ohms(coil) is ohms(coil), ohms(coil, 3).size
    (True, 3)
    """

    @wraps(function)
    def once(subject: Given, /, *arguments: P.args, **named: P.kwargs) -> Found:
        key = function, *arguments, *named.items()
        return kept(subject, key, lambda: function(subject, *arguments, **named))

    return once


if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


def lines_of(text: str) -> Iterator[str]:
    """The lines of a template that has been filled."""
    for paragraph in re.split(r"\n[ \t]*\n", text):
        if line := re.sub(r"[ \t\n]+", " ", paragraph.strip(" \t\n")):
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
