"""``femfit import``: the tables that FEMM users have, to a sweep table."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import (
    NO_TABLE_OPTIONS,
    OUTPUT,
    Outcome,
    TableOptions,
    Writes,
    command,
    in_si,
    names_of,
)
from femfit.core.files import MANIFEST, SWEEP


@Parameter(name="*")
@dataclass(frozen=True)
class ImportOptions:
    """How a table is read, and what belongs to it.

    Attributes
    ----------
    matrix_rows : str
        Quantity in the first column of a matrix force(distance, current) with its axes.
    decimal : str
        Decimal mark of the numbers.
    distance_start_mm : float
        Distance in mm at position (or step) zero.
    keep_force : bool
        Force with the sign that it has.
    actuator : Path
        Actuator file whose circuit, motion and sensor go into the manifest.
    """

    matrix_rows: Literal["auto", "distance", "current"] = "auto"
    decimal: Literal[".", ","] | None = None
    distance_start_mm: float | None = None
    keep_force: bool = False
    actuator: Path | None = None


_DEFAULTS = ImportOptions()


@command("File for mapping and findings as JSON.")
def import_table(
    tables: tuple[Path, ...],
    *,
    output: Annotated[
        Path, OUTPUT, Writes(SWEEP, "sweep.parquet"), Writes(SWEEP, "sweep.csv"), Writes(MANIFEST, "manifest.json")
    ],
    table_options: TableOptions = NO_TABLE_OPTIONS,
    without: str | None = None,
    columns: str | None = None,
    accept: str | None = None,
    options: ImportOptions = _DEFAULTS,
) -> Outcome:
    """Bring in a table of FEMM or another program: recognise, convert to SI, check, write as a sweep table.

    Parameters
    ----------
    tables : tuple of Path
        Files (text, Parquet, XLSX, MAT, HDF5 or TDMS), or directories of them with one file a current, named as in
        force_0.4A.csv.
    output : Path
        Directory of the sweep table.
    without : str
        Quantities to leave out, separated by commas: flux_linkage, inductance, hall, coenergy.
    columns : str
        Names of the columns of a table without header, separated by commas; of a matrix, its first row with units.
    accept : str
        Codes of errors that shall not stop the import, separated by commas.
    """
    from femfit.tables.sweep_table import write_sweep_table

    imported = ff.import_table(
        tables,
        without=names_of(without),
        accept=names_of(accept),
        column_names=tuple(word.strip() for word in columns.split(",")) if columns else (),  # an empty one counts
        **in_si(options),
        **table_options.keywords,
    )
    table = write_sweep_table(imported, output)
    return Outcome(f"{imported}\nwritten: {table}", imported.manifest)
