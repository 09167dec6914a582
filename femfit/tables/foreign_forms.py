"""Long tables, one row a point: which column holds what, in which unit.

Matrix tables force(distance, current): axis vectors in the first row and column.

What a user can say about a foreign table where its text does not say it.
"""

import re
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.public import require_known
from femfit.core.results import Finding, listing
from femfit.core.sweep_columns import COLUMNS
from femfit.core.text import quoted
from femfit.tables.columns import UsedColumn, match_columns
from femfit.tables.findings import finding, refused
from femfit.tables.header import parse_header
from femfit.tables.raw_table import RawTable, looks_numeric, parse_number
from femfit.tables.reading import Wants, Words
from femfit.tables.units import CHANNELS, column_unit, unit_factor

SWEPT = tuple(name for name in COLUMNS if name in CHANNELS)
"""What the table of a sweep can hold."""

REQUIRED = SWEPT[:3]
AXES = REQUIRED[:2]
WORDS = {column_unit(name)[0]: name for name in SWEPT}
"""What users call a column, without its unit."""


ACCEPTABLE = ("cells", "contradictions", "distance", "one-current", "one-distance", "suspected-unit", "reciprocity")
"""Codes of errors in spite of which a table is one."""

_CHOICES = {"matrix_rows": ("auto", "distance", "current"), "decimal": (None, ".", ",")}


