"""A table as it stands in its file, text or typed columns: headers, cells, and where each row came from.

Numbers as text: decimal points and commas, thousands, exponents of Fortran, moments of a clock.
"""

import contextlib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import LARGEST, FloatArray
from femfit.core.text import quoted
from femfit.tables.findings import refused

MOST_COLUMNS = 2000
"""A table that is wider was read with the wrong delimiter, or is no table of measurements."""

AGAIN = "Write it again, or export it as CSV."
"""What is to be done with a foreign file that is damaged."""

EMPTY = frozenset(("", "-", "--", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "<na>", "1.#qnan", "-1.#ind"))
"""What programs write into a cell without a number."""


@dataclass(frozen=True, eq=False)
class RawTable:
    """Cells of one file, or of one sheet, group, struct or array in it, not yet interpreted."""

    source: str
    headers: tuple[str, ...]  # One a column; empty if the file has none
    cells: Sequence[Any]  # Each column's: texts where there is a decimal mark, else a series of the file's own type
    lines: Sequence[int]  # Line (text) or row (Parquet) of each row in the file, from 1; shape (n,)
    dialect: str  # Encoding, delimiter and decimal mark in one phrase
    decimal: str = ""
    # Lines with more or fewer cells than the table has columns: their cells may stand in wrong columns
    ragged: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()  # What was passed over: comment lines, repeated headers
    name: str = ""  # Among the tables of a file that may have several

    def column(self, place: int) -> FloatArray:
        """The numbers of a column, NaN where a cell is no finite number; shape (n,)."""
        return numbers_of(self.cells[place], self.decimal) if self.decimal else typed_numbers(self.cells[place])

    @cached_property
    def numbers(self) -> FloatArray:
        """The numbers of all columns, shape (n, m)."""
        return np.array([self.column(k) for k in range(len(self.cells))]).reshape(len(self.cells), len(self.lines)).T

    def texts(self, place: int) -> Sequence[str]:
        """The text of each cell of a column."""
        column = self.cells[place]
        if self.decimal:
            return list(column)
        return ["" if missing else str(cell) for cell, missing in zip(column, column.isna(), strict=True)]

    def frame(self) -> pd.DataFrame:
        """The columns by their headers: whole numbers, numbers, or text where a filled cell is no number."""
        columns: dict[str, Any] = dict(zip(self.headers, self.cells, strict=False))
        for header, cells in columns.items() if self.decimal else ():
            numbers = numbers_of(cells, self.decimal)
            worded = any(cell and missing for cell, missing in zip(cells, np.isnan(numbers), strict=True))
            counts = all(len(cell) < 16 and cell.lstrip("-").isdecimal() for cell in cells)  # as exact in a double
            columns[header] = list(cells) if worded else numbers.astype(np.int64 if counts else np.float64)
        return pd.DataFrame(columns)


def typed_table(frame: pd.DataFrame, source: str, dialect: str, name: str = "") -> RawTable:
    """A table whose columns have types."""
    check_width(frame.shape[1], source)
    columns = [frame.iloc[:, k] for k in range(frame.shape[1])]
    return RawTable(source, tuple(map(str, frame)), columns, range(1, len(frame) + 1), dialect, name=name)


def check_width(columns: int, source: str) -> None:
    """Refuse a table with an absurd number of columns."""
    if columns > MOST_COLUMNS:
        raise refused("too-wide", source=source, columns=columns, most=MOST_COLUMNS)


def typed_numbers(column: "pd.Series[Any]") -> FloatArray:
    """Convert a typed column; moments of a clock become seconds from the first one. NaN where there is no number."""
    if column.dtype.kind in "mM":
        elapsed = pd.to_timedelta(column - (column.dropna().iloc[0] if column.notna().any() else pd.NaT))
        return np.asarray(elapsed.dt.total_seconds().to_numpy(dtype=np.float64, na_value=np.nan))
    values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
    return np.where(np.abs(values) < LARGEST, values, np.nan)


def file_content(path: str | Path, what: str) -> bytes:
    """Read a file whole."""
    path = Path(path)
    if not path.is_file():
        raise TableError(f"There is no {what} {path}. Give a .csv, .parquet, .xlsx, .mat, .h5, .tdms or .wav file.")
    try:
        return path.read_bytes()
    except OSError as error:
        raise TableError(f"{path} cannot be read: {error.strerror or error}.") from error


