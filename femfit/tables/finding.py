"""What a check of an imported table concluded, in plain words."""

from dataclasses import dataclass, replace
from typing import Any, Literal

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One conclusion about a table.

    Parameters
    ----------
    code : str
        Short stable name, as ``--accept`` takes it.
    severity : str
        ``info``: said, nothing to do; ``warning``: look at it; ``error``: the table is refused unless accepted.
    remedy : str
        What to do about it; empty where there is nothing to do.
    size : float or None
        How large, in the unit that the sentence names (relative sizes as fractions).
    """

    code: str
    severity: Severity
    sentence: str
    remedy: str = ""
    size: float | None = None

    def accepted(self) -> "Finding":
        """The same finding as a warning, for a user who knows of it."""
        return replace(self, severity="warning", sentence=f"{self.sentence} (accepted)")

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "code": self.code,
            "severity": self.severity,
            "sentence": self.sentence,
            "remedy": self.remedy,
            "size": self.size,
        }


def listing(items: list[str], limit: int = 8) -> str:
    """The first items, and how many more there are."""
    shown = ", ".join(items[:limit])
    return shown if len(items) <= limit else f"{shown} and {len(items) - limit} more"
