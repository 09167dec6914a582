"""``femfit diagnose``: which effect is missing, or none, or none of ours."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.cli.table_options import NO_MEASUREMENT_OPTIONS, MeasurementOptions


def diagnose(
    model: Path,
    data: Path,
    *,
    exclude: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    bootstrap: Annotated[int, Parameter(validator=Number(gte=0))] = 40,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    report: Path | None = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
    json: Path | None = None,
) -> None:
    """Compare measurements with a model and name the physical effect that is missing.

    Parameters
    ----------
    model : Path
        Model file; best the co-energy reference (femfit fit TABLE).
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    exclude : tuple of str
        Effect that is not considered; repeat for more.
    bootstrap : int
        Number of clean campaigns that are simulated to count how often something is named in them; 0 for none.
    seed : int
        Seed of that simulation.
    report : Path
        HTML file with what was measured, where the model fails, what would explain it, and what to measure next.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import conclude, status
    from femfit.core.files import PAGE, RESULT, require_outputs
    from femfit.identify.decision.diagnose import diagnose as diagnosed
    from femfit.model.json_file import read_model
    from femfit.tables.measurement_file import read_measurement

    require_outputs([model, data], (report, PAGE), (json, RESULT))
    with status("Reading") as say:
        measured = read_measurement(data, **table_options.keywords)
        result = diagnosed(read_model(model), measured, exclude=exclude, bootstrap=bootstrap, rng=seed, progress=say)
        if report is not None:
            from femfit.identify.experiments.suggest import suggest
            from femfit.report.bench_report import render_diagnosis
            from femfit.report.page import write_page
            from femfit.report.write import hashes

            advice = suggest(result.model, measured, result, progress=say).suggestions
            say("Writing the report")
            write_page(render_diagnosis(result, measured, suggestions=advice, hashes=hashes((model, data))), report)
    conclude(result, json)
    if report is not None:
        print(f"written: {report}")
