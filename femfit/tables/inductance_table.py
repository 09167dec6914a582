"""A table of measured inductances: one row a current step, at a clamped distance."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.tables.measurement_cells import cell_numbers, read_cells
from femfit.tables.measurement_columns import match_column, recognise

COLUMNS = ("distance_m", "current_A", "inductance_H")
"""Of the table; ``inductance_H`` is flux linkage over current, as a step from zero to ``current_A`` shows it."""

_OTHER_KIND = ("force_N", "flux_linkage_Wb")


@dataclass(frozen=True, eq=False)
class InductanceTable:
    """Measured inductances, each array of shape (n,).

    Parameters
    ----------
    findings : tuple of str
        What was left out or converted, one plain sentence each.
    """

    distance: FloatArray
    current: FloatArray
    inductance: FloatArray
    findings: tuple[str, ...] = ()
    source: str = "inductances"


def is_inductance_table(path: Path) -> bool:
    """Whether a file holds inductances and no forces.

    Returns
    -------
    bool
        False for a directory, and where there is no such file.
    """
    if not path.is_file() or path.suffix not in {".csv", ".parquet"}:
        return False
    headers = [str(header) for header in read_cells(path).columns]
    found = {column.name for header in headers if (column := match_column(header, (*COLUMNS, *_OTHER_KIND))[0])}
    return "inductance_H" in found and not found & set(_OTHER_KIND)


def read_inductance_table(path: Path) -> InductanceTable:
    """Read measured inductances.

    Parameters
    ----------
    path : Path
        ``.csv`` or ``.parquet`` with :data:`COLUMNS`, or with their units otherwise (``distance_mm, inductance_mH``).

    Raises
    ------
    TableError
        If a column is missing, or no row is usable.
    """
    raw = read_cells(path)
    used, findings = recognise(map(str, raw.columns), str(path), COLUMNS)
    values: dict[str, FloatArray] = {}
    for one in used:
        values[one.name], said = cell_numbers(raw[one.header], one)
        findings += said
    missing = [name for name in COLUMNS if name not in values]
    if missing:
        raise TableError(
            f"An inductance table must have {', '.join(COLUMNS)}; {path} lacks {', '.join(missing)} (it has "
            f"{', '.join(map(str, raw.columns))}). Rename the columns or add them."
        )
    d, i, inductance = (values[name] for name in COLUMNS)
    usable = np.isfinite(d + i + inductance) & (d >= 0.0) & (i != 0.0) & (inductance > 0.0)
    if not usable.any():
        raise TableError(f"{path} has no row with distance >= 0, a current and an inductance > 0.")
    if not usable.all():
        findings.append(f"{int((~usable).sum())} rows without distance >= 0, current and inductance > 0 were left out.")
    return InductanceTable(d[usable], i[usable], inductance[usable], tuple(findings), path.name)
