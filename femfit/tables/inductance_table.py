"""A table of measured inductances: one row a current step, at a clamped distance."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from femfit.core.amount import counted
from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding, listing
from femfit.tables.columns import match_column
from femfit.tables.measured_columns import has_columns, read_columns, read_raw_table
from femfit.tables.table_file import SUFFIXES

COLUMNS = ("distance_m", "current_A", "inductance_H")
"""Of the table; ``inductance_H`` is flux linkage over current, as a step from zero to ``current_A`` shows it."""

_OTHER_KIND = ("force_N", "flux_linkage_Wb")


@dataclass(frozen=True, eq=False)
class InductanceTable:
    """Measured inductances, each array of shape (n,), in SI."""

    distance: FloatArray
    current: FloatArray
    inductance: FloatArray
    findings: tuple[Finding, ...] = ()
    source: str = "inductances"


def is_inductance_table(path: Path) -> bool:
    """Tell whether a file holds inductances and no forces; False for a directory, and where there is no such file."""
    if not path.is_file() or path.suffix not in SUFFIXES:
        return False
    try:
        headers = read_raw_table(path, wanted=has_columns([frozenset(COLUMNS)])).headers
    except TableError:
        return False
    names = {column.name for header in headers if (column := match_column(header, (*COLUMNS, *_OTHER_KIND)))}
    return "inductance_H" in names and not names & set(_OTHER_KIND)


def read_inductance_table(
    path: Path, *, columns: Mapping[str, str] | None = None, units: Mapping[str, str | float] | None = None
) -> InductanceTable:
    """Read measured inductances; columns as in :data:`COLUMNS` or in other units (``distance_mm, inductance_mH``)."""
    raw = read_raw_table(path, wanted=has_columns([frozenset(COLUMNS)], columns, units))
    rows, _, findings = read_columns(raw, COLUMNS, columns, units)
    missing = [name for name in COLUMNS if name not in rows]
    if missing:
        raise TableError(
            f"An inductance table must have {', '.join(COLUMNS)}; {path} lacks {', '.join(missing)} (it has "
            f"{listing(raw.headers)}). Rename the columns or add them."
        )
    d, i, inductance = (rows[name].to_numpy() for name in COLUMNS)
    usable = np.isfinite(d + i + inductance) & (d >= 0.0) & (i != 0.0) & (inductance > 0.0)
    if not usable.any():
        raise TableError(f"{path} has no row with distance >= 0, a current and an inductance > 0.")
    if not usable.all():
        text = f"{counted(int((~usable).sum()), 'row')} without distance >= 0, current and inductance > 0 left out."
        findings.append(Finding("cells", "info", text, size=float((~usable).sum())))
    return InductanceTable(d[usable], i[usable], inductance[usable], tuple(findings), path.name)
