"""Long tables, one row a point: which column holds what, in which unit.

Matrix tables force(distance, current): axis vectors in the first row and column.

What a user can say about a foreign table where its text does not say it.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, listing
from femfit.core.text import counted, quoted
from femfit.tables.columns import UsedColumn, match_columns, used_column
from femfit.tables.findings import finding
from femfit.tables.header import STEP_NAMES, names_of, parse_header
from femfit.tables.number_text import looks_numeric, parse_number
from femfit.tables.raw_table import RawTable
from femfit.tables.units import column_unit, unit_factor

QUANTITIES: dict[str, str] = {
    "current": "current_A",
    "distance": "distance_m",
    "force": "force_N",
    "flux_linkage": "flux_linkage_Wb",
    "inductance": "inductance_H",
    "hall": "hall_T",
    "coenergy": "coenergy_J",
    "force_error": "force_error_N",
}
"""What a sweep table can hold, and its column there."""

REQUIRED = ("current", "distance", "force")


def si_unit(quantity: str) -> str:
    """Return the SI unit of a quantity."""
    return column_unit(QUANTITIES[quantity])[1]


@dataclass(frozen=True)
class ImportOptions:
    """Overrides of what the reader finds out by itself."""

    # Header to the column of the sweep table that it is; header or column to its unit, or to a factor to SI
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str | float] = field(default_factory=dict)
    # Names of the columns of a table without a header line, in order; of a matrix, its first row
    column_names: tuple[str, ...] = ()
    # One row a point, or force(distance, current) with axes; and what the first column of such a matrix holds
    form: Literal["auto", "long", "matrix"] = "auto"
    matrix_rows: Literal["auto", "distance", "current"] = "auto"
    table: str | None = None  # Sheet, group or struct, where a file has several that could be meant
    decimal: str | None = None
    delimiter: str | None = None
    encoding: str | None = None
    # Current (distance) of each file, in the order of the files, where no column holds it
    file_currents_A: tuple[float, ...] = ()
    file_distances_m: tuple[float, ...] = ()
    # distance = start + step * column, or start - column for positions that count towards the electromagnet
    distance_step_m: float | None = None
    distance_start_m: float | None = None
    flip_distance: bool = False
    flip_current: bool = False  # Negate current and flux linkage (co-energy and force stay what they are)
    force_sign: Literal["auto", "keep", "flip"] = "auto"
    # Quantities that are left out; codes of error findings that shall not stop the import
    without: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Turn ``flux-linkage`` into ``flux_linkage_Wb``; a header stays what it is."""
        columns = {header: QUANTITIES.get(name.replace("-", "_"), name) for header, name in self.columns.items()}
        units = {QUANTITIES.get(key.replace("-", "_"), key): unit for key, unit in self.units.items()}
        object.__setattr__(self, "columns", columns)
        object.__setattr__(self, "units", units)


_REMEDIES = {
    "current": "--column HEADER=current, or --file-current-A where a file holds one current (or write it in the file "
    "names as in force_0.4A.csv)",
    "distance": "--column HEADER=distance, or --file-distance-mm where a file holds one distance",
    "force": "--column HEADER=force",
}


def long_points(
    raw: RawTable, constants: dict[str, float], options: ImportOptions
) -> tuple[pd.DataFrame, dict[str, UsedColumn], list[Finding]]:
    """Read one row a point with SI columns, the distance before start and step.

    The constants are the whole file's current (A) or distance (m), used where no column holds it. Further force columns
    are ``other:<header>``; ``source`` and ``line`` say where a row stands.
    """
    headers = options.column_names or raw.headers
    if not headers:
        raise TableError(
            f"{raw.source} has no header line over its {counted(raw.numbers.shape[1], 'column')}; name them with "
            "--columns current,distance,force (a dash for one that is not needed). For force(distance, current) give "
            "the currents of its columns: --columns 'd [mm],0 A,0.5 A,1 A'."
        )
    if len(headers) != raw.numbers.shape[1]:
        raise TableError(
            f"{raw.source} has {counted(raw.numbers.shape[1], 'column')} but "
            f"{counted(len(headers), 'name')} ({listing(headers, 12)}); give "
            "one name a column with --columns."
        )
    quantities = {column: quantity for quantity, column in QUANTITIES.items()}
    optional = [column for column, quantity in quantities.items() if quantity not in REQUIRED]
    matched, rivals, findings = match_columns(
        headers, raw.source, tuple(quantities), options.columns, options.units, guess=True, optional=optional
    )
    findings = [remark for remark in findings if quantities.get(remark.column) not in options.without]
    uses: dict[str, UsedColumn] = {}
    data: dict[str, FloatArray] = {}
    for k, column in sorted(matched.items(), key=lambda match: list(quantities).index(match[1].name)):
        quantity = quantities[column.name]
        if quantity not in options.without:
            uses[quantity] = in_steps(column, raw.source, options) if quantity == "distance" else column
            data[quantity] = raw.numbers[:, k] * uses[quantity].factor
    for quantity, value in constants.items():
        if quantity not in uses:
            data[quantity] = np.full(len(raw.lines), value, dtype=np.float64)
            origin = f"{value:g} for the whole file"
            uses[quantity] = UsedColumn(origin, QUANTITIES[quantity], 1.0, si_unit(quantity))
    missing = [quantity for quantity in REQUIRED if quantity not in data]
    if missing:
        remedies = [f"  - {quantity}: give {_REMEDIES[quantity]}" for quantity in missing]
        text = f"{raw.source} has no column that is known as {' or '.join(missing)}; it has {listing(headers, 20)}."
        raise TableError("\n".join([text, *remedies]))
    points = pd.DataFrame(data)
    for k in rivals["force_N"]:
        points[f"other:{headers[k]}"] = raw.numbers[:, k] * uses["force"].factor
    return points.assign(source=raw.source, line=raw.lines), uses, findings


