"""Notes to a result: what makes all else worthless first."""

from collections.abc import Sequence

from femfit.identify.readings.plausible import SUSPECTED


def first_notes(findings: Sequence[str]) -> list[str]:
    """What a reader must know before any number: units and signs that are suspected."""
    return [f"check first: {finding}" for finding in findings if SUSPECTED in finding]


def last_notes(findings: Sequence[str]) -> list[str]:
    """The other findings."""
    return [f"note: {finding}" for finding in findings if SUSPECTED not in finding]
