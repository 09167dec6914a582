"""``femfit import``: the tables that FEMM users have, to a sweep table."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from femfit.tables.foreign.read import ImportedTable


def import_table(
    tables: Annotated[tuple[Path, ...], Parameter(negative=())],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    current_column: str | None = None,
    distance_column: str | None = None,
    force_column: str | None = None,
    flux_linkage_column: str | None = None,
    inductance_column: str | None = None,
    hall_column: str | None = None,
    coenergy_column: str | None = None,
    current_unit: str | None = None,
    distance_unit: str | None = None,
    force_unit: str | None = None,
    flux_linkage_unit: str | None = None,
    inductance_unit: str | None = None,
    hall_unit: str | None = None,
    coenergy_unit: str | None = None,
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
        CSV, text or Parquet files, or directories of them (one file a current, named as in force_0.4A.csv).
    output : Path
        Directory of the sweep table.
    current_column : str
        Header of the coil current, where it is not recognised.
    distance_column : str
        Header of the distance, gap or position, where it is not recognised.
    force_column : str
        Header of the force, where it is not recognised.
    flux_linkage_column : str
        Header of the flux linkage, where it is not recognised.
    inductance_column : str
        Header of the inductance, where it is not recognised.
    hall_column : str
        Header of the field at the Hall element, where it is not recognised.
    coenergy_column : str
        Header of the co-energy, where it is not recognised.
    current_unit : str
        A, mA... or a number that multiplies the column to SI.
    distance_unit : str
        m, mm, cm, inch... or a number that multiplies the column to SI.
    force_unit : str
        N, mN, lbf, gf... or a number that multiplies the column to SI.
    flux_linkage_unit : str
        Wb, mWb, uWb, Mx... or a number that multiplies the column to SI.
    inductance_unit : str
        H, mH, uH... or a number that multiplies the column to SI.
    hall_unit : str
        T, mT, G... or a number that multiplies the column to SI.
    coenergy_unit : str
        J, mJ... or a number that multiplies the column to SI.
    without : str
        Quantities to leave out, separated by commas: flux_linkage, inductance, hall, coenergy.
    columns : str
        Names of the columns of a table without header, separated by commas.
    form : str
        One row a point (long), or force(distance, current) with its axes (matrix).
    matrix_rows : str
        What the first column of a matrix holds.
    decimal : str
        Decimal mark.
    delimiter : str
        One character, or the word blanks or tab.
    encoding : str
        Python's name of the encoding.
    file_current_A : str
        Current of each file, separated by commas.
    file_distance_mm : str
        Distance of each file, separated by commas.
    distance_step_mm : float
        Size of a step, for a distance column that counts steps.
    distance_start_mm : float
        Distance at position (or step) zero.
    flip_distance : bool
        Positions count towards the electromagnet.
    flip_current : bool
        Negate current and flux linkage.
    flip_force : bool
        Negate the force.
    keep_force : bool
        Leave the sign of the force as it is.
    accept : str
        Codes of errors that shall not stop the import, separated by commas.
    actuator : Path
        Actuator file whose circuit, motion and sensor go into the manifest.
    json : Path
        File for mapping and findings as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.errors import TableError
    from femfit.core.outputs import MANIFEST, PARQUET, RESULT, TABLE, require_outputs
    from femfit.device.load import read_actuator
    from femfit.device.summary import sweep_manifest_entry
    from femfit.tables.foreign.options import ImportOptions
    from femfit.tables.foreign.read import read_foreign_table, with_actuator
    from femfit.tables.sweep_table import write_sweep_table

    written = (output / name for name in ("sweep.parquet", "sweep.csv", "manifest.json"))
    require_outputs([*tables, actuator], *zip(written, (PARQUET, TABLE, MANIFEST), strict=True), (json, RESULT))
    if flip_force and keep_force:
        raise TableError("--flip-force and --keep-force exclude each other; give one of them.")
    given_columns = {
        "current": current_column,
        "distance": distance_column,
        "force": force_column,
        "flux_linkage": flux_linkage_column,
        "inductance": inductance_column,
        "hall": hall_column,
        "coenergy": coenergy_column,
    }
    given_units = {
        "current": current_unit,
        "distance": distance_unit,
        "force": force_unit,
        "flux_linkage": flux_linkage_unit,
        "inductance": inductance_unit,
        "hall": hall_unit,
        "coenergy": coenergy_unit,
    }
    options = ImportOptions(
        columns={name: column for name, column in given_columns.items() if column is not None},
        units={name: unit for name, unit in given_units.items() if unit is not None},
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
    entry = sweep_manifest_entry(read_actuator(actuator)) if actuator else None
    imported = read_foreign_table(tables, options)
    if entry is not None:
        imported = with_actuator(imported, entry)
    table = write_sweep_table(imported.table, output)
    print("\n".join(_lines(imported)))
    print(f"written: {table}")
    write_json(json, imported.table.manifest)


def _words(text: str | None) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",")) if text else ()


def _numbers(text: str | None, option: str) -> tuple[float, ...]:
    from femfit.core.errors import TableError

    try:
        return tuple(float(word) for word in _words(text))
    except ValueError as error:
        raise TableError(f"{option} must be numbers separated by commas; instead received {text!r}.") from error


def _lines(imported: "ImportedTable") -> Sequence[str]:
    """The result in plain words."""
    from femfit.tables.foreign.quantities import QUANTITIES

    rows = imported.table.valid_rows()
    current, distance = rows["current_A"], 1e3 * rows["distance_m"]
    lines = [
        (
            f"{len(rows)} points: {current.nunique()} currents {current.min():g} to {current.max():g} A, "
            f"{distance.nunique()} distances {distance.min():g} to {distance.max():g} mm"
        ),
        *(f"{name}: read as {dialect}" for name, dialect in list(imported.dialects.items())[:3]),
    ]
    if len(imported.dialects) > 3:
        lines.append(f"... and {len(imported.dialects) - 3} more files")
    for use in imported.mapping:
        unit = f"{use.unit}{' (assumed)' if use.assumed else ''}"
        lines.append(f"  {QUANTITIES[use.quantity].column} from {use.header}, in {unit}, times {use.factor:g}")
    for finding in imported.findings:
        mark = "" if finding.severity == "info" else f"{finding.severity}: "
        lines.append(f"- {mark}{finding.text} {finding.remedy}".rstrip())
    return lines
