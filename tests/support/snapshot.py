"""What is printed, kept in tests/snapshots: the same words line by line, and the same numbers within two hundredths."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "snapshots"
TOLERANCE = 0.02
MASKS = (
    (re.compile(r" *\b\d+\.\d s\b"), " # s"),  # what a stage took
    (re.compile(r"\b\d\.\d MB\b"), "# MB"),
    (re.compile(r"\b\d+\.\d+\.\d+\b"), "#"),  # versions
)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
SMALL = re.compile(r"-?\b\d(?:\.\d+)?e-(\d+)\b")


def masked(text: str, least: int) -> str:
    """The text without what differs from run to run, and without blanks at the ends of lines."""
    text = SMALL.sub(lambda number: "#" if int(number[1]) >= least else number[0], text)
    for pattern, mask in MASKS:
        text = pattern.sub(mask, text)
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def check_snapshot(name: str, text: str, *, renew: bool, least: int = 7) -> None:
    """Compare a text with the one that is kept; with ``--renew`` it is kept, and the test fails once.

    Numbers below 10^(1 - least) count as zero but for rounding.
    """
    path, got = FOLDER / f"{name}.txt", masked(text, least)
    kept = path.read_text(encoding="utf-8") if path.exists() else ""
    lines, others = got.splitlines(), kept.splitlines()
    different = [f"- {a}\n+ {b}" for a, b in zip(others, lines, strict=False) if not alike(a, b, TOLERANCE)]
    if not different and len(lines) == len(others):
        return
    if renew:
        path.write_text(got, encoding="utf-8")
        pytest.fail(f"renewed {path.name}: read it, and run again without --renew", pytrace=False)
    counts = f"{len(others)} lines are kept, {len(lines)} came"
    pytest.fail("\n".join([f"{path.name} (pytest --renew keeps what is new); {counts}", *different]), pytrace=False)


def alike(line: str, other: str, tolerance: float) -> bool:
    """Whether two lines have the same words, and numbers within a relative tolerance."""
    if NUMBER.sub("\0", line) != NUMBER.sub("\0", other):  # a mask may be in both
        return False
    pairs = zip(map(float, NUMBER.findall(line)), map(float, NUMBER.findall(other)), strict=True)
    return all(abs(a - b) <= tolerance * max(abs(a), abs(b)) for a, b in pairs)
