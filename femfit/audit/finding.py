"""What an audit concluded, in plain words and with the recomputed number."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

Severity = Literal["holds", "note", "wrong"]


@dataclass(frozen=True)
class AuditFinding:
    """One conclusion of an audit.

    Parameters
    ----------
    severity : str
        ``holds``: recomputed and right; ``note``: look at it; ``wrong``: contradicts itself, physics or arithmetic.
    about : str
        What was checked, as its source calls it.
    sentence : str
        One plain sentence with both numbers.
    stated, recomputed : float or None
        The number as given and as it follows, in the unit that the sentence names.
    """

    code: str
    severity: Severity
    about: str
    sentence: str
    stated: float | None = None
    recomputed: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return asdict(self)


def audit_lines(findings: "tuple[AuditFinding, ...] | list[AuditFinding]") -> list[str]:
    """Findings as lines of text, what is wrong first.

    Returns
    -------
    list of str
        A line a finding and a last one that counts them.
    """
    ordered = [one for severity in ("wrong", "note", "holds") for one in findings if one.severity == severity]
    lines = [f"{one.severity}: {one.about}: {one.sentence}" for one in ordered]
    count = {severity: sum(one.severity == severity for one in findings) for severity in ("wrong", "note", "holds")}
    return [*lines, f"{count['wrong']} wrong, {count['note']} to look at, {count['holds']} recomputed and right"]
