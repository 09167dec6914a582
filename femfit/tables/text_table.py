"""Text tables of any program: title lines, header, line of units, delimiter and decimal mark are found out."""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from femfit.core.errors import TableError
from femfit.core.results import listing
from femfit.tables.header import MAYBE, parse_header, score
from femfit.tables.number_text import find_decimal, looks_measured, looks_numeric, numbers_of
from femfit.tables.raw_table import RawTable, check_width, decode
from femfit.tables.units import CHANNELS, is_unit

_DELIMITERS = (";", "\t", "|", ",", " ")
_DELIMITER_NAMES = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
_COMMENT = re.compile(r"\s*(#|%|//|!|--(?=\s))+\s?")
_SAMPLE = 500
"""Lines by which delimiter and width are found."""

_DECIDING_ROWS = 5000
"""Rows, from all over the table, by which the decimal mark is found."""

_SUMMARY_WORDS = """
mean means average avg mittel mittelwert durchschnitt sum summe total min max minimum maximum sd std stdev stddev
standardabweichung streuung
"""
_SUMMARIES = frozenset(_SUMMARY_WORDS.split())
"""First words of a last line that is worked out from the readings above and is none itself."""


class Line(NamedTuple):
    """A line that is not empty, without its comment mark."""

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
    first: int
    used: frozenset[int] = frozenset()  # Numbers of the lines that the headers were made of
    notes: tuple[str, ...] = field(default=())


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
    lines = text_lines(text)
    if all(line.comment for line in lines):
        raise TableError(f"{source} is empty; it needs a header line and rows of numbers.")
    lines, layout = find_layout(lines, source, delimiter)
    body, notes = _readings(lines, layout)
    ragged = tuple(line.number for line in body if len(line.cells) != layout.width)
    blank = ("",) * layout.width  # in place of cells that may be shifted, and stand in wrong columns
    rows = [line.cells if len(line.cells) == layout.width else blank for line in body]
    if not decimal:
        cells = dict.fromkeys(itertools.chain(layout.headers, *rows[:: 1 + len(rows) // _DECIDING_ROWS]))
        if any("," in cell for cell in cells):
            marked = [cell for cell in cells if "," in cell or "." in cell]
        else:
            marked = [cell for cell in cells if cell.count(".") > 1]
        decimal = find_decimal(filter(looks_numeric, marked), source, open_decimal)
    texts = list(zip(*rows, strict=True)) if rows else [()] * layout.width
    return RawTable(
        source=source,
        headers=layout.headers,
        numbers=np.column_stack([numbers_of(column, decimal) for column in texts]),
        texts=texts.__getitem__,
        lines=[line.number for line in body],
        dialect=f"{encoding}, {_DELIMITER_NAMES.get(layout.delimiter, repr(layout.delimiter))}, decimal {decimal}",
        decimal=decimal,
        ragged=ragged,
        notes=(*layout.notes, *notes),
    )


def _readings(lines: list[Line], layout: Layout) -> tuple[list[Line], list[str]]:
    """The lines of readings: without repeated headers, blank rows, and what stands below the last."""
    header = [line.cells for line in lines if line.number in layout.used and not line.comment]
    below = [line for line in lines if line.number >= layout.first and not line.comment]
    repeated = [line.number for line in below if line.cells in header]
    body = [line for line in below if any(line.cells) and line.cells not in header]
    notes = [f"repeated header at line {listing(repeated)} passed over"] if repeated else []
    end = len(body)
    while end and _is_no_reading(body[end - 1].cells, layout.width):
        end -= 1
    if 0 < end < len(body):
        text, numbers = (
            listing(values) for values in zip(*((x.text.strip(), x.number) for x in body[end:]), strict=True)
        )
        notes.append(f"line {numbers} below the readings passed over ({text})")
        body = body[:end]
    return body, notes


def _is_no_reading(cells: Sequence[str], width: int) -> bool:
    """Whether a line at the end of a table is a footnote, or a mean or sum of the lines above."""
    words = re.findall(r"[^\W\d_]+", next(filter(None, cells), ""))
    return (bool(words) and words[0].casefold() in _SUMMARIES) or (len(cells) != width and not _is_data(cells))


def text_lines(text: str) -> list[Line]:
    """Split a text into its lines, without the empty ones."""
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            mark = _COMMENT.match(line) if line.lstrip()[0] in "#%/!-" else None
            lines.append(Line(number, line[mark.end() :] if mark else line, mark is not None))
    return lines


def split(text: str, delimiter: str) -> Sequence[str]:
    """Split a line into cells; a delimiter inside double quotes does not count, a blank stands for any run of them."""
    if '"' not in text:
        return text.split() if delimiter == " " else [cell.strip() for cell in text.split(delimiter)]
    if delimiter == " ":
        return [cell for cell in re.split(r'\s+|"([^"]*)"', text) if cell]
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))]


