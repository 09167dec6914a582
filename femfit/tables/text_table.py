"""Text tables of any program: title lines, header, line of units, delimiter and decimal mark are found out."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

from femfit.core.errors import TableError
from femfit.core.results import listing
from femfit.tables.findings import refused
from femfit.tables.header import Likeness, parse_header, score
from femfit.tables.raw_table import RawTable, check_width, find_decimal, looks_measured, looks_numeric
from femfit.tables.units import CHANNELS, is_unit

_DELIMITERS = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
_COMMENT = re.compile(r"\s*(#|%|//|!|--(?=\s))+\s?")
_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_NO_UNITS = frozenset(("", "-", "1"))
_SAMPLE = 500
"""Lines by which delimiter and width are found."""

_DECIDING_ROWS = 5000
"""Rows, from all over the table, by which the decimal mark is found."""

_SUMMARY_WORDS = """
mean means average avg mittel mittelwert durchschnitt sum summe total min max minimum maximum sd std stdev stddev
standardabweichung streuung
"""
"""First words of a line that is worked out from readings and is none itself."""


class Line(NamedTuple):
    """A line that is not empty, without its comment mark."""

    number: int
    text: str
    comment: bool
    cells: tuple[str, ...] = ()  # Once the delimiter is known


@dataclass(frozen=True)
class Layout:
    """How a text table is laid out."""

    lines: list[Line]
    delimiter: str
    width: int
    headers: tuple[str, ...]  # One a column; empty if there are none
    first: int  # Number of the first line of data
    used: frozenset[int]  # Numbers of the lines that the headers were made of
    notes: tuple[str, ...]

    @property
    def below(self) -> list[Line]:
        """The lines from the first one of data on."""
        return [line for line in self.lines if line.number >= self.first and not line.comment]


def decode(content: bytes, source: str) -> tuple[str, str]:
    """Text of a file and its encoding."""
    if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise TableError(f"{source} is a spreadsheet of a kind that is not read (.xls, .ods); save it as .xlsx or CSV.")
    marked = [name for mark, name in _MARKS.items() if content.startswith(mark)]
    # Windows-1252 leaves five codes undefined; Latin-1 takes every byte.
    for name in marked or ["utf-8", "cp1252", "latin-1"]:
        try:
            text = content.decode(name)
        except UnicodeError:
            continue
        if "\x00" in text:
            raise TableError(f"{source} is no text table (it holds NUL characters); export it as CSV or Parquet.")
        return text.removeprefix("\ufeff"), name
    raise TableError(f"{source} is not written in {marked[0]}, as its first bytes say. Save it again as UTF-8.")


def parse_text(
    content: bytes,
    source: str,
    *,
    delimiter: str | None = None,
    decimal: str | None = None,
    open_decimal: str | None = None,
) -> RawTable:
    """Read a text table; each argument overrides what is found out."""
    text, encoding = decode(content, source)
    layout = find_layout(text, source, delimiter)
    body, notes = _readings(layout)
    ragged = tuple(line.number for line in body if len(line.cells) != layout.width)
    blank = ("",) * layout.width  # in place of cells that may be shifted, and stand in wrong columns
    rows = [line.cells if len(line.cells) == layout.width else blank for line in body]
    if not decimal:
        texts = dict.fromkeys(chain(layout.headers, *rows[:: 1 + len(rows) // _DECIDING_ROWS]))
        fewest = 1 if any("," in text for text in texts) else 2  # points alone are decimal ones
        marked = (text for text in texts if "," in text or text.count(".") >= fewest)
        decimal = find_decimal(filter(looks_numeric, marked), source, open_decimal)
    cells = list(zip(*rows, strict=True)) if rows else [()] * layout.width
    dialect = f"{encoding}, {_DELIMITERS.get(layout.delimiter, repr(layout.delimiter))}, decimal {decimal}"
    numbers, remarks = [line.number for line in body], (*layout.notes, *notes)
    return RawTable(source, layout.headers, cells, numbers, dialect, decimal, ragged, remarks)


def _readings(layout: Layout) -> tuple[list[Line], list[str]]:
    """The lines of readings: without repeated headers, blank rows, means of others, and what stands below the last."""
    header = [line.cells for line in layout.lines if line.number in layout.used and not line.comment]
    repeated = [line.number for line in layout.below if line.cells in header]
    body = [line for line in layout.below if any(line.cells) and line.cells not in header]
    notes = [f"repeated header at line {listing(repeated)} passed over"] if repeated else []
    readings = [line for line in body if not _is_summary(line.cells)]
    while readings and len(readings[-1].cells) != layout.width and not _is_data(readings[-1].cells):
        readings.pop()  # a footnote
    if 0 < len(readings) < len(body):
        passed = sorted({*body}.difference(readings))
        numbers, texts = listing(line.number for line in passed), listing(line.text.strip() for line in passed)
        notes.append(f"line {numbers} between or below the readings passed over ({texts})")
    return readings or body, notes


def _is_summary(cells: Sequence[str]) -> bool:
    """Whether a line is a mean or sum of others rather than a reading."""
    word = re.search(r"[^\W\d_]+", next(filter(None, cells), ""))
    return word is not None and word[0].casefold() in _SUMMARY_WORDS.split()


def split(text: str, delimiter: str) -> tuple[str, ...]:
    """Split a line into cells; a delimiter inside double quotes does not count, a blank stands for any run of them."""
    if '"' not in text:
        return tuple(text.split() if delimiter == " " else map(str.strip, text.split(delimiter)))
    if delimiter == " ":
        return tuple(cell for cell in re.split(r'\s+|"([^"]*)"', text) if cell)
    return tuple(map(str.strip, next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))))


def find_layout(text: str, source: str, delimiter: str | None = None) -> Layout:
    """Find delimiter, width, headers and first row of data."""
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            mark = _COMMENT.match(line)
            lines.append(Line(number, line[mark.end() :] if mark else line, mark is not None))
    sample = [line.text for line in lines if not line.comment][:_SAMPLE]
    if not sample:
        raise TableError(f"{source} is empty; it needs a header line and rows of numbers.")
    delimiter = delimiter or max(_DELIMITERS, key=lambda mark: _regular(sample, mark))
    lines = [line._replace(cells=split(line.text, delimiter)) for line in lines]
    rows = [line.cells for line in lines if not line.comment][:_SAMPLE]
    check_width(max(map(len, rows)), source)
    widths = Counter(len(cells) for cells in rows if _is_data(cells))
    if not widths:
        raise refused("no-numbers", source=source)
    return _headed(lines, widths.most_common(1)[0][0], delimiter)


def _regular(sample: list[str], delimiter: str) -> tuple[int, int]:
    """How many lines have the same number of cells, all of them numbers, and how many of half of them."""
    rows = [split(text, delimiter) for text in sample]
    widths = Counter(len(cells) for cells in rows if len(cells) > 1 and all(map(looks_measured, cells)))
    partly = Counter(len(cells) for cells in rows if _is_data(cells))
    return max(widths.values(), default=0), max(partly.values(), default=0)


def _is_data(cells: Sequence[str]) -> bool:
    """Whether at least half of the cells that are not empty are numbers."""
    filled = [cell for cell in cells if cell]
    return len(cells) > 1 and 0 < len(filled) <= 2 * sum(map(looks_measured, filled))


def _headed(lines: list[Line], width: int, delimiter: str) -> Layout:
    """Headers above the first row of data, and notes on the lines that were passed over.

    Of several lines of words that one is taken in which most cells name a quantity, of equal ones the last.
    """
    start = _first_row(lines, width)
    above = [line for line in lines if line.number < start][-_SAMPLE:]
    headed = [(line.number, cells) for line in above if (cells := _header_cells(line, delimiter, width))]
    units_of = {number: units for number, cells in headed if (units := _units_of(cells))}
    named = [
        (sum(map(_is_known, cells)), number, cells)
        for number, cells in headed
        if number not in units_of and not all(map(looks_numeric, cells))
    ]
    # A matrix whose upper left corner is blank has a first line with one number less
    rows = (line for line in above if not line.comment and all(map(looks_numeric, line.cells)))
    axes = [(0, line.number, ("", *line.cells)) for line in rows if len(line.cells) == width - 1]
    _, place, headers = max(named or axes, default=(0, 0, ()))
    below = {number: units for number, units in units_of.items() if number > place and named}
    for units in below.values():
        headers = tuple(
            name if parse_header(name).unit or unit in _NO_UNITS else f"{name} [{unit}]"
            for name, unit in zip(headers, units, strict=True)
        )
    used = frozenset((place, *below))
    passed = [line.number for line in above if line.number not in used]
    note = "lines {} above the readings are text, such as titles, and were ignored"
    if len(passed) == 1:
        note = "line {} above the readings is text, such as a title, and was ignored"
    return Layout(lines, delimiter, width, headers, start, used, (note.format(listing(passed)),) if passed else ())


def _first_row(lines: list[Line], width: int) -> int:
    """Number of the first line of data; lines with numbers above a line of known names are title lines."""
    first, rows = 0, 0
    for line in lines[: 2 * _SAMPLE]:
        if line.comment or len(line.cells) != width:
            continue
        if _is_data(line.cells):
            first = first or line.number
            rows += all(map(looks_numeric, line.cells))
        elif rows < 2 and sum(map(_is_known, line.cells)) >= 2:
            first = 0
    return first or lines[-1].number + 1


def _units_of(cells: Sequence[str]) -> list[str]:
    """Units of a line in which most cells are units and few names; none of another: ``mm;A;furlong``, not ``t;s;F``."""
    texts = [re.sub(r"^in\s+", "", cell.strip("[](){} ")) for cell in cells]
    filled = [text for text in texts if text not in _NO_UNITS]
    units = sum(map(is_unit, filled))
    some = 2 * units > len(filled) >= 2 * sum(map(_is_known, filled))
    return texts if some or units == len(filled) > 0 else []


def _header_cells(line: Line, delimiter: str, width: int) -> tuple[str, ...]:
    """Cells of a line that may be the header of so many columns; between blanks, names with a blank in them."""
    if len(line.cells) == width:
        return line.cells
    for wide in (r"\t+", r"\s{2,}", r"\s*[,;]\s*", r"\s+(?![\[(/])") if delimiter in {" ", "\t"} else ():
        parts = [cell.strip().strip('"') for cell in re.split(wide, line.text.strip())]
        if len(parts) == width:
            return tuple(parts)
    return ()


def _is_known(cell: str) -> bool:
    return bool(cell) and any(score(parse_header(cell), column) >= Likeness.MAYBE for column in CHANNELS)
