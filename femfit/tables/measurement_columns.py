"""From the headers of a measured file to columns in SI units.

A header is the column's name (``distance_m``), or its stem or another name for it with any unit of its kind
(``distance_mm``, ``Distance [mm]``, ``Luftspalt in mm``), or what the caller says it is.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding, listing
from femfit.core.quoted import quoted
from femfit.tables.column_names import NEEDS_UNIT
from femfit.tables.header import find_header, names_column, parse_header, same_header
from femfit.tables.measurement import CHANNELS, SETTINGS
from femfit.tables.number_text import EMPTY, clock_seconds
from femfit.tables.raw_table import RawTable
from femfit.tables.units import column_unit, given_factor, unit_factor

BENCH_COLUMNS = (*SETTINGS, *CHANNELS)
"""Of a bench table."""

_BRANCH_WORDS = {
    **dict.fromkeys(("rising", "rise", "up", "+", "increasing", "ascending", "steigend", "auf", "hin"), 1.0),
    **dict.fromkeys(("falling", "fall", "down", "-", "decreasing", "descending", "fallend", "ab", "zurück"), -1.0),
}
_LABELS = ("run", "mount")
_MOMENTS = ("time_s", "order")


@dataclass(frozen=True)
class UsedColumn:
    """How a column of a file becomes one of ours: its number times ``factor`` is SI."""

    header: str
    name: str
    factor: float


def recognise(
    headers: Iterable[str],
    source: str,
    names: Sequence[str] = BENCH_COLUMNS,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> tuple[list[UsedColumn], list[Finding]]:
    """Find columns among headers.

    Parameters
    ----------
    columns : mapping of str to str, optional
        Header to the column that it is, where its name does not say it.
    units : mapping of str to str, optional
        Header (or column) to its unit, or to a number that multiplies it to SI.
    """
    headers = list(headers)
    given = {find_header(header, headers, source, "--column"): name for header, name in (columns or {}).items()}
    for header, wanted in given.items():
        if wanted not in names:
            raise TableError(
                f"Column {quoted(header)!r} of {source} cannot be {quoted(wanted)!r}; give one of {', '.join(names)}."
            )
    used: dict[str, UsedColumn] = {}
    findings: list[Finding] = []
    in_unit = dict(units or {})
    for header in sorted(headers, key=lambda header: (header not in given, parse_header(header).name in NEEDS_UNIT)):
        unit = next((in_unit.pop(key) for key in list(in_unit) if same_header(key, header)), None)
        name: str | None = given.get(header) or _column_of(header, names)
        if name is not None and name in used:
            if name in given.values() or parse_header(header).name in NEEDS_UNIT:
                findings.append(_unused(header, f", because {quoted(used[name].header)!r} is {name}"))
                continue
            raise TableError(
                f"{source} must have one column for {name}; instead received {quoted(used[name].header)!r} and "
                f"{quoted(header)!r}. Remove one, or say which with --column HEADER={name}."
            )
        if name in in_unit:
            unit = in_unit.pop(name)
        column, finding = _converted(header, name, names, unit, source)
        findings += finding
        if column is not None:
            used[column.name] = column
    if in_unit:
        find_header(next(iter(in_unit)), headers, source, "--unit")
    order = {header: k for k, header in enumerate(headers)}
    return sorted(used.values(), key=lambda column: order[column.header]), findings


def match_column(header: str, names: Sequence[str] = BENCH_COLUMNS) -> UsedColumn | None:
    """Return the column that a header means, if its unit is one of the right kind."""
    column, _ = _converted(header, _column_of(header, names), names, None, "")
    return column


def _column_of(header: str, names: Sequence[str]) -> str | None:
    if header.strip() in names:
        return header.strip()
    parsed = parse_header(header)
    return next((name for name in names if names_column(parsed, name)), None)


def _converted(
    header: str, name: str | None, names: Sequence[str], given_unit: str | None, source: str
) -> tuple[UsedColumn | None, list[Finding]]:
    """How a column is used, and what there is to say of it."""
    if name is None:
        near = get_close_matches(header.strip()[:100], names, n=1, cutoff=0.75)
        return None, [_unused(header, f"; did you mean {near[0]}?" if near else "")]
    _, si_unit = column_unit(name)
    unit = parse_header(header).unit if given_unit is None else given_unit
    if unit is None or (given_unit is None and header.strip() == name):
        said = (
            [] if header.strip() == name else [_said("column", f"Column {quoted(header)!r} was read as {name}.", name)]
        )
        return UsedColumn(header, name, 1.0), said
    if given_unit is None:
        factor = unit_factor(unit, si_unit) if si_unit else None
    else:
        factor = given_factor(given_unit, si_unit, header, source)
    if factor is None:
        text = f"Column {quoted(header)!r} is in {quoted(unit)}, where {name} is needed; it was not used."
        return None, [_said("unused-column", text, name)]
    how = f"read as {name}" if factor == 1.0 else f"converted to {name}, times {factor:g}"
    return UsedColumn(header, name, factor), [_said("column", f"Column {quoted(header)!r} was {how}.", name)]


def _said(code: str, text: str, column: str) -> Finding:
    return Finding(code, "info", text, column=column)


def _unused(header: str, why: str) -> Finding:
    text = f"Column {quoted(header)!r} is none that such a file has and was not used{why}"
    return Finding("unused-column", "info", text if why.endswith("?") else f"{text}.")


def column_values(raw: RawTable, used: Sequence[UsedColumn]) -> tuple[pd.DataFrame, list[Finding]]:
    """Return the used columns as float64 in SI; NaN where a cell is empty or no finite number, which is said."""
    findings: list[Finding] = []
    values: dict[str, FloatArray] = {}
    for column in used:
        values[column.name], said = _values(raw, column)
        findings += said
    if raw.ragged:
        lines = listing(raw.ragged)
        text = f"Line{'s' * (len(raw.ragged) > 1)} {lines} of {raw.source} had more or fewer cells than column names."
        findings.append(Finding("cells", "warning", f"{text} Nothing was read there."))
    return pd.DataFrame(values), findings


def _values(raw: RawTable, column: UsedColumn) -> tuple[FloatArray, list[Finding]]:
    values = raw.column(column.header)
    if np.isfinite(values).all():
        return np.sign(values) if column.name == "branch" else values * column.factor, []
    cells = [str(cell).strip() for cell in raw.text(column.header)]
    moments = clock_seconds(cells, column.header) if column.name in _MOMENTS else None
    if moments is not None:
        return moments, []
    empty = np.array([cell.casefold() in EMPTY for cell in cells])
    if column.name == "branch":
        words = np.array([_BRANCH_WORDS.get(cell.casefold(), np.nan) for cell in cells])
        values = np.sign(np.where(np.isfinite(words), words, values))
        empty &= np.isnan(values)
    if column.name in _LABELS and np.isnan(values[~empty]).any():
        labels = list(dict.fromkeys(cell for cell, missing in zip(cells, empty, strict=True) if not missing))
        number = {label: k + 1.0 for k, label in enumerate(labels)}
        text = f"{column.name} was numbered: {listing(f'{k + 1} = {label}' for k, label in enumerate(labels))}."
        numbers = [np.nan if missing else number[cell] for cell, missing in zip(cells, empty, strict=True)]
        return np.array(numbers), [_said("labels", text, column.name)]
    bad = np.flatnonzero(np.isnan(values) & ~empty)
    if not len(bad):
        return values * column.factor, []
    count = "1 cell holds" if len(bad) == 1 else f"{len(bad)} cells hold"
    text = f"In {quoted(column.header)} {count} no number ({quoted(cells[bad[0]])!r}); these readings count as missing."
    return values * column.factor, [Finding("cells", "info", text, size=float(len(bad)), column=column.name)]