_NUMBER_LIKE = re.compile(r"[-+]?(?:\d[\d.,\t]*|[.,]\d+)(?:[eEdD][-+]?\d{1,3})?")
_NUMBER = {
    mark: re.compile(
        rf"[-+]?(?:[1-9]\d{{0,2}}(?:[{group}]\d{{3}})+(?:[{mark}]\d*(?:[eEdD][-+]?\d{{1,3}})?)?|"
        rf"(?=[{mark}]?\d)\d*(?:[{mark}]\d*)?(?:[eEdD][-+]?\d{{1,3}})?)"
    )
    for mark, group in ((".", ","), (",", "."))
}
"""Decimal mark to what is a number with it, where the other mark groups thousands: a cell that is one under one mark
alone decides between them."""

_CLOCK = re.compile(r"(?:(?P<day>\S+)[ T])?(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d(?:[.,]\d+)?)(?:Z|[+-]\d\d:?\d\d)?")
_WITHOUT_NUMBER = EMPTY | {"inf", "-inf", "+inf"}
_PLAIN = str.maketrans({"\u2212": "-", **dict.fromkeys("'’\u00a0\u202f\u2009", "")})
"""A plain minus, and no thousands marks that are neither point nor comma."""

_LONGEST = 400
"""Digits of a cell; a longer one is not a number that anybody measured."""


def normalise(text: str) -> str:
    """A cell without quotation marks, and with its minus and thousands as programs read them."""
    return text.strip().strip('"').strip().translate(_PLAIN)


def looks_numeric(text: str) -> bool:
    """Tell whether a cell is a number in some notation (``1.234,5``, ``2.0D-03``), or a usual mark of a missing one."""
    cleaned = normalise(text)
    return len(text) <= _LONGEST and (cleaned.casefold() in _WITHOUT_NUMBER or bool(_NUMBER_LIKE.fullmatch(cleaned)))


def looks_measured(text: str) -> bool:
    """Tell whether a cell is a number, or a moment of a clock."""
    return looks_numeric(text) or bool(_CLOCK.fullmatch(text.strip()))


def numbers_of(cells: Sequence[str], decimal: str) -> FloatArray:
    """Convert a column of cells; NaN where a cell is no finite number."""
    grouping = "," if decimal == "." else "."
    lines = "\n".join(cells)
    if grouping not in lines and "_" not in lines:
        with contextlib.suppress(ValueError):
            values = np.array(lines.replace(decimal, ".").split("\n"), dtype=np.float64)
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
    texts = [cell.strip() for cell in cells]
    if not all(text.casefold() in EMPTY or _CLOCK.fullmatch(text) for text in texts):
        return None
    matches = [_CLOCK.fullmatch(text) for text in texts]
    if not any(matches):
        return None
    days = {text: _day(text, column) for text in dict.fromkeys(match["day"] for match in matches if match)}
    first = min(days.values())
    seconds = np.array(
        [
            86400.0 * (days[m["day"]] - first)
            + (3600.0 * int(m["h"]) + 60.0 * int(m["m"]) + float(m["s"].replace(",", ".")))
            if m
            else np.nan
            for m in matches
        ]
    )
    timed = np.isfinite(seconds)
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
    raise refused("dates", header=quoted(column), text=quoted(text))


def find_decimal(cells: Iterable[str], source: str, otherwise: str | None = None) -> str:
    """Find out whether a table writes decimal points or commas.

    A mark decides where it cannot mark thousands: ``0,015``, ``12,5``, ``1.234,5``, ``1,5e-3``. ``1,234`` alone decides
    nothing; a table of such cells only is refused rather than read wrongly by a factor of 1000, unless ``otherwise``
    says what it means.
    """
    certain: dict[str, str] = {}
    unsure = ""
    for text in map(normalise, cells):
        marks = [mark for mark, number in _NUMBER.items() if number.fullmatch(text)]
        if "," in text and "." in text:  # such as 1234,0.5, whose thousands are damaged
            marks = [max(",.", key=text.rfind)]
        if len(marks) == 1:
            certain.setdefault(marks[0], text)
        elif marks and "," in text:
            unsure = unsure or text
    if len(certain) == 2:
        raise refused("two-decimal-marks", source=source, point=quoted(certain["."]), comma=quoted(certain[","]))
    if unsure and not certain and otherwise is None:
        raise refused("open-decimal", source=source, cell=quoted(unsure))
    return next(iter(certain), (otherwise or ".") if unsure else ".")
