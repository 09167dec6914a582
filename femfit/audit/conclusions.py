"""What an audit concludes, as it is printed and as JSON; the words stand in ``templates/audit.j2``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

from femfit.core.results import Result, Words
from femfit.core.text import rounded
from femfit.device.electrics import REMEDY
from femfit.fit.words import note

words = Words(
    "femfit.audit",
    rounded,
    names={"REMEDY": REMEDY, **{name: partial(note, name) for name in ("missed_shares", "to_be_added")}},
).sentence

Severity = Literal["holds", "stated", "note", "wrong"]
_SEVERITIES: tuple[Severity, ...] = ("wrong", "note", "holds", "stated")


@dataclass(frozen=True)
class AuditFinding:
    """One conclusion of an audit."""

    data = "code", "severity", "about", "stated", "recomputed", "numbers", "sentence"

    code: str
    # ``holds``: recomputed and right; ``stated``: the file says it and nothing was at hand to recompute it from;
    # ``note``: look at it; ``wrong``: contradicts itself, physics or arithmetic
    severity: Severity
    about: str
    # The number as given and as it follows, in the unit that the sentence names
    stated: float | None = None
    recomputed: float | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)  # What else the sentence needs

    @property
    def sentence(self) -> str:
        """What is concluded."""
        return words("audit", self.code, self, self.numbers)


@dataclass(frozen=True, eq=False, repr=False)
class Audit(Result):
    """All conclusions of an audit."""

    finite = True

    findings: tuple[AuditFinding, ...]

    def count(self, severity: Severity) -> int:
        """How many findings have a severity."""
        return sum(finding.severity == severity for finding in self.findings)

    def __str__(self) -> str:
        """The lines that ``femfit audit`` prints: the count, then what is wrong first."""
        ordered = [finding for severity in _SEVERITIES for finding in self.findings if finding.severity == severity]
        return words("audit", "audit", self.count, ordered)
