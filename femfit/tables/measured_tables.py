"""Small measured tables, each a record of columns: a probe scan of the field, and inductances at clamped distances."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.tables.columns import match_column
from femfit.tables.findings import finding
from femfit.tables.header import parse_header
from femfit.tables.measurement_sidecar import Words
from femfit.tables.reading import Wants, read_columns, read_raw_table
from femfit.tables.table_file import SUFFIXES

PLACE = ("r_m", "z_m")
"""Of a probe, in the drawing's coordinates."""

_SCAN = Wants("probe scan", ("distance_m", "current_A", *PLACE, "field_T"), needs=("distance_m", *PLACE, "field_T"))
_COLUMNS = ("distance_m", "current_A", "inductance_H")
_INDUCTANCES = Wants("inductance table", _COLUMNS, needs=_COLUMNS, renamed=True)

_OF_SWEEPS = ("force_N", "flux_linkage_Wb")
"""Columns of a table that is fitted by its forces."""


@dataclass(frozen=True, eq=False)
class FieldScan:
    """Readings of an axial field beside an actuator, each array of shape (n,), in SI."""

    distance: FloatArray
    current: FloatArray
    radius: FloatArray
    height: FloatArray
    field: FloatArray
    findings: tuple[Finding, ...] = ()
    source: str = "scan"


@dataclass(frozen=True, eq=False)
class InductanceTable:
    """Measured inductances, each array of shape (n,), in SI.

    An inductance is flux linkage over current, as a step from zero to that current shows it.
    """

    distance: FloatArray
    current: FloatArray
    inductance: FloatArray
    findings: tuple[Finding, ...] = ()
    source: str = "inductances"


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
    path, words = Path(path), Words(columns or {}, units or {}, table)
    raw = read_raw_table(path, words=words)
    # A bench calls its distance z as well; beside a probe's radius z is the probe's.
    places = {header: f"{name}_m" for header in raw.headers if (name := parse_header(header).name) in {"r", "z"}}
    scan = read_columns(raw, _SCAN, replace(words, columns={**places, **words.columns}))
    rows = scan.rows.assign(current_A=scan.rows.get("current_A", 0.0))
    arrays = [rows[name].to_numpy(dtype=np.float64) for name in _SCAN.names]
    usable, findings = _usable(np.isfinite(np.sum(arrays, axis=0)), path, "distance, place and field")
    distance, current, radius, height, field = (column[usable] for column in arrays)
    return FieldScan(distance, current, radius, height, field, (*scan.findings, *findings), path.name)


def is_inductance_table(path: Path) -> bool:
    """Tell whether a file holds inductances and no forces; False for a directory, and where there is no such file."""
    if not path.is_file() or path.suffix not in SUFFIXES:
        return False
    try:
        headers = read_raw_table(path, kinds=(_INDUCTANCES,)).headers
    except TableError:
        return False
    names = {column.name for header in headers if (column := match_column(header, (*_COLUMNS, *_OF_SWEEPS)))}
    return "inductance_H" in names and names.isdisjoint(_OF_SWEEPS)


def read_inductance_table(
    path: Path, *, columns: Mapping[str, str] | None = None, units: Mapping[str, str | float] | None = None
) -> InductanceTable:
    """Read measured inductances: ``distance_m, current_A, inductance_H``, in these or other units."""
    words = Words(columns or {}, units or {})
    table = read_columns(read_raw_table(path, kinds=(_INDUCTANCES,), words=words), _INDUCTANCES, words)
    d, i, inductance = (table.rows[name].to_numpy() for name in _COLUMNS)
    good = np.isfinite(d + i + inductance) & (d >= 0.0) & (i != 0.0) & (inductance > 0.0)
    usable, findings = _usable(good, path, "distance >= 0, current and inductance > 0")
    return InductanceTable(d[usable], i[usable], inductance[usable], (*table.findings, *findings), path.name)


def _usable(good: BoolArray, path: Path, needed: str) -> tuple[BoolArray, Sequence[Finding]]:
    """The rows that have what is needed, and how many were left out."""
    if not good.any():
        raise TableError(f"{path} has no row with {needed} in it.")
    lost = int((~good).sum())
    return good, [finding("cells without", size=float(lost), rows=lost, columns=needed)] if lost else []