@dataclass(frozen=True)
class ImportOptions(Words):
    """Overrides of what the reader finds out by itself.

    Attributes
    ----------
    matrix_rows : {'auto', 'distance', 'current'}
        Quantity in the first column of a matrix force(distance, current) with its axes.
    decimal : {'.', ','} or None
        Decimal mark of the numbers.
    distance_start_m : float or None
        Distance at position (or step) zero; positions that count towards the electromagnet have a negative factor as
        unit.
    keep_force : bool
        Force with the sign that it has, whatever its current says.
    without : sequence of str
        Quantities to leave out: flux_linkage, inductance, hall, coenergy.
    accept : sequence of str
        Codes of errors that shall not stop the import.
    """

    # Names of the columns of a table without a header line, in order; of a matrix, its first row
    column_names: tuple[str, ...] = ()
    matrix_rows: Literal["auto", "distance", "current"] = "auto"
    decimal: str | None = None
    distance_start_m: float | None = None
    keep_force: bool = False
    without: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Turn ``flux-linkage`` into ``flux_linkage_Wb``; a header stays what it is."""
        super().__post_init__()
        for name, choices in _CHOICES.items():
            if (choice := getattr(self, name)) not in choices:
                listed = ", ".join(map(str, choices))
                raise TableError(f"{name} must be one of {listed}; instead received {quoted(choice)}.")
        object.__setattr__(self, "columns", {header: _column(name) for header, name in self.columns.items()})
        object.__setattr__(self, "units", {_column(key): unit for key, unit in self.units.items()})
        require_known("without", self.without, [name for name in WORDS if WORDS[name] not in REQUIRED])
        require_known("accept", self.accept, ACCEPTABLE)
        object.__setattr__(self, "without", tuple(map(_column, self.without)))


def _column(word: str) -> str:
    return WORDS.get(word.replace("-", "_"), word)


SWEEP = Wants(
    "table to import",
    SWEPT,
    needs=REQUIRED,
    hints={
        "current_A": "Where a file holds one current, write it in the file's name, as in force_0.4A.csv.",
        "distance_m": "Where a file holds one distance, write it in the file's name, as in force_5mm.csv.",
    },
)


def long_points(raw: RawTable, options: ImportOptions) -> tuple[pd.DataFrame, dict[str, UsedColumn], list[Finding]]:
    """Read one row a point with SI columns, the distance before its start.

    A setting is the whole file's current (A) or distance (m), used where no column holds it; ``source`` and ``line``
    say where a row stands.
    """
    headers, width = raw.headers, len(raw.cells)
    if not headers:
        raise refused("no-header", source=raw.source, columns=width)
    if len(headers) != width:
        raise refused(
            "names-of-columns", source=raw.source, columns=width, names=len(headers), headers=listing(headers, 12)
        )
    used, findings = match_columns(
        headers, raw.source, SWEPT, options.columns, options.units, SWEPT[len(REQUIRED) :], guessed=REQUIRED
    )
    wanted = sorted((use for use in used if use.name not in options.without), key=lambda use: SWEPT.index(use.name))
    uses = {use.name: use for use in wanted}
    data = {use.name: raw.column(headers.index(use.header)) * use.factor for use in wanted}
    for name, value in options.settings.items():
        if name not in uses:
            data[name] = np.full(len(raw.lines), value, dtype=np.float64)
            uses[name] = UsedColumn(f"{value:g} for the whole file", name, 1.0, column_unit(name)[1])
    SWEEP.require(data, headers, raw.source, used)
    return pd.DataFrame(data).assign(source=raw.source, line=raw.lines), uses, findings


_LABEL = re.compile(
    r"(?P<name>[^\d+\-.,=@]{0,80})[=@_\s]{0,9}(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s{0,9}"
    r"\[?\(?(?P<unit>[^\d\W]*)\]?\)?$"
)
_LONGEST_CORNER = 200
_LABEL_WORDS = frozenset(name for axis in REQUIRED for name in CHANNELS[axis].names)


def axis_of_labels(raw: RawTable) -> tuple[FloatArray, str] | None:
    """Read the numbers of column headers such as ``0.2``, ``0,2 A``, ``I=0.2``, ``F @ 0.2 A``, and their unit.

    None unless each header but the first is such a label and they go strictly up or down.
    """
    cells, decimal = raw.headers[1:], raw.decimal or "."
    labels = [match for match in map(_LABEL.match, map(str.strip, cells)) if match]
    units = {match["unit"] for match in labels}
    words = {word for match in labels for word in parse_header(match["name"]).words}
    if len(labels) < len(cells) or len(units) != 1 or not words <= _LABEL_WORDS or not all(map(_axis_of, units - {""})):
        return None
    numbers = (cell if looks_numeric(cell) else match["number"] for cell, match in zip(cells, labels, strict=True))
    axis = np.array([parse_number(number, decimal) for number in numbers])
    return (axis, units.pop()) if _monotone(axis) else None


def is_matrix(raw: RawTable, options: ImportOptions) -> bool:
    """Tell whether a table is a matrix with axes.

    It is one if the user says what its rows are, if the header row holds an axis, or, without headers, if it has both
    axes and a corner that is empty or text: a number there may be one more position above a list of them.
    """
    if options.matrix_rows != "auto":
        return True
    if len(raw.cells) < 3:
        return False
    if raw.headers:
        return axis_of_labels(raw) is not None
    values = raw.numbers
    return len(values) >= 3 and _monotone(values[0, 1:]) and _monotone(values[1:, 0]) and bool(np.isnan(values[0, 0]))


def listed(raw: RawTable, options: ImportOptions) -> tuple[RawTable, ImportOptions, list[Finding]]:
    """A matrix as a table with one row a point, with the options that say what its columns are."""
    numbers, lines = raw.numbers, list(raw.lines)
    labels = axis_of_labels(raw) if len(raw.headers) == len(raw.cells) else None
    if labels is not None:
        (across, label_unit), corner = labels, raw.headers[0]
    elif min(numbers.shape) < 2:
        raise TableError(f"{raw.source} as a matrix needs at least two rows and two columns; it is {numbers.shape}.")
    else:
        across, label_unit, corner = numbers[0, 1:], "", raw.texts(0)[0]
        numbers, lines = numbers[1:], lines[1:]
    corner, down = corner[:_LONGEST_CORNER], numbers[:, 0]
    if not _monotone(down) or not _monotone(across):
        raise refused("matrix-axes", source=raw.source)
    rows, why = _first_column(options, label_unit, corner)
    columns = AXES[1 - AXES.index(rows)]
    places = {"first column": rows, "first row": columns, "matrix": "force_N"}
    words = [(rows, parse_header(corner).unit or ""), (columns, label_unit)]
    words += [(_axis_of(word) or "force_N", word) for word in re.findall(r"[\[(]([^\])]*)[\])]", corner)]
    units: dict[str, str | float] = {}
    for name, word in words:
        if unit_factor(word, column_unit(name)[1]) is not None and (name == "force_N" or name not in units):
            units[name] = word
    grid = np.meshgrid(down, across, indexing="ij")
    points = replace(
        raw,
        headers=tuple(places),
        cells=[pd.Series(axis.ravel()) for axis in (*grid, numbers[:, 1:])],
        decimal="",
        lines=np.repeat(lines, len(across)).tolist(),
    )
    facts = {"source": raw.source, "down": column_unit(rows)[0], "across": column_unit(columns)[0], "why": why}
    return points, replace(options, columns=places, units=units | dict(options.units)), [finding("matrix", **facts)]


def _first_column(options: ImportOptions, label_unit: str, corner: str) -> tuple[str, str]:
    if options.matrix_rows != "auto":
        return WORDS[options.matrix_rows], "as given"
    if label_unit:
        return AXES[_axis_of(label_unit) == "current_A"], f"the first row is in {label_unit}"
    first = parse_header(re.split(r"[\\/|]", corner)[0])
    named = [axis for axis in reversed(AXES) if first.name in CHANNELS[axis].names]
    axis = _axis_of(first.unit or "") or next(iter(named), None)
    if axis is None:
        return "distance_m", "the usual order; --matrix-rows current if not"
    return axis, f"the corner says {quoted(corner)}"


def _axis_of(unit: str) -> str | None:
    return next((axis for axis in AXES if unit_factor(unit, column_unit(axis)[1]) is not None), None)


def _monotone(axis: FloatArray) -> bool:
    steps = np.diff(axis)
    return bool(len(axis) > 1 and np.isfinite(axis).all() and ((steps > 0).all() or (steps < 0).all()))
