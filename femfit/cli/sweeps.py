"""Tables of the field: ``femfit sweep`` solves one, ``import`` brings one in, ``fit`` makes a model of it."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, Cores, Default, Outcome, TableOptions, Writes, command, run_directory
from femfit.cli.keywords import Keywords
from femfit.cli.output import sentence, sweep_progress
from femfit.core.errors import FieldSolverError, FitError, UsageError
from femfit.core.files import MANIFEST, MODEL, SWEEP

if TYPE_CHECKING:
    from femfit.fit.soft_iron import InductanceFit

_FORM = Keywords(
    "femfit.tables.foreign_forms:ImportOptions",
    "without accept matrix_rows decimal distance_start_m=distance-start-mm keep_force",
)
_FORCES = Keywords("fit_model", "where bounds=bound functions inductance_H")
_DEVICE = Keywords("fit_model", "actuator mass_kg=mass-g resistance_ohm supply_V")
_BESIDE = Default(
    lambda names: (
        (names["table"] if names["table"].is_dir() else names["table"].parent) / f"model_{names['model']}.json"
    )
)


@command("File for a summary as JSON.")
def sweep(
    actuator: Path,
    *,
    output: Annotated[Path, OUTPUT, Default(run_directory("actuator"))],
    workers: Cores,
    signatures: bool = False,
) -> Outcome:
    """Solve the field over an actuator's currents and distances.

    An interrupted sweep goes on where it stopped when the same command is given again.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml).
    output : Path
        Run directory; runs/NAME by default.
    workers : int
        Number of processes on this machine; one a core by default.
    signatures : bool
        Signatures of the drawing's numbers, solved too (about as long again at most), with which a diagnosis asks
        whether one of them is wrong; those in the directory stay without it.
    """
    from time import perf_counter

    from femfit.device.rewrite import read_variants
    from femfit.field.sweep_rows import failed_points, summarise, variants_without_a_point
    from femfit.tables.eddy_table import IMPEDANCES as IMPEDANCE

    variants, start = read_variants(actuator), perf_counter()
    with sweep_progress(variants.actuator.name) as progress:
        table = ff.run_sweep(actuator, output, workers=workers, signatures=signatures, progress=progress)
    summary = summarise(table) | {"seconds": perf_counter() - start, "directory": str(output)}
    facts = (output, variants, table, summary, variants.remarks)
    lines = sentence("sweep", "lines", *facts, failed_points(table), IMPEDANCE)
    lost, error = variants_without_a_point(table), None
    if summary["failed"] == summary["rows"]:
        error = FieldSolverError(sentence("sweep", "no_point", actuator))
    elif lost:
        error = FieldSolverError(sentence("sweep", "lost_variants", lost, len(variants.variants)))
    return Outcome(lines, summary, error=error)


@command("File for mapping and findings as JSON.")
def import_table(
    tables: tuple[Path, ...],
    *,
    output: Annotated[
        Path, OUTPUT, Writes(SWEEP, "sweep.parquet"), Writes(SWEEP, "sweep.csv"), Writes(MANIFEST, "manifest.json")
    ],
    table_options: TableOptions,
    columns: str | None = None,
    options: Annotated[dict[str, Any], _FORM],
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

    if columns is not None and not columns.strip(" ,"):
        raise UsageError("--columns must name columns, as distance_mm,current_A,force_N; instead received none.")
    names = tuple(word.strip() for word in columns.split(",")) if columns else ()  # an empty one counts
    imported = ff.import_table(tables, actuator=actuator, column_names=names, **options, **table_options)
    return Outcome(f"{imported}\nwritten: {write_sweep_table(imported, output)}", imported.manifest)


@command()
def fit(
    table: Path,
    *,
    model: str = "coenergy",
    output: Annotated[Path, OUTPUT, _BESIDE, Writes(MODEL)],
    forces: Annotated[dict[str, Any], _FORCES],
    device: Annotated[dict[str, Any], _DEVICE],
) -> Outcome:
    """Fit a force law or a co-energy to a sweep table, and write the model file.

    Parameters
    ----------
    table : Path
        Sweep table, or the directory that holds it; or a table of measured inductances without forces (distance_mm,
        current_A, inductance_mH), to which --model fits a law.
    model : str
        Kind of model: coenergy, the name of a force law, or all, which ranks every law and writes the recommended one.
    output : Path
        Model file; beside the table by default.
    """
    from femfit.fit.soft_iron import fit_inductance
    from femfit.tables.measurement_file import is_inductance_table, read_inductance_table

    result: ff.FitResult | InductanceFit
    if is_inductance_table(table):
        if forces:
            raise FitError(
                "--where, --bound, --functions and --inductance-H are of a fit to forces; one to measured inductances "
                "has no use for them. Leave them out, or fit a sweep table with forces."
            )
        result = fit_inductance(read_inductance_table(table), law=model, **device)
    else:
        result = ff.fit_model(table, law=model, **forces, **device)
    data = {**result.to_dict(), "model_file": str(output)}
    return Outcome(result, data, [(output, partial(ff.write_model, result.model))])