def find_layout(lines: list[Line], source: str, delimiter: str | None = None) -> tuple[list[Line], Layout]:
    """Find delimiter, width, headers and first row of data."""
    sample = [line.text for line in lines if not line.comment][:_SAMPLE]
    delimiter = delimiter or _find_delimiter(sample)
    lines = [line._replace(cells=tuple(split(line.text, delimiter))) for line in lines]
    rows = [line.cells for line in lines if not line.comment][:_SAMPLE]
    check_width(max(map(len, rows)), source)
    widths = Counter(len(cells) for cells in rows if _is_data(cells))
    if not widths:
        raise TableError(
            f"{source} holds no rows of at least two numbers; it needs one row a reading below one line of column "
            "names. Check the file and its delimiter."
        )
    return lines, _find_header(lines, widths.most_common(1)[0][0], delimiter)


def _find_delimiter(sample: list[str]) -> str:
    """The delimiter under which most lines have the same number of cells, all numeric."""
    scores = []
    for delimiter in _DELIMITERS:
        rows = [split(text, delimiter) for text in sample]
        widths = Counter(len(cells) for cells in rows if len(cells) > 1 and all(map(looks_measured, cells)))
        partly = Counter(len(cells) for cells in rows if _is_data(cells))
        scores.append((max(widths.values(), default=0), max(partly.values(), default=0)))
    return _DELIMITERS[scores.index(max(scores))]


def _is_data(cells: Sequence[str]) -> bool:
    """Whether at least half of the cells that are not empty are numbers."""
    filled = [cell for cell in cells if cell]
    return len(cells) > 1 and 0 < len(filled) <= 2 * sum(map(looks_measured, filled))


def _find_header(lines: list[Line], width: int, delimiter: str) -> Layout:
    """Headers above the first row of data, and notes on the lines that were passed over.

    Of several lines of words that one is taken in which most cells name a quantity, of equal ones the last.
    """
    start = _first_row(lines, width)
    above = [line for line in lines if line.number < start][-_SAMPLE:]
    headed = [(line, _header_cells(line, delimiter, width)) for line in above]
    named = [
        (sum(map(_is_known, cells)), line.number, cells)
        for line, cells in headed
        if cells is not None and not all(map(looks_numeric, cells)) and not _units_of(cells)
    ]
    # A matrix whose upper left corner is blank has a first line with one number less
    rows = (line for line in above if not line.comment and all(map(looks_numeric, line.cells)))
    axes = [(0, line.number, ("", *line.cells)) for line in rows if len(line.cells) == width - 1]
    _, number, headers = max(named or axes, default=(0, 0, ()))
    used = frozenset((number,))
    for line, cells in headed if named else ():
        if line.number > number and cells is not None and (units := _units_of(cells)):
            headers = tuple(
                name if parse_header(name).unit or unit in _NO_UNITS else f"{name} [{unit}]"
                for name, unit in zip(headers, units, strict=True)
            )
            used |= {line.number}
    passed = [line.number for line in above if line.number not in used]
    note = "lines {} above the readings are text, such as titles, and were ignored"
    if len(passed) == 1:
        note = "line {} above the readings is text, such as a title, and was ignored"
    return Layout(delimiter, width, headers, start, used, (note.format(listing(passed)),) if passed else ())


def _first_row(lines: list[Line], width: int) -> int:
    """Number of the first line of data; lines with numbers above a line of known names are title lines."""
    first, rows = None, 0
    for line in lines[: 2 * _SAMPLE]:
        if line.comment or len(line.cells) != width:
            continue
        if _is_data(line.cells):
            first = first or line.number
            rows += all(map(looks_numeric, line.cells))
        elif first is not None and rows < 2 and sum(map(_is_known, line.cells)) >= 2:
            first = None
    return first or lines[-1].number + 1


_NO_UNITS = frozenset(("", "-", "1"))


def _units_of(cells: Sequence[str]) -> list[str]:
    """Units of a line in which most cells are units and few names; none of another: ``mm;A;furlong``, not ``t;s;F``."""
    texts = [re.sub(r"^in\s+", "", cell.strip("[](){} ")) for cell in cells]
    filled = [text for text in texts if text not in _NO_UNITS]
    units = sum(map(is_unit, filled))
    some = 2 * units > len(filled) >= 2 * sum(map(_is_known, filled))
    return texts if some or units == len(filled) > 0 else []


def _header_cells(line: Line, delimiter: str, width: int) -> tuple[str, ...] | None:
    """Cells of a line that may be the header of so many columns; between blanks, names with a blank in them."""
    if len(line.cells) == width:
        return line.cells
    for wide in (r"\t+", r"\s{2,}", r"\s*[,;]\s*", r"\s+(?![\[(/])") if delimiter in {" ", "\t"} else ():
        parts = [cell.strip().strip('"') for cell in re.split(wide, line.text.strip())]
        if len(parts) == width:
            return tuple(parts)
    return None


def _is_known(cell: str) -> bool:
    return bool(cell) and any(score(parse_header(cell), column) >= MAYBE for column in CHANNELS)
