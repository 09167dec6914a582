"""Matrix tables force(distance, current): axis vectors in the first row and column."""

import re

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.tables.foreign.mapping import ColumnUse, unit_use
from femfit.tables.foreign.number_text import looks_numeric, parse_number
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.quantities import QUANTITIES
from femfit.tables.foreign.raw_table import RawTable
from femfit.tables.header import parse_header
from femfit.tables.units import unit_factor

_LABEL = re.compile(
    r"(?P<name>[^\d+\-.,=@]*)[=@_\s]*(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s*\[?\(?(?P<unit>[^\d\W]*)\]?\)?$"
)


def axis_labels(cells: tuple[str, ...], decimal: str) -> tuple[FloatArray, str | None] | None:
    """Numbers of column headers such as ``0.2``, ``0,2 A``, ``I=0.2``, ``F @ 0.2 A``.

    Returns
    -------
    (ndarray, str or None) or None
        The axis and its unit; None unless every cell is such a label and they go strictly up or down.
    """
    found = [_LABEL.match(cell.strip()) for cell in cells]
    values, units = [], set()
    for cell, match in zip(cells, found, strict=True):
        if match is None:
            return None
        words = parse_header(match.group("name")).words
        allowed = {*QUANTITIES["current"].names, *QUANTITIES["distance"].names, *QUANTITIES["force"].names}
        unit = match.group("unit") or None
        if any(word not in allowed for word in words) or (unit and not _axis_of(unit)):
            return None
        values.append(parse_number(cell if looks_numeric(cell) else match.group("number"), decimal))
        units.add(unit)
    axis = np.array(values)
    if len(axis) < 2 or len(units) != 1 or not _monotone(axis):
        return None
    return axis, units.pop()


def is_matrix(raw: RawTable, options: ImportOptions) -> bool:
    """Whether a table is a matrix with axes.

    Parameters
    ----------
    options : ImportOptions
        ``form`` decides if it is given.

    Returns
    -------
    bool
        True if the header row holds an axis, or if a table without header has both axes and a corner that is empty,
        text or zero (otherwise it might as well be distance, current, force at one current).
    """
    if options.form != "auto":
        return options.form == "matrix"
    if options.column_names or raw.numbers.shape[1] < 3:
        return False
    if raw.headers:
        return axis_labels(raw.headers[1:], raw.decimal) is not None
    values = raw.numbers
    if values.shape[0] < 3 or not (np.isnan(values[0, 0]) or values[0, 0] == 0):
        return False
    return _monotone(values[0, 1:]) and _monotone(values[1:, 0])


def matrix_points(raw: RawTable, options: ImportOptions) -> tuple[pd.DataFrame, dict[str, ColumnUse], list[str]]:
    """One row a point from a matrix.

    Returns
    -------
    points : DataFrame
        ``current``, ``distance``, ``force`` in SI (distance before start and step), ``source``, ``line``.

    Raises
    ------
    TableError
        If an axis is no axis.
    """
    across, label_unit, corner, body, lines = _parts(raw)
    down = body[:, 0]
    if not _monotone(down) or not _monotone(across):
        raise TableError(
            f"{raw.source} as a matrix must have axes that go strictly up or down in its first row and column. "
            "For one row a point give --form long."
        )
    rows, why = _first_column(options, across, down, label_unit, corner)
    corner_unit = parse_header(corner).unit
    units: dict[str, str | None] = {"current": None, "distance": None}
    units[rows] = corner_unit if corner_unit and _axis_of(corner_unit) == rows else None
    columns = "current" if rows == "distance" else "distance"
    units[columns] = label_unit if label_unit and _axis_of(label_unit) == columns else None
    force_unit = None
    for word in re.findall(r"[\[(]([^\])]*)[\])]", corner):
        axis = _axis_of(word)
        if axis and units[axis] is None:
            units[axis] = word
        elif unit_factor(word, QUANTITIES["force"].si_unit) is not None:
            force_unit = word
    uses = {
        rows: unit_use(rows, "first column", units[rows], raw.source, options),
        columns: unit_use(columns, "first row", units[columns], raw.source, options),
        "force": unit_use("force", "matrix", force_unit, raw.source, options),
    }
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
    return points, uses, [f"{raw.source} read as a matrix: {rows} down, {columns} across ({why})"]


def _parts(raw: RawTable) -> tuple[FloatArray, str | None, str, FloatArray, list[int]]:
    if raw.headers:
        labels = axis_labels(raw.headers[1:], raw.decimal)
        if labels is not None:
            return labels[0], labels[1], raw.headers[0], raw.numbers, list(raw.lines)
    if raw.numbers.shape[0] < 2 or raw.numbers.shape[1] < 2:
        raise TableError(
            f"{raw.source} as a matrix needs at least two rows and two columns; it is {raw.numbers.shape}."
        )
    return raw.numbers[0, 1:], None, raw.cells[0][0], raw.numbers[1:], list(raw.lines[1:])


def _first_column(
    options: ImportOptions, across: FloatArray, down: FloatArray, label_unit: str | None, corner: str
) -> tuple[str, str]:
    if options.matrix_rows != "auto":
        return options.matrix_rows, "as given"
    if label_unit:
        return ("distance" if _axis_of(label_unit) == "current" else "current"), f"the first row is in {label_unit}"
    first = parse_header(re.split(r"[\\/|]", corner)[0]) if corner else None
    if first is not None and first.unit and _axis_of(first.unit):
        return str(_axis_of(first.unit)), f"the corner says {corner}"
    if first is not None and first.words:
        for axis in ("distance", "current"):
            if "".join(first.words) in QUANTITIES[axis].names:
                return axis, f"the corner says {corner}"
    if (down == 0).any() and not (across == 0).any() and options.distance_start_m is None:
        return "current", "a distance cannot be zero, the first column is; --matrix-rows distance if not"
    return "distance", "the usual order; --matrix-rows current if not"


def _axis_of(unit: str) -> str | None:
    for axis in ("current", "distance"):
        if unit_factor(unit, QUANTITIES[axis].si_unit) is not None:
            return axis
    return None


def _monotone(axis: FloatArray) -> bool:
    steps = np.diff(axis)
    return bool(len(axis) > 1 and np.isfinite(axis).all() and ((steps > 0).all() or (steps < 0).all()))
