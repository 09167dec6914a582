"""Text tables of any program: title lines, header, line of units, delimiter and decimal mark are found out."""

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import LARGEST
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
    """A line above or at the first readings that is not empty, without its comment mark."""

    number: int
    text: str
    comment: bool
    cells: tuple[str, ...] = ()  # Once the delimiter is known


@dataclass(frozen=True)
class Layout:
    """How a text table is laid out."""

    delimiter: str
    width: int
    headers: tuple[str, ...]  # One a column; empty if there are none
    first: int  # Number of the first line of data
    repeated: tuple[tuple[str, ...], ...]  # Cells of the lines that the headers were made of
    notes: tuple[str, ...]

    def rows(self, lines: Sequence[str]) -> Iterator[tuple[int, tuple[str, ...]]]:
        """Number and cells of each line of data that is neither empty nor a comment."""
        for number, line in enumerate(lines[self.first - 1 :], start=self.first):
            if line.strip() and not _COMMENT.match(line):
                yield number, split(line, self.delimiter)


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
    lines = text.splitlines()
    layout = find_layout(lines, source, delimiter)
    dialect = f"{encoding}, {_DELIMITERS.get(layout.delimiter, repr(layout.delimiter))}, decimal "
    numbers = [number for number, line in enumerate(lines[layout.first - 1 :], layout.first) if line.strip()]
    plain = None if decimal == "," or any("," in header for header in layout.headers) else _plain_numbers(lines, layout)
    if plain is not None and len(plain) == len(numbers):
        columns = [plain[k] for k in plain]
        return RawTable(source, layout.headers, columns, numbers, f"{dialect}.", notes=layout.notes)
    body, notes = _readings(lines, layout)
    ragged = tuple(number for number, cells in body if len(cells) != layout.width)
    blank = ("",) * layout.width  # in place of cells that may be shifted, and stand in wrong columns
    rows = [cells if len(cells) == layout.width else blank for _, cells in body]
    if not decimal:
        texts = dict.fromkeys(chain(layout.headers, *rows[:: 1 + len(rows) // _DECIDING_ROWS]))
        fewest = 1 if any("," in text for text in texts) else 2  # points alone are decimal ones
        marked = (text for text in texts if "," in text or text.count(".") >= fewest)
        decimal = find_decimal(filter(looks_numeric, marked), source, open_decimal)
    cells = list(zip(*rows, strict=True)) if rows else [()] * layout.width
    numbers, remarks = [number for number, _ in body], (*layout.notes, *notes)
    return RawTable(source, layout.headers, cells, numbers, f"{dialect}{decimal}", decimal, ragged, remarks)


def _plain_numbers(lines: Sequence[str], layout: Layout) -> pd.DataFrame | None:
    """The readings where each cell is a finite number with a decimal point, as in most files; None in all others."""
    body, blanks = "\n".join(lines[layout.first - 1 :]), r"\s+" if layout.delimiter == " " else layout.delimiter
    try:
        frame = pd.read_csv(io.StringIO(body), sep=blanks, header=None, skipinitialspace=True, low_memory=False)
    except ValueError:  # no rows, or one that is longer than the first
        return None
    numeric = frame.shape[1] == layout.width and all(kind.kind in "if" for kind in frame.dtypes)
    return frame if numeric and (frame.abs() < LARGEST).all(axis=None) else None


def _readings(lines: Sequence[str], layout: Layout) -> tuple[list[tuple[int, tuple[str, ...]]], list[str]]:
    """The lines of readings: without repeated headers, blank rows, means of others, and what stands below the last."""
    filled = [(number, cells) for number, cells in layout.rows(lines) if any(cells)]
    repeated = [number for number, cells in filled if cells in layout.repeated]
    body = [(number, cells) for number, cells in filled if cells not in layout.repeated] if repeated else filled
    notes = [f"repeated header at line {listing(repeated)} passed over"] if repeated else []
    readings = [(number, cells) for number, cells in body if not _is_summary(cells)]
    while readings and len(readings[-1][1]) != layout.width and not _is_data(readings[-1][1]):
        readings.pop()  # a footnote
    if 0 < len(readings) < len(body):
        passed = sorted({number for number, _ in body}.difference(number for number, _ in readings))
        texts = listing(lines[number - 1].strip() for number in passed)
        notes.append(f"line {listing(passed)} between or below the readings passed over ({texts})")
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


def find_layout(lines: Sequence[str], source: str, delimiter: str | None = None) -> Layout:
    """Find delimiter, width, headers and first row of data, by the first lines that are no comments."""
    filled = ((number, line, _COMMENT.match(line)) for number, line in enumerate(lines, start=1) if line.strip())
    head: list[Line] = []
    texts: list[str] = []
    for number, line, mark in filled:
        head.append(Line(number, line[mark.end() :] if mark else line, mark is not None))
        texts += [] if mark else [line]
        if len(texts) == 2 * _SAMPLE:
            break
    if not texts:
        raise TableError(f"{source} is empty; it needs a header line and rows of numbers.")
    delimiter = delimiter or max(_DELIMITERS, key=lambda mark: _regular(texts[:_SAMPLE], mark))
    head = [line._replace(cells=split(line.text, delimiter)) for line in head]
    rows = [split(text, delimiter) for text in texts[:_SAMPLE]]
    check_width(max(map(len, rows)), source)
    widths = Counter(len(cells) for cells in rows if _is_data(cells))
    if not widths:
        raise refused("no-numbers", source=source)
    return _headed(head, widths.most_common(1)[0][0], delimiter)


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
    used = (place, *below)
    repeated = tuple(line.cells for line in above if line.number in used and not line.comment)
    passed = [line.number for line in above if line.number not in used]
    note = "lines {} above the readings are text, such as titles, and were ignored"
    if len(passed) == 1:
        note = "line {} above the readings is text, such as a title, and was ignored"
    return Layout(delimiter, width, headers, start, repeated, (note.format(listing(passed)),) if passed else ())


def _first_row(lines: list[Line], width: int) -> int:
    """Number of the first line of data; lines with numbers above a line of known names are title lines."""
    first, rows = 0, 0
    for line in lines:
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
