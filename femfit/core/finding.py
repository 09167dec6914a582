"""A remark about data: a code that programs match, and a sentence that people read."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from femfit.core.quoted import quoted

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
