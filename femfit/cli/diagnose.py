"""``femfit diagnose``: which effect is missing, or none, or none of ours."""

from pathlib import Path
from typing import Annotated

import femfit as ff
from femfit.cli.command import NO_MEASUREMENT_OPTIONS, MeasurementOptions, Outcome, Writes, command
from femfit.core.files import PAGE


@command()
def diagnose(
    model: Path,
    data: Path,
    *,
    exclude: tuple[str, ...] = (),
    report: Annotated[Path | None, Writes(PAGE)] = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
) -> Outcome:
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
    report : Path
        HTML file with what was measured, where the model fails, what would explain it, and what to measure next.
    """
    from femfit.cli.output import status
    from femfit.report.bench_report import render_diagnosis
    from femfit.report.page import write_page
    from femfit.report.write import hashes

    with status("Reading") as say:
        measured = table_options.read(data)
        result = ff.diagnose(model, measured, exclude=exclude, progress=say)

    def page(path: Path) -> None:
        with status("Finding what to measure next") as say:
            advice = ff.suggest(result.model, measured, result, progress=say).suggestions
            say("Writing the report")
            write_page(render_diagnosis(result, measured, suggestions=advice, hashes=hashes((model, data))), path)

    return Outcome(result, files=[(report, page)])