def in_steps(column: UsedColumn, source: str, options: ImportOptions) -> UsedColumn:
    """Return the use of a distance whose column counts steps, where the user gives their size."""
    step = options.distance_step_m
    if step is not None:
        return replace(column, unit=f"steps of {step:g} m", factor=step, assumed=False)
    if column.assumed and parse_header(column.header).name in STEP_NAMES:
        raise TableError(
            f"{source}: column {quoted(column.header)!r} counts steps; give their size with --distance-step-mm and the "
            "first distance with --distance-start-mm."
        )
    return column


_LABEL = re.compile(
    r"(?P<name>[^\d+\-.,=@]{0,80})[=@_\s]{0,9}(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s{0,9}"
    r"\[?\(?(?P<unit>[^\d\W]*)\]?\)?$"
)
_LONGEST_CORNER = 200
_LABEL_WORDS = frozenset(name for axis in ("current", "distance", "force") for name in names_of(QUANTITIES[axis]))
_EVEN = 0.02
"""Spread of the steps of positions over their mean up to which the corner is one of them."""


def axis_labels(cells: tuple[str, ...], decimal: str) -> tuple[FloatArray, str | None] | None:
    """Read the numbers of column headers such as ``0.2``, ``0,2 A``, ``I=0.2``, ``F @ 0.2 A``, and their unit.

    None unless every cell is such a label and they go strictly up or down.
    """
    values, units = [], set()
    for cell in cells:
        match = _LABEL.match(cell.strip())
        if match is None:
            return None
        unit = match.group("unit") or None
        words = parse_header(match.group("name")).words
        if any(word not in _LABEL_WORDS for word in words) or (unit and not _axis_of(unit)):
            return None
        values.append(parse_number(cell if looks_numeric(cell) else match.group("number"), decimal))
        units.add(unit)
    axis = np.array(values)
    return (axis, units.pop()) if len(axis) > 1 and len(units) == 1 and _monotone(axis) else None


def is_matrix(raw: RawTable, options: ImportOptions) -> bool:
    """Tell whether a table is a matrix with axes.

    It is one if the header row holds an axis, or, without headers, if it has both axes and a corner that is empty or
    text. A zero in the corner is one only where the first row cannot be a row of data: a list of positions 0, 1, 2 ...
    with forces beside them looks alike.
    """
    if options.form != "auto":
        return options.form == "matrix"
    headers, values = options.column_names or raw.headers, raw.numbers
    if values.shape[1] < 3:
        return False
    if headers:
        return axis_labels(headers[1:], raw.decimal) is not None
    if values.shape[0] < 3 or not (_monotone(values[0, 1:]) and _monotone(values[1:, 0])):
        return False
    if np.isnan(values[0, 0]):
        return True
    return bool(values[0, 0] == 0 and not _goes_on(values[:, 0]) and _is_axis(values[0, 1:]))


