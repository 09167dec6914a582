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
from femfit.core.text import quoted
from femfit.tables.channels import CHANNELS
from femfit.tables.header import match_score, parse_header
from femfit.tables.number_text import find_decimal, looks_measured, looks_numeric, numbers_of
from femfit.tables.raw_table import RawTable, check_width, decode
from femfit.tables.units import is_unit

_DELIMITERS = (";", "\t", "|", ",", " ")
_DELIMITER_NAMES = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
_COMMENT = re.compile(r"\s*(#|%|//|!|--(?=\s))+\s?")
_SAMPLE = 500
"""Lines by which delimiter and width are found."""

_DECIDING_ROWS = 5000
"""Rows, from all over the table, by which the decimal mark is found."""

_MOST_WORDS = 60
"""Words of a line that may be a header whose names hold blanks."""

_LONGEST_LINE = 2**17

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
    encoding: str | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    open_decimal: str | None = None,
) -> RawTable:
    """Read a text table; each argument overrides what is found out."""
    text, encoding = decode(content, source, encoding)
    lines = text_lines(text, source)
    if all(line.comment for line in lines):
        raise TableError(f"{source} is empty; it needs a header line and rows of numbers.")
    lines, layout = find_layout(lines, source, delimiter)
    body, rows, notes = _readings(lines, layout)
    ragged = tuple(line.number for line, row in zip(body, rows, strict=True) if len(row) != layout.width)
    if ragged:  # shifted cells would stand in wrong columns
        rows = [row if len(row) == layout.width else [""] * layout.width for row in rows]
    decimal = decimal or find_decimal(_deciding(rows, layout), source, open_decimal)
    texts = list(zip(*rows, strict=True)) if rows else [()] * layout.width
    return RawTable(
        source=source,
        headers=layout.headers,
        numbers=np.column_stack([numbers_of(column, decimal) for column in texts]),
        texts=texts,
        lines=[line.number for line in body],
        dialect=f"{encoding}, {_DELIMITER_NAMES.get(layout.delimiter, repr(layout.delimiter))}, decimal {decimal}",
        decimal=decimal,
        ragged=ragged,
        notes=(*layout.notes, *notes),
    )


def _readings(lines: list[Line], layout: Layout) -> tuple[list[Line], list[list[str]], list[str]]:
    """The lines of readings with their cells: without repeated headers, blank rows, and what stands below the last."""
    split_lines = [(line, split(line.text, layout.delimiter)) for line in lines if not line.comment]
    header = [cells for line, cells in split_lines if line.number in layout.used]
    below = [(line, cells) for line, cells in split_lines if line.number >= layout.first]
    repeated = [line.number for line, cells in below if cells in header]
    body = [(line, cells) for line, cells in below if any(cells) and cells not in header]
    notes = [f"repeated header at line {listing(repeated)} passed over"] if repeated else []
    end = len(body)
    while end and _is_no_reading(body[end - 1][1], layout.width):
        end -= 1
    if 0 < end < len(body):
        text = listing(line.text.strip() for line, _ in body[end:])
        notes.append(f"line {listing(line.number for line, _ in body[end:])} below the readings passed over ({text})")
        body = body[:end]
    return [line for line, _ in body], [cells for _, cells in body], notes


def _is_no_reading(cells: list[str], width: int) -> bool:
    """Whether a line at the end of a table is a footnote, or a mean or sum of the lines above."""
    words = re.findall(r"[^\W\d_]+", next(filter(None, cells), ""))
    return (bool(words) and words[0].casefold() in _SUMMARIES) or (len(cells) != width and not _is_data(cells))


