"""``femfit import``: the tables that FEMM users have, to a sweep table."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, TableOptions, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.files import MANIFEST, SWEEP

_OPTIONS = Keywords(
    "femfit.tables.foreign_forms:ImportOptions",
    "without accept matrix_rows decimal distance_start_m=distance-start-mm keep_force",
)


@command("File for mapping and findings as JSON.")
def import_table(
    tables: tuple[Path, ...],
    *,
    output: Annotated[
        Path, OUTPUT, Writes(SWEEP, "sweep.parquet"), Writes(SWEEP, "sweep.csv"), Writes(MANIFEST, "manifest.json")
    ],
    table_options: TableOptions,
    columns: str | None = None,
    options: Annotated[dict[str, Any], _OPTIONS],
    actuator: Path | None = None,
) -> Outcome:
    """Bring in a table of FEMM or another program as a sweep table.

    Parameters
    ----------
    tables : tuple of Path
        Files (text, Parquet, XLSX, MAT, HDF5 or TDMS), or directories of them with one file a current, named as in
        force_0.4A.csv.
    output : Path
        Directory of the sweep table.
    columns : str
        Names of the columns of a table without header, separated by commas; of a matrix, its first row with units.
    actuator : Path
        Actuator file whose circuit, motion and sensor go into the manifest.
    """
    from femfit.tables.sweep_table import write_sweep_table

    imported = ff.import_table(
        tables,
        actuator=actuator,
        column_names=tuple(word.strip() for word in columns.split(",")) if columns else (),  # an empty one counts
        **options,
        **table_options,
    )
    table = write_sweep_table(imported, output)
    return Outcome(f"{imported}\nwritten: {table}", imported.manifest)
