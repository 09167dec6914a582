"""``femfit diagnose``: which effect is missing, or none, or none of ours."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import MeasurementOptions, Outcome, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.files import PAGE

_OPTIONS = Keywords("femfit.identify.decision.diagnose:diagnose", "exclude")


@command()
def diagnose(
    model: Path,
    data: Path,
    *,
    options: Annotated[dict[str, Any], _OPTIONS],
    report: Annotated[Path | None, Writes(PAGE)] = None,
    table_options: MeasurementOptions,
) -> Outcome:
    """Name the effect that measurements show and the model lacks.

    Parameters
    ----------
    model : Path
        Model file; best the co-energy reference (femfit fit TABLE).
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    report : Path
        HTML file with what was measured, where the model fails, what would explain it, and what to measure next.
    """
    from femfit.cli.output import status
    from femfit.report.bench_report import render_diagnosis
    from femfit.report.page import write_page
    from femfit.report.write import hashes

    with status("Reading") as say:
        measured = ff.read_measurement(data, **table_options)
        result = ff.diagnose(model, measured, **options, progress=say)

    def page(path: Path) -> None:
        with status("Finding what to measure next") as say:
            advice = ff.suggest(result.model, measured, result, progress=say).suggestions
            say("Writing the report")
            write_page(render_diagnosis(result, measured, suggestions=advice, hashes=hashes((model, data))), path)

    return Outcome(result, files=[(report, page)])