def _deciding(rows: Sequence[Sequence[str]], layout: Layout) -> set[str]:
    """Cells that may say which mark is the decimal one."""
    cells = set(itertools.chain(layout.headers, *rows[:: 1 + len(rows) // _DECIDING_ROWS]))
    if any("," in cell for cell in cells):
        return {cell for cell in cells if ("," in cell or "." in cell) and looks_numeric(cell)}
    return {cell for cell in cells if cell.count(".") > 1 and looks_numeric(cell)}


def text_lines(text: str, source: str) -> list[Line]:
    """Split a text into its lines, without the empty ones."""
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > _LONGEST_LINE:
            raise TableError(
                f"Line {number} of {source} has {len(line)} characters; a table's line has at most {_LONGEST_LINE}. "
                "Check that the file is a text table."
            )
        if line.strip():
            mark = _COMMENT.match(line) if line.lstrip()[0] in "#%/!-" else None
            lines.append(Line(number, line[mark.end() :] if mark else line, mark is not None))
    return lines


def split(text: str, delimiter: str) -> list[str]:
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
    if _ends_each_line(sample, delimiter):
        lines = [line._replace(text=line.text.rstrip(" ").removesuffix(delimiter)) for line in lines]
        sample = [line.text for line in lines if not line.comment][:_SAMPLE]
    rows = [split(text, delimiter) for text in sample]
    check_width(max(map(len, rows)), source)
    widths = Counter(len(cells) for cells in rows if _is_data(cells))
    if not widths:
        return lines, _only_names(lines, source, delimiter)
    width = widths.most_common(1)[0][0]
    return lines, _find_header(lines, width, delimiter)


def _only_names(lines: list[Line], source: str, delimiter: str) -> Layout:
    """The layout of a table whose line of names has no rows below it."""
    candidates = [(split(line.text, mark), mark) for line in lines for mark in dict.fromkeys((delimiter, *_DELIMITERS))]
    names, mark = max(candidates[:_SAMPLE], key=lambda candidate: sum(map(_is_known, candidate[0])))
    if sum(map(_is_known, names)) < 2:
        raise TableError(
            f"{source} holds no rows of at least two numbers (read with {_DELIMITER_NAMES.get(delimiter, delimiter)}); "
            "it needs one row a reading below one line of column names. Check the file and its delimiter."
        )
    return Layout(mark, len(names), tuple(names), lines[-1].number + 1)


def _ends_each_line(sample: list[str], delimiter: str) -> bool:
    """Whether most lines end with a delimiter that closes the line, and does not stand before an empty last cell."""
    ended = [text.rstrip(" ").endswith(delimiter) for text in sample]
    if 2 * sum(ended) <= len(sample):
        return False
    usual = Counter(len(split(text, delimiter)) for text, end in zip(sample, ended, strict=True) if end)
    width = usual.most_common(1)[0][0]
    return not any(len(split(text, delimiter)) == width for text, end in zip(sample, ended, strict=True) if not end)


def _find_delimiter(sample: list[str]) -> str:
    """The delimiter under which most lines have the same number of cells, all numeric."""
    scores = []
    for delimiter in _DELIMITERS:
        rows = [split(text, delimiter) for text in sample]
        widths = Counter(len(cells) for cells in rows if len(cells) > 1 and all(map(looks_measured, cells)))
        partly = Counter(len(cells) for cells in rows if _is_data(cells))
        scores.append((max(widths.values(), default=0), max(partly.values(), default=0)))
    return _DELIMITERS[scores.index(max(scores))]


def _is_data(cells: list[str]) -> bool:
    """Whether at least half of the cells that are not empty are numbers."""
    filled = [cell for cell in cells if cell]
    return len(cells) > 1 and 0 < len(filled) <= 2 * sum(map(looks_measured, filled))


def _find_header(lines: list[Line], width: int, delimiter: str) -> Layout:
    """Headers above the first row of data, and notes on the lines that were passed over.

    Of several lines of words that one is taken in which most cells name a quantity, of equal ones the last.
    """
    start = _first_row(lines, width, delimiter)
    above = [line for line in lines if line.number < start][-_SAMPLE:]
    best: tuple[int, tuple[str, ...], int] | None = None
    for line in reversed(above):
        cells = _header_cells(line.text, delimiter, width)
        if cells is None or all(map(looks_numeric, cells)) or _is_units_line(cells):
            continue
        count = sum(map(_is_known, cells))
        if best is None or count > best[0]:
            best = (count, cells, line.number)
    if best is None:
        headers, used = _axis_line(above, width, delimiter)
        return Layout(delimiter, width, headers, start, used, _passed_over(above, used))
    _, headers, number = best
    used = frozenset((number,))
    below = [(line.number, _header_cells(line.text, delimiter, width)) for line in above if line.number > number]
    for line_number, cells in below:
        if cells is None:
            continue
        if _is_units_line(cells):
            units = [re.sub(r"^in\s+", "", cell.strip("[](){} ")) for cell in cells]
            headers = tuple(
                name if parse_header(name).unit or unit in {"", "-", "1"} else f"{name} [{unit}]"
                for name, unit in zip(headers, units, strict=True)
            )
        elif line_number == below[0][0] and len(set(headers)) < width and sum(map(bool, cells)) > 1:
            headers = _two_lines(headers, cells)
        else:
            continue
        used |= {line_number}
    damaged = [line for line in above if line.number > number and line.number not in used and _is_row(line, delimiter)]
    notes = [f"line {line.number} was left out, a row that cannot be read ({quoted(line.text)})" for line in damaged]
    passed = _passed_over(above, used | {line.number for line in damaged})
    return Layout(delimiter, width, headers, start, used, (*notes, *passed))


def _is_row(line: Line, delimiter: str) -> bool:
    """Whether a line below the headers is a row of readings that is damaged: some of its cells begin with a number."""
    return not line.comment and any(re.match(r"[-+]?[.,]?\d", cell) for cell in split(line.text, delimiter))


def _two_lines(groups: tuple[str, ...], names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of two lines, where a group's name stands over the first of its columns or over each."""
    headers: list[str] = []
    group = ""
    for above, below in zip(groups, names, strict=True):
        group = above or group
        headers.append(f"{group} {below}".strip() if below else above)
    return tuple(headers)


def _first_row(lines: list[Line], width: int, delimiter: str) -> int:
    """Number of the first line of data; lines with numbers above a line of known names are title lines."""
    first, rows = None, 0
    for line in lines[: 2 * _SAMPLE]:
        cells = split(line.text, delimiter)
        if line.comment or len(cells) != width:
            continue
        if _is_data(cells):
            first = first or line.number
            rows += all(map(looks_numeric, cells))
        elif first is not None and rows < 2 and sum(map(_is_known, cells)) >= 2:
            first = None
    return first or lines[-1].number + 1


def _axis_line(above: list[Line], width: int, delimiter: str) -> tuple[tuple[str, ...], frozenset[int]]:
    """A matrix whose upper left corner is blank has a first line with one number less."""
    for line in reversed(above):
        cells = split(line.text, delimiter)
        if not line.comment and len(cells) == width - 1 and all(map(looks_numeric, cells)):
            return ("", *cells), frozenset((line.number,))
    return (), frozenset()


def _passed_over(above: list[Line], used: frozenset[int]) -> tuple[str, ...]:
    numbers = [line.number for line in above if line.number not in used]
    if not numbers:
        return ()
    lines = "line {} above the readings is text, such as a title, and was"
    if len(numbers) > 1:
        lines = "lines {} above the readings are text, such as titles, and were"
    return (f"{lines.format(listing(numbers))} ignored",)


def _is_units_line(cells: tuple[str, ...]) -> bool:
    """Whether most cells are units and few are names: ``mm;A;furlong`` is such a line, ``t;s;F`` is none."""
    texts = [re.sub(r"^in\s+", "", cell.strip("[](){} ")) for cell in cells]
    filled = [text for text in texts if text not in {"", "-", "1"}]
    units = sum(map(is_unit, filled))
    if units == len(filled):
        return units > 0
    return 2 * units > len(filled) >= 2 * sum(map(_is_known, filled))


def _header_cells(text: str, delimiter: str, width: int) -> tuple[str, ...] | None:
    """Cells of a line that may be the header of so many columns; with blanks, words that belong together are joined."""
    cells = split(text, delimiter)
    if len(cells) == width:
        return tuple(cells)
    words = text.split()
    if delimiter not in {" ", "\t"} or len(words) > _MOST_WORDS:
        return None
    for wide in (r"\t+", r"\s{2,}", r"\s*[,;]\s*"):
        parts = [cell.strip().strip('"') for cell in re.split(wide, text.strip())]
        if len(parts) == width:
            return tuple(parts)
    joined: list[str] = []
    for word in words:
        if joined and word[0] in "[(/":
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    while len(joined) > width:
        pairs = [_known(f"{a} {b}") - max(_known(a), _known(b)) for a, b in itertools.pairwise(joined)]
        if max(pairs) <= 0:
            return None
        index = pairs.index(max(pairs))
        joined[index : index + 2] = [f"{joined[index]} {joined[index + 1]}"]
    return tuple(joined) if len(joined) == width else None


def _known(text: str) -> int:
    header = parse_header(text)
    return max(match_score(header, column) for column in CHANNELS)


def _is_known(cell: str) -> bool:
    return bool(cell) and _known(cell) > 0
