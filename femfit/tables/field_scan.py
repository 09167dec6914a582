"""A probe scan: the field at places beside an actuator, one row a reading."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.tables.findings import finding
from femfit.tables.header import parse_header
from femfit.tables.measured_columns import read_columns, read_raw_table

PLACE = ("r_m", "z_m")
COLUMNS = ("distance_m", "current_A", *PLACE, "field_T")
"""Of the table: the place of the probe in the drawing's coordinates, and the axial field that it reads."""

_NEEDED = ("distance_m", *PLACE, "field_T")


@dataclass(frozen=True, eq=False)
class FieldScan:
    """Readings of an axial field, each array of shape (n,), in SI."""

    distance: FloatArray
    current: FloatArray
    radius: FloatArray
    height: FloatArray
    field: FloatArray
    findings: tuple[Finding, ...] = ()
    source: str = "scan"


def read_field_scan(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
) -> FieldScan:
    """Read a probe scan: ``distance_mm, current_A, r_mm, z_mm, field_mT`` or other units of the same columns.

    Without a column ``current_A`` no current flows. Rows in which a number is missing are left out.
    """
    path = Path(path)
    raw = read_raw_table(path, table=table)
    # A bench calls its distance z as well; beside a probe's radius z is the probe's.
    places = {header: f"{name}_m" for header in raw.headers if (name := parse_header(header).name) in {"r", "z"}}
    rows, _, findings = read_columns(raw, COLUMNS, {**places, **(columns or {})}, units)
    missing = [name for name in _NEEDED if name not in rows]
    if missing:
        raise TableError(
            f"A probe scan must have {', '.join(_NEEDED)}, in any unit; {path} lacks {', '.join(missing)}. Rename the "
            f"columns, or say what one is with --column HEADER={missing[0]}."
        )
    rows = rows.assign(current_A=rows.get("current_A", 0.0))
    values = [rows[name].to_numpy(dtype=np.float64) for name in COLUMNS]
    usable = np.isfinite(np.sum(values, axis=0))
    if not usable.any():
        raise TableError(f"{path} has no row with distance, place and field in it.")
    if not usable.all():
        lost = int((~usable).sum())
        findings.append(finding("cells without", size=float(lost), rows=lost, columns="distance, place and field"))
    distance, current, radius, height, field = (column[usable] for column in values)
    return FieldScan(distance, current, radius, height, field, tuple(findings), path.name)
