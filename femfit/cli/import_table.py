"""``femfit import``: the tables that FEMM users have, to a sweep table."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import (
    FLAG,
    NO_TABLE_OPTIONS,
    OUTPUT,
    Outcome,
    TableOptions,
    Writes,
    command,
    in_si,
    names_of,
    parsed,
)
from femfit.core.errors import UsageError
from femfit.core.files import MANIFEST, SWEEP


@Parameter(name="*")
@dataclass(frozen=True)
class ImportOptions:
    """How a table is read, and what belongs to it.

    Attributes
    ----------
    form : str
        Form of the table: one row a point (long), or force(distance, current) with its axes (matrix).
    matrix_rows : str
        Quantity in the first column of a matrix.
    decimal : str
        Decimal mark of the numbers.
    encoding : str
        Encoding of the text, by its name in Python.
    distance_step_mm : float
        Size of a step in mm, for a distance column that counts steps.
    distance_start_mm : float
        Distance in mm at position (or step) zero.
    flip_distance : bool
        Positions that count towards the electromagnet, turned round.
    flip_current : bool
        Current and flux linkage with the other sign.
    actuator : Path
        Actuator file whose circuit, motion and sensor go into the manifest.
    """

    form: Literal["auto", "long", "matrix"] = "auto"
    matrix_rows: Literal["auto", "distance", "current"] = "auto"
    decimal: Literal[".", ","] | None = None
    encoding: str | None = None
    distance_step_mm: float | None = None
    distance_start_mm: float | None = None
    flip_distance: Annotated[bool, FLAG] = False
    flip_current: Annotated[bool, FLAG] = False
    actuator: Path | None = None


_DEFAULTS = ImportOptions()


@command("File for mapping and findings as JSON.")
def import_table(
    tables: Annotated[tuple[Path, ...], FLAG],
    *,
    output: Annotated[
        Path, OUTPUT, Writes(SWEEP, "sweep.parquet"), Writes(SWEEP, "sweep.csv"), Writes(MANIFEST, "manifest.json")
    ],
    table_options: TableOptions = NO_TABLE_OPTIONS,
    without: str | None = None,
    columns: str | None = None,
    delimiter: str | None = None,
    file_current_A: Annotated[str | None, Parameter(name="--file-current-A")] = None,
    file_distance_mm: str | None = None,
    flip_force: Annotated[bool, FLAG] = False,
    keep_force: Annotated[bool, FLAG] = False,
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
    delimiter : str
        Delimiter of the columns: one character, or the word blanks or tab.
    file_current_A : str
        Current of each file in A, separated by commas.
    file_distance_mm : str
        Distance of each file in mm, separated by commas.
    flip_force : bool
        Force with the other sign.
    keep_force : bool
        Force with the sign that it has.
    accept : str
        Codes of errors that shall not stop the import, separated by commas.
    """
    from femfit.tables.sweep_table import write_sweep_table

    if flip_force and keep_force:
        raise UsageError("--flip-force and --keep-force exclude each other; give one of them.")
    imported = ff.import_table(
        tables,
        force_sign="flip" if flip_force else "keep" if keep_force else "auto",
        without=names_of(without),
        accept=names_of(accept),
        column_names=tuple(word.strip() for word in columns.split(",")) if columns else (),  # an empty one counts
        delimiter={"tab": "\t", "blanks": " "}.get(delimiter, delimiter) if delimiter else None,
        file_currents_A=_numbers(file_current_A, "--file-current-A"),
        file_distances_m=tuple(1e-3 * value for value in _numbers(file_distance_mm, "--file-distance-mm")),
        **in_si(options),
        **table_options.keywords,
    )
    table = write_sweep_table(imported, output)
    return Outcome(f"{imported}\nwritten: {table}", imported.manifest)


def _numbers(text: str | None, option: str) -> tuple[float, ...]:
    form = "numbers with commas between them"
    return parsed(text or "", option, form, "0,0.5,1", lambda words: tuple(map(float, names_of(words))))
