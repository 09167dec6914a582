"""How results are shown, what is remarked on data, and values that are remembered with their object.

A remark has a code that programs match, and a sentence that people read.
"""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import wraps
from html import escape
from typing import Any, Literal, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from femfit.core.text import quoted


class Printed:
    """Shows the lines of a class's ``__str__`` in a notebook, and its name with the first of them at a prompt."""

    def __repr__(self) -> str:
        first, _, _ = str(self).partition("\n")
        return f"<{type(self).__name__}: {first}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


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

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as a dictionary for JSON."""
        return asdict(self)


def listing(items: Iterable[object], limit: int = 8) -> str:
    """List the first items, as they may stand in a message, and say how many more there are."""
    items = list(items)
    shown = ", ".join(quoted(item) for item in items[:limit])
    return shown if len(items) <= limit else f"{shown} and {len(items) - limit} more"


Given = TypeVar("Given")
Found = TypeVar("Found")


def remembered(function: Callable[[Given], Found]) -> Callable[[Given], Found]:
    """A function of one immutable object that is called once for each; an array that it returns cannot be written to.

    >>> class Coil: pass
    >>> ohms = remembered(lambda coil: np.ones(2))
    >>> coil = Coil()
    >>> ohms(coil) is ohms(coil)
    True
    """
    results: WeakKeyDictionary[Given, Found] = WeakKeyDictionary()

    @wraps(function)
    def once(subject: Given) -> Found:
        if subject not in results:
            result = function(subject)
            if isinstance(result, np.ndarray):
                result.flags.writeable = False
            results[subject] = result
        return results[subject]

    return once