def matrix_points(raw: RawTable, options: ImportOptions) -> tuple[pd.DataFrame, dict[str, UsedColumn], list[Finding]]:
    """Read one row a point from a matrix, as :func:`~femfit.tables.foreign_forms.long_points` does from a list."""
    across, label_unit, corner, body, lines, named = _parts(raw, options)
    down = body[:, 0]
    if not _monotone(down) or not _monotone(across):
        raise TableError(
            f"{raw.source} as a matrix must have axes that go strictly up or down in its first row and column. "
            "For one row a point give --form long."
        )
    rows, why = _first_column(options, across, down, label_unit, corner)
    columns = "current" if rows == "distance" else "distance"
    corner_unit = parse_header(corner).unit
    units: dict[str, str | None] = {
        rows: corner_unit if corner_unit and _axis_of(corner_unit) == rows else None,
        columns: label_unit if label_unit and _axis_of(label_unit) == columns else None,
    }
    force_unit = None
    for word in re.findall(r"[\[(]([^\])]*)[\])]", corner):
        axis = _axis_of(word)
        if axis and units[axis] is None:
            units[axis] = word
        elif unit_factor(word, si_unit("force")) is not None:
            force_unit = word
    units["force"] = force_unit
    places = {rows: "first column", columns: "first row", "force": "matrix"}
    uses = {
        quantity: used_column(
            place, QUANTITIES[quantity], units[quantity], raw.source, options.units.get(QUANTITIES[quantity])
        )
        for quantity, place in places.items()
    }
    uses["distance"] = in_steps(uses["distance"], raw.source, options)
    grid_down, grid_across = np.meshgrid(down, across, indexing="ij")
    points = pd.DataFrame(
        {
            rows: grid_down.ravel() * uses[rows].factor,
            columns: grid_across.ravel() * uses[columns].factor,
            "force": body[:, 1:].ravel() * uses["force"].factor,
            "source": raw.source,
            "line": np.repeat(lines, len(across)),
        }
    )
    findings = [finding("matrix", source=raw.source, down=rows, across=columns, why=why)]
    if not named and (not _is_axis(across) or (raw.numbers[0, 0] != 0 and _goes_on(raw.numbers[:, 0]))):
        shown = ", ".join(f"{value:g}" for value in across[:3])
        findings.append(finding("matrix-axis", shown=shown, axis=columns))
    return points, uses, findings


def _goes_on(column: FloatArray) -> bool:
    """Whether the corner is one more number of the first column, so that the first row is a row like the others."""
    return _monotone(column) and bool(np.ptp(np.diff(column)) <= _EVEN * abs(np.diff(column).mean()))


def _parts(raw: RawTable, options: ImportOptions) -> tuple[FloatArray, str | None, str, FloatArray, list[int], bool]:
    """Axis across, its unit, the corner, the rest with its line numbers, and whether the axis stands in a header."""
    headers = options.column_names or raw.headers
    if headers and len(headers) == raw.numbers.shape[1]:
        labels = axis_labels(headers[1:], raw.decimal)
        if labels is not None:
            return labels[0], labels[1], headers[0][:_LONGEST_CORNER], raw.numbers, list(raw.lines), True
    if raw.numbers.shape[0] < 2 or raw.numbers.shape[1] < 2:
        raise TableError(
            f"{raw.source} as a matrix needs at least two rows and two columns; it is {raw.numbers.shape}."
        )
    corner = raw.texts[0][0]
    named = bool(corner) and not looks_numeric(corner)
    return raw.numbers[0, 1:], None, corner[:_LONGEST_CORNER], raw.numbers[1:], list(raw.lines[1:]), named


def _first_column(
    options: ImportOptions, across: FloatArray, down: FloatArray, label_unit: str | None, corner: str
) -> tuple[str, str]:
    if options.matrix_rows != "auto":
        return options.matrix_rows, "as given"
    if label_unit:
        return ("distance" if _axis_of(label_unit) == "current" else "current"), f"the first row is in {label_unit}"
    first = parse_header(re.split(r"[\\/|]", corner)[0]) if corner else None
    reason = f"the corner says {quoted(corner)}"
    if first is not None and first.unit and _axis_of(first.unit):
        return str(_axis_of(first.unit)), reason
    for axis in ("distance", "current"):
        if first is not None and first.name in names_of(QUANTITIES[axis]):
            return axis, reason
    if (down == 0).any() and not (across == 0).any() and options.distance_start_m is None:
        return "current", "a distance cannot be zero, the first column is; --matrix-rows distance if not"
    return "distance", "the usual order; --matrix-rows current if not"


def _axis_of(unit: str) -> str | None:
    return next((axis for axis in ("current", "distance") if unit_factor(unit, si_unit(axis)) is not None), None)


def _monotone(axis: FloatArray) -> bool:
    steps = np.diff(axis)
    return bool(len(axis) > 1 and np.isfinite(axis).all() and ((steps > 0).all() or (steps < 0).all()))


def _is_axis(axis: FloatArray) -> bool:
    """Whether numbers are such as people set: of at most four digits, or even between two such numbers."""
    short = np.array([float(f"{value:.4g}") == float(f"{value:.9g}") for value in axis])
    steps = np.diff(axis)
    even = float(np.ptp(steps)) <= 1e-4 * abs(float(steps.mean()))
    return bool(short.all() or (even and short[0] and short[-1]))
