"""``femfit import``: the tables that FEMM users have, to a sweep table."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from femfit.cli.table_options import NO_TABLE_OPTIONS, TableOptions


def import_table(
    tables: Annotated[tuple[Path, ...], Parameter(negative=())],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    table_options: TableOptions = NO_TABLE_OPTIONS,
    without: str | None = None,
    columns: str | None = None,
    form: Literal["auto", "long", "matrix"] = "auto",
    matrix_rows: Literal["auto", "distance", "current"] = "auto",
    decimal: Literal[".", ","] | None = None,
    delimiter: str | None = None,
    encoding: str | None = None,
    file_current_A: Annotated[str | None, Parameter(name="--file-current-A")] = None,
    file_distance_mm: str | None = None,
    distance_step_mm: float | None = None,
    distance_start_mm: float | None = None,
    flip_distance: Annotated[bool, Parameter(negative=())] = False,
    flip_current: Annotated[bool, Parameter(negative=())] = False,
    flip_force: Annotated[bool, Parameter(negative=())] = False,
    keep_force: Annotated[bool, Parameter(negative=())] = False,
    accept: str | None = None,
    actuator: Path | None = None,
    json: Path | None = None,
) -> None:
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
    form : str
        Form of the table: one row a point (long), or force(distance, current) with its axes (matrix).
    matrix_rows : str
        Quantity in the first column of a matrix.
    decimal : str
        Decimal mark of the numbers.
    delimiter : str
        Delimiter of the columns: one character, or the word blanks or tab.
    encoding : str
        Encoding of the text, by its name in Python.
    file_current_A : str
        Current of each file in A, separated by commas.
    file_distance_mm : str
        Distance of each file in mm, separated by commas.
    distance_step_mm : float
        Size of a step in mm, for a distance column that counts steps.
    distance_start_mm : float
        Distance in mm at position (or step) zero.
    flip_distance : bool
        Positions that count towards the electromagnet, turned round.
    flip_current : bool
        Current and flux linkage with the other sign.
    flip_force : bool
        Force with the other sign.
    keep_force : bool
        Force with the sign that it has.
    accept : str
        Codes of errors that shall not stop the import, separated by commas.
    actuator : Path
        Actuator file whose circuit, motion and sensor go into the manifest.
    json : Path
        File for mapping and findings as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.errors import UsageError
    from femfit.core.files import MANIFEST, RESULT, SWEEP, require_outputs
    from femfit.tables import foreign as read
    from femfit.tables.sweep_table import write_sweep_table

    written = (output / name for name in ("sweep.parquet", "sweep.csv", "manifest.json"))
    require_outputs([*tables, actuator], *zip(written, (SWEEP, SWEEP, MANIFEST), strict=True), (json, RESULT))
    if flip_force and keep_force:
        raise UsageError("--flip-force and --keep-force exclude each other; give one of them.")
    imported = read.import_table(
        tables,
        actuator=actuator,
        columns=table_options.columns,
        units=table_options.units,
        table=table_options.table,
        column_names=_words(columns),
        form=form,
        matrix_rows=matrix_rows,
        decimal=decimal,
        delimiter={"tab": "\t", "blanks": " "}.get(delimiter, delimiter) if delimiter else None,
        encoding=encoding,
        file_currents_A=_numbers(file_current_A, "--file-current-A"),
        file_distances_m=tuple(1e-3 * value for value in _numbers(file_distance_mm, "--file-distance-mm")),
        distance_step_m=None if distance_step_mm is None else 1e-3 * distance_step_mm,
        distance_start_m=None if distance_start_mm is None else 1e-3 * distance_start_mm,
        flip_distance=flip_distance,
        flip_current=flip_current,
        force_sign="flip" if flip_force else "keep" if keep_force else "auto",
        without=_words(without),
        accept=_words(accept),
    )
    table = write_sweep_table(imported, output)
    print(imported)
    print(f"written: {table}")
    write_json(json, imported.manifest)


def _words(text: str | None) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",")) if text else ()


def _numbers(text: str | None, option: str) -> tuple[float, ...]:
    from femfit.core.errors import UsageError

    try:
        return tuple(float(word) for word in _words(text))
    except ValueError as error:
        raise UsageError(f"{option} must be numbers separated by commas; instead received {text!r}.") from error
