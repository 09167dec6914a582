"""Text tables of any dialect: delimiter, decimal mark, comment and free-text lines, header line, units line."""

import itertools
import re
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import TableError
from femfit.tables.decode import decode
from femfit.tables.foreign.header import match_score
from femfit.tables.foreign.number_text import find_decimal, looks_numeric, parse_number
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.quantities import QUANTITIES
from femfit.tables.foreign.raw_table import RawTable
from femfit.tables.header import parse_header
from femfit.tables.units import is_unit

_DELIMITERS = (";", "\t", "|", ",", " ")
_DELIMITER_NAMES = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
_COMMENT = re.compile(r"\s*(#|%|//|!|--(?=\s))+\s?")
_QUOTED = re.compile(r'"([^"]*)"')


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    comment: bool


def parse_text_table(content: bytes, source: str, options: ImportOptions) -> RawTable:
    """Read a text table.

    Parameters
    ----------
    options : ImportOptions
        Encoding, delimiter, decimal mark and column names override what is found.

    Returns
    -------
    RawTable
        Every row of the file below its header, bad cells as NaN.

    Raises
    ------
    TableError
        If there is no table of at least two columns in the text, or its decimal mark is open.
    """
    text, encoding = decode(content, source, options.encoding)
    lines = [_line(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    plain = [line for line in lines if not line.comment]
    if not plain:
        raise TableError(f"{source} is empty; it needs a header line and rows of numbers.")
    delimiter = options.delimiter or _find_delimiter(plain)
    if 2 * sum(line.text.rstrip(" ").endswith(delimiter) for line in plain) > len(plain):
        lines = [replace(line, text=line.text.rstrip(" ").removesuffix(delimiter)) for line in lines]
        plain = [line for line in lines if not line.comment]
    rows = [(line, split(line.text, delimiter)) for line in plain]
    width = _width(rows, source, delimiter)
    first = next(index for index, (_, cells) in enumerate(rows) if _is_data(cells, width))
    headers, used, notes = _find_header(lines, rows, first, width, delimiter)
    body = [(line, cells) for line, cells in rows[first:] if line.number not in used]
    header_cells = [cells for line, cells in rows if line.number in used]
    repeated = [line.number for line, cells in body if cells in header_cells]
    body = [(line, cells) for line, cells in body if line.number not in repeated]
    if repeated:
        notes = (*notes, f"repeated header at line {', '.join(map(str, repeated))} passed over")
    padded = tuple(tuple((cells + [""] * width)[: max(width, len(cells))]) for _, cells in body)
    decimal = options.decimal or find_decimal(
        (cell for cells in [*padded, headers] for cell in cells if looks_numeric(cell)), source
    )
    # A line of another width shifts its cells to wrong columns: none of it is taken for a number.
    values = np.array(
        [
            [parse_number(cell, decimal) for cell in cells] if len(raw) == width else [np.nan] * width
            for cells, (_, raw) in zip(padded, body, strict=True)
        ]
    ).reshape(len(body), width)
    return RawTable(
        source=source,
        headers=options.column_names or headers,
        numbers=values,
        lines=tuple(line.number for line, _ in body),
        cells=padded,
        dialect=f"{encoding}, {_DELIMITER_NAMES.get(delimiter, repr(delimiter))}, decimal {decimal}",
        decimal=decimal,
        notes=notes,
    )


def split(text: str, delimiter: str) -> list[str]:
    """Cells of a line; a delimiter inside double quotes does not count.

    Parameters
    ----------
    delimiter : str
        One character; a blank stands for any run of blanks and tabs.
    """
    kept: list[str] = []

    def keep(match: re.Match[str]) -> str:
        kept.append(match.group(1))
        return f"\x01{len(kept) - 1}\x01"

    hidden = _QUOTED.sub(keep, text)
    raw = hidden.split() if delimiter == " " else hidden.split(delimiter)
    return [re.sub("\x01(\\d+)\x01", lambda match: kept[int(match.group(1))], cell).strip() for cell in raw]


def _line(number: int, text: str) -> _Line:
    clean = text.replace("\x01", "")
    mark = _COMMENT.match(clean)
    return _Line(number, clean[mark.end() :] if mark else clean, mark is not None)


def _find_delimiter(lines: list[_Line]) -> str:
    """The delimiter under which most lines have the same number of cells, all numeric."""
    scores = []
    for delimiter in _DELIMITERS:
        rows = [split(line.text, delimiter) for line in lines]
        widths = Counter(len(cells) for cells in rows if len(cells) > 1 and all(map(looks_numeric, cells)))
        partly = Counter(len(cells) for cells in rows if len(cells) > 1 and _mostly_numeric(cells))
        scores.append((max(widths.values(), default=0), max(partly.values(), default=0)))
    return _DELIMITERS[scores.index(max(scores))]


def _mostly_numeric(cells: list[str]) -> bool:
    return 2 * sum(bool(cell) and looks_numeric(cell) for cell in cells) >= len(cells)


def _is_data(cells: list[str], width: int) -> bool:
    return len(cells) == width and _mostly_numeric(cells)


def _width(rows: list[tuple[_Line, list[str]]], source: str, delimiter: str) -> int:
    widths = Counter(len(cells) for _, cells in rows if len(cells) > 1 and _mostly_numeric(cells))
    if not widths:
        raise TableError(
            f"{source} holds no rows of at least two numbers (read with {_DELIMITER_NAMES.get(delimiter, delimiter)}); "
            "it needs columns of current, distance and force. Check the file, or give --delimiter and --decimal."
        )
    return widths.most_common(1)[0][0]


def _find_header(
    lines: list[_Line], rows: list[tuple[_Line, list[str]]], first: int, width: int, delimiter: str
) -> tuple[tuple[str, ...], frozenset[int], tuple[str, ...]]:
    """Headers, the numbers of their lines, and notes on the lines that were passed over."""
    start = rows[first][0].number
    above = [line for line in lines if line.number < start]
    best: tuple[int, tuple[str, ...], int] | None = None
    for line in reversed(above):
        cells = header_cells(line.text, delimiter, width)
        if cells is None or all(map(looks_numeric, cells)) or _is_units_line(cells):
            continue
        recognised = sum(any(match_score(parse_header(cell), name) for name in QUANTITIES) for cell in cells)
        if best is None or recognised > best[0]:
            best = (recognised, cells, line.number)
    if best is None:
        corner = _axis_line(above, width, delimiter)
        return (*corner, tuple(_passed_over(above, corner[1])))
    _, headers, number = best
    used = {number}
    for line in above:
        units = header_cells(line.text, delimiter, width)
        if line.number > number and units is not None and _is_units_line(units):
            headers = tuple(
                name if parse_header(name).unit or not unit else f"{name} [{unit.strip('[]() ')}]"
                for name, unit in zip(headers, units, strict=True)
            )
            used.add(line.number)
    return headers, frozenset(used), tuple(_passed_over(above, frozenset(used)))


def _axis_line(above: list[_Line], width: int, delimiter: str) -> tuple[tuple[str, ...], frozenset[int]]:
    """A matrix whose upper left corner is blank has a first line with one number less."""
    for line in reversed(above):
        cells = split(line.text, delimiter)
        if not line.comment and len(cells) == width - 1 and all(map(looks_numeric, cells)):
            return ("", *cells), frozenset((line.number,))
    return (), frozenset()


def _passed_over(above: list[_Line], used: frozenset[int]) -> list[str]:
    numbers = [str(line.number) for line in above if line.number not in used]
    return [f"free text at line {', '.join(numbers)} passed over"] if numbers else []


def _is_units_line(cells: tuple[str, ...]) -> bool:
    texts = [cell.strip("[]() ") for cell in cells]
    return any(texts) and all(not text or text == "-" or is_unit(text) for text in texts)


def header_cells(text: str, delimiter: str, width: int) -> tuple[str, ...] | None:
    """Cells of a header line; with blanks, words that belong together are joined.

    Parameters
    ----------
    text : str
        The line without its comment mark.

    Returns
    -------
    tuple of str or None
        None if the line cannot be the header of so many columns.
    """
    cells = split(text, delimiter)
    if len(cells) == width:
        return tuple(cells)
    if delimiter not in {" ", "\t"}:
        return None
    for wide in (r"\t+", r"\s{2,}", r"\s*[,;]\s*"):
        parts = [part.strip().strip('"') for part in re.split(wide, text.strip())]
        if len(parts) == width:
            return tuple(parts)
    joined: list[str] = []
    for word in text.split():
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
    return max(match_score(parse_header(text), name) for name in QUANTITIES)
