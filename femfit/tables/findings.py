"""What is remarked on a table or a drawing: codes and numbers in Python, severity and sentences in ``findings.toml``.

Why a table is refused stands in ``refusals.toml``.

A key of that file is a code, and where a code has several sentences a word behind it: ``clock pauses``. A text has the
fields of :meth:`str.format`; a count also takes its noun and verb, ``{rows:row was|rows were}``, or after ``~`` the
word alone, ``{rows:~is|are}``.
"""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from femfit.core.errors import TableError
from femfit.core.results import Finding
from femfit.core.text import counted


class _Count(int):
    """A number of things, which a template writes with its noun."""

    def __format__(self, spec: str) -> str:
        singular, several, plural = spec.partition("|")
        if not several:
            return super().__format__(spec)
        if singular.startswith("~"):
            return singular[1:] if self == 1 else plural
        return counted(self, singular, plural)


@cache
def catalogue() -> dict[str, dict[str, str]]:
    """The entries by their keys, each with ``text``, and where they are not empty ``severity`` and ``remedy``."""
    entries: dict[str, dict[str, str]] = {}
    for name in ("findings.toml", "refusals.toml", "femm/findings.toml"):
        entries |= tomllib.loads((files("femfit.tables") / name).read_text(encoding="utf-8"))
    return entries


def finding(key: str, /, **facts: Any) -> Finding:
    """Remark on something by the key of a sentence and the facts that fill it.

    The facts ``size`` and ``column`` become those of the remark.

    Examples
    --------
    >>> print(finding("loose-lines", lines=2))
    2 lines that enclose nothing are left out.
    """
    entry = catalogue()[key]
    fields = {name: _Count(fact) if isinstance(fact, int) else fact for name, fact in facts.items()}
    text, remedy = (entry.get(sentence, "").format(**fields) for sentence in ("text", "remedy"))
    severity: Any = entry.get("severity", "info")
    return Finding(key.partition(" ")[0], severity, text, remedy, facts.get("size"), facts.get("column", ""))


def refused(key: str, /, **facts: Any) -> TableError:
    """The error by which a table is refused, by the key of its sentence in ``refusals.toml``."""
    return TableError(str(finding(key, **facts)))
