"""Numbers as text: decimal points and commas, thousands, exponents of Fortran."""

import math
import re
from collections.abc import Iterable

from femfit.core.errors import TableError

_NUMBER_LIKE = re.compile(r"[-+]?(?:\d[\d.,'\s]*|[.,]\d+)(?:[eEdD][-+]?\d{1,3})?$")
_PARSED = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?$")
_MISSING = frozenset(
    ("", "-", "--", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "inf", "-inf", "+inf", "1.#qnan", "-1.#ind")
)
_THOUSANDS = ("'", "’", "\u00a0", "\u202f", "\u2009")


def normalise(text: str) -> str:
    """Without thousands marks that are no point or comma, and with a plain minus."""
    cleaned = text.strip().strip('"').strip()
    for mark in _THOUSANDS:
        cleaned = cleaned.replace(mark, "")
    return cleaned.replace("\u2212", "-")


def looks_numeric(text: str) -> bool:
    """Whether a cell is a number in some notation, or a usual mark of a missing one.

    Returns
    -------
    bool
        True for ``1,5``, ``1.234,5``, ``2.0D-03``, ``NaN`` and an empty cell.
    """
    cleaned = normalise(text)
    return cleaned.casefold() in _MISSING or (" " not in cleaned and bool(_NUMBER_LIKE.match(cleaned)))


def parse_number(text: str, decimal: str) -> float:
    """A cell's number.

    Parameters
    ----------
    decimal : str
        ``.`` or ``,``; the other one marks thousands.

    Returns
    -------
    float
        NaN where the cell is no finite number: the checks report each such cell.
    """
    cleaned = normalise(text)
    other = "," if decimal == "." else "."
    if other in cleaned:
        whole = cleaned.split(decimal, maxsplit=1)[0].lstrip("+-")
        groups = whole.split(other)
        tail = cleaned.split(decimal, maxsplit=1)[1] if decimal in cleaned else ""
        if other in tail or not 1 <= len(groups[0]) <= 3 or any(len(group) != 3 for group in groups[1:]):
            return math.nan
        cleaned = cleaned.replace(other, "")
    cleaned = cleaned.replace(decimal, ".").replace("D", "e").replace("d", "e").replace("E", "e")
    if not _PARSED.match(cleaned):
        return math.nan
    value = float(cleaned)
    return value if math.isfinite(value) else math.nan


def find_decimal(cells: Iterable[str], source: str) -> str:
    """Whether a table writes decimal points or commas.

    A mark decides where it cannot mark thousands: ``0,015``, ``12,5``, ``1.234,5``, ``1,5e-3``. ``1,234`` alone decides
    nothing; a table of such cells only is refused rather than read wrongly by a factor of 1000.

    Raises
    ------
    TableError
        If the cells contradict each other or leave it open.
    """
    certain: dict[str, str] = {}
    open_marks: dict[str, str] = {}
    for cell in cells:
        text = normalise(cell)
        if "," not in text and "." not in text:
            continue
        mark, sure = _decimal_of(text)
        (certain if sure else open_marks).setdefault(mark, text)
    if len(certain) == 2:
        raise TableError(
            f"{source} writes numbers both as {certain['.']} and as {certain[',']}; say which mark is the decimal one "
            "with --decimal '.' or --decimal ','."
        )
    if certain:
        return next(iter(certain))
    if "," in open_marks:
        raise TableError(
            f"{source} holds {open_marks[',']}, which may mean a decimal comma or thousands; say which with "
            "--decimal ',' or --decimal '.'."
        )
    return "."


def _decimal_of(text: str) -> tuple[str, bool]:
    """Decimal mark that a cell suggests, and whether it is certain."""
    mantissa = re.split("[eEdD]", text)[0].lstrip("+-")
    if "," in mantissa and "." in mantissa:
        return (",", True) if mantissa.rfind(",") > mantissa.rfind(".") else (".", True)
    mark = "," if "," in mantissa else "."
    if mantissa.count(mark) > 1:
        return ("." if mark == "," else ","), True
    head, tail = mantissa.split(mark)
    thousands_possible = (
        len(tail) == 3 and 1 <= len(head) <= 3 and not head.startswith("0") and mantissa == text.lstrip("+-")
    )
    return mark, not thousands_possible
