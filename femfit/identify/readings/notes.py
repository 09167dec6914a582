"""Notes to a result: what makes all else worthless first."""

from collections.abc import Sequence

from femfit.core.finding import Finding


def first_notes(findings: Sequence[Finding]) -> list[str]:
    """Say what a reader must know before any number: units that are suspected, sensors that were stuck."""
    return [f"check first: {finding}" for finding in findings if finding.severity != "info"]


def last_notes(findings: Sequence[Finding]) -> list[str]:
    """Say the other findings."""
    return [f"note: {finding}" for finding in findings if finding.severity == "info"]
