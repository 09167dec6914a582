"""Long tables, one row a point: which column holds what, in which unit."""

from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.amount import counted
from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding, listing
from femfit.core.quoted import quoted
from femfit.tables.column_names import STEP_NAMES
from femfit.tables.columns import UsedColumn, match_columns
from femfit.tables.foreign.options import QUANTITIES, REQUIRED, ImportOptions, si_unit
from femfit.tables.header import parse_header
from femfit.tables.raw_table import RawTable

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
    findings = [finding for finding in findings if quantities.get(finding.column) not in options.without]
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
