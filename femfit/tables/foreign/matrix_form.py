"""Matrix tables force(distance, current): axis vectors in the first row and column."""

import re

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.quoted import quoted
from femfit.tables.column_names import COLUMN_NAMES
from femfit.tables.columns import UsedColumn, used_column
from femfit.tables.foreign.long_form import in_steps
from femfit.tables.foreign.options import QUANTITIES, ImportOptions, si_unit
from femfit.tables.header import parse_header
from femfit.tables.number_text import looks_numeric, parse_number
from femfit.tables.raw_table import RawTable
from femfit.tables.units import unit_factor

_LABEL = re.compile(
    r"(?P<name>[^\d+\-.,=@]{0,80})[=@_\s]{0,9}(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s{0,9}"
    r"\[?\(?(?P<unit>[^\d\W]*)\]?\)?$"
)
_LONGEST_CORNER = 200
_LABEL_WORDS = frozenset(name for axis in ("current", "distance", "force") for name in COLUMN_NAMES[QUANTITIES[axis]])
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
    """Read one row a point from a matrix, as :func:`~femfit.tables.foreign.long_form.long_points` does from a list."""
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
    text = f"{raw.source} was read as a matrix: {rows} down, {columns} across ({why})."
    findings = [Finding("matrix", "info", text)]
    if not named and (not _is_axis(across) or (raw.numbers[0, 0] != 0 and _goes_on(raw.numbers[:, 0]))):
        findings.append(_no_axis(across, columns))
    return points, uses, findings


def _goes_on(column: FloatArray) -> bool:
    """Whether the corner is one more number of the first column, so that the first row is a row like the others."""
    return _monotone(column) and bool(np.ptp(np.diff(column)) <= _EVEN * abs(np.diff(column).mean()))


def _no_axis(across: FloatArray, columns: str) -> Finding:
    shown = ", ".join(f"{value:g}" for value in across[:3])
    return Finding(
        "matrix-axis",
        "error",
        f"The first row ({shown}, ...), which was taken for the {columns}s, looks like a row of forces: its numbers "
        "are neither even nor round, or its first cell goes on as the first column does.",
        "If it is, name the axis: --columns 'd [mm],0 A,0.5 A,1 A'; if it is not, give --accept matrix-axis.",
    )


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
        if first is not None and first.name in COLUMN_NAMES[QUANTITIES[axis]]:
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
