"""Numbers as text: decimal points and commas, thousands, exponents of Fortran."""

import contextlib
import math
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.text import quoted

_NUMBER_LIKE = re.compile(r"[-+]?(?:\d[\d.,'\s]*|[.,]\d+)(?:[eEdD][-+]?\d{1,3})?$")
_NUMBER = {
    mark: re.compile(
        rf"[-+]?(?:[1-9]\d{{0,2}}(?:[{group}]\d{{3}})+(?:[{mark}]\d*(?:[eEdD][-+]?\d{{1,3}})?)?|"
        rf"(?=[{mark}]?\d)\d*(?:[{mark}]\d*)?(?:[eEdD][-+]?\d{{1,3}})?)"
    )
    for mark, group in ((".", ","), (",", "."))
}
"""Decimal mark to what is a number with it, where the other mark groups thousands: a cell that is one under one mark
alone decides between them."""

_CLOCK = re.compile(r"(?:(?P<day>\S+)[ T])?(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d(?:[.,]\d+)?)(?:Z|[+-]\d\d:?\d\d)?$")
_INFINITE = frozenset(("inf", "-inf", "+inf"))
EMPTY = frozenset(("", "-", "--", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "<na>", "1.#qnan", "-1.#ind"))
"""What programs write into a cell without a number."""

_THOUSANDS = ("'", "’", "\u00a0", "\u202f", "\u2009")
LARGEST = 1e37
"""No measured quantity is as large; instruments write 9.9E+37 for an overload, and 9.91E+37 for no number (SCPI-99)."""

_LONGEST = 400
"""Digits of a cell; a longer one is not a number that anybody measured."""


def normalise(text: str) -> str:
    """Remove thousands marks that are no point or comma, and write a plain minus."""
    cleaned = text.strip().strip('"').strip()
    for mark in _THOUSANDS:
        if mark in cleaned:
            cleaned = cleaned.replace(mark, "")
    return cleaned.replace("\u2212", "-")


def looks_numeric(text: str) -> bool:
    """Tell whether a cell is a number in some notation (``1.234,5``, ``2.0D-03``), or a usual mark of a missing one."""
    if len(text) > _LONGEST:
        return False
    cleaned = normalise(text)
    folded = cleaned.casefold()
    return folded in EMPTY or folded in _INFINITE or (" " not in cleaned and bool(_NUMBER_LIKE.match(cleaned)))


def looks_measured(text: str) -> bool:
    """Tell whether a cell is a number, or a moment of a clock."""
    return looks_numeric(text) or bool(_CLOCK.match(text.strip()))


def numbers_of(cells: Sequence[str], decimal: str) -> FloatArray:
    """Convert a column of cells; NaN where a cell is no finite number."""
    grouping = "," if decimal == "." else "."
    if not any(grouping in cell or "_" in cell for cell in cells):
        try:
            values = np.array([cell.replace(",", ".") if decimal == "," else cell for cell in cells], dtype=np.float64)
        except ValueError:
            pass
        else:
            return np.where(np.abs(values) < LARGEST, values, np.nan)
    return np.array([parse_number(cell, decimal) for cell in cells], dtype=np.float64)


def parse_number(text: str, decimal: str) -> float:
    """Convert a cell; the mark that is not ``decimal`` groups thousands. NaN where it is no finite number."""
    cleaned = normalise(text)
    if len(text) > _LONGEST or not _NUMBER[decimal].fullmatch(cleaned):
        return math.nan
    grouping = "," if decimal == "." else "."
    value = float(cleaned.replace(grouping, "").replace(decimal, ".").replace("D", "e").replace("d", "e"))
    return value if abs(value) < LARGEST else math.nan


def clock_seconds(cells: Sequence[str], column: str) -> FloatArray | None:
    """Seconds from the first of moments such as ``12:34:56,789``; NaN in an empty cell, None where others are none.

    A time of day that goes back by more than half a day is the next day's.
    """
    matches = [_CLOCK.match(cell.strip()) for cell in cells]
    filled = [cell.strip().casefold() not in EMPTY for cell in cells]
    if not any(matches) or any(cell and not match for cell, match in zip(filled, matches, strict=True)):
        return None
    days = {text: _day(text, column) for text in dict.fromkeys(match["day"] for match in matches if match)}
    if len(days) == 1:
        days = dict.fromkeys(days, 0)
    seconds = np.full(len(cells), np.nan)
    timed = np.array([match is not None for match in matches])
    seconds[timed] = [
        86400.0 * days[match["day"]]
        + 3600.0 * int(match["h"])
        + 60.0 * int(match["m"])
        + float(match["s"].replace(",", "."))
        for match in matches
        if match
    ]
    if len(days) == 1:
        seconds[timed] += 86400.0 * np.cumsum(np.diff(seconds[timed], prepend=seconds[timed][0]) < -43200.0)
    return np.asarray(seconds - seconds[timed][0])


def _day(text: str | None, column: str) -> int:
    """A date as a count of days; 0 for a time of day alone."""
    if text is None:
        return 0
    for pattern in ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y"):
        with contextlib.suppress(ValueError):
            return datetime.strptime(text, pattern).replace(tzinfo=UTC).toordinal()
    raise TableError(
        f"Dates of {quoted(column)!r} must be written 2026-03-12 or 12.03.2026; instead received {quoted(text)}. Write "
        "them so, or give seconds."
    )


def find_decimal(cells: Iterable[str], source: str, otherwise: str | None = None) -> str:
    """Find out whether a table writes decimal points or commas.

    A mark decides where it cannot mark thousands: ``0,015``, ``12,5``, ``1.234,5``, ``1,5e-3``. ``1,234`` alone decides
    nothing; a table of such cells only is refused rather than read wrongly by a factor of 1000, unless ``otherwise``
    says what it means.
    """
    certain: dict[str, str] = {}
    unsure = None
    for text in map(normalise, cells):
        marks = [mark for mark, number in _NUMBER.items() if number.fullmatch(text)]
        if "," in text and "." in text:  # such as 1234,0.5, whose thousands are damaged
            marks = [max(",.", key=text.rfind)]
        if len(marks) == 1 and ("," in text or "." in text):
            certain.setdefault(marks[0], text)
        elif marks and "," in text:
            unsure = unsure or text
    if len(certain) == 2:
        raise TableError(
            f"{source} writes numbers both as {quoted(certain['.'])} and as {quoted(certain[','])}; say which mark is "
            "the decimal one with --decimal '.' or --decimal ','."
        )
    if certain:
        return next(iter(certain))
    if unsure and otherwise is None:
        raise TableError(
            f"{source} holds {quoted(unsure)}, which may mean a decimal comma or thousands; say which with "
            "--decimal ',' or --decimal '.'."
        )
    return (otherwise or ".") if unsure else "."
