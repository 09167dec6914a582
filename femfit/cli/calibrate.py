"""``femfit calibrate``: the drawing's wrong numbers from measurements, and the drawing written anew."""

import os
from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import (
    AT_LEAST_ONE,
    OUTPUT,
    MeasurementOptions,
    Outcome,
    Writes,
    command,
    run_directory,
)
from femfit.cli.keywords import Keywords
from femfit.core.errors import UsageError
from femfit.core.files import DRAWING, MODEL, write_text

_MODEL, _AS_DRAWN = "calibrated/model.json", "drawn/model.json"
_OPTIONS = Keywords("femfit.identify.calibration.calibrate:calibrate", "numbers effects=with")
_DIRECTORY = run_directory("drawing", "-calibration")


@command("File for the result as JSON, with the covariance.")
def calibrate(
    drawing: Path,
    *data: Path,
    output: Annotated[Path, OUTPUT, Writes(DRAWING)],
    options: Annotated[dict[str, Any], _OPTIONS],
    runs: Annotated[Path | None, Writes(MODEL, _MODEL, _DIRECTORY), Writes(MODEL, _AS_DRAWN)] = None,
    workers: Annotated[int | None, AT_LEAST_ONE] = None,
    table_options: MeasurementOptions,
) -> Outcome:
    """Find a drawing's wrong numbers from measurements; write it anew.

    Parameters
    ----------
    drawing : Path
        Actuator file (.toml), whose [tolerances] say how far its numbers may be off.
    data : Path
        Bench tables, or records over time, whose runs count together: CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with
        their sidecars .toml beside them where noise is declared.
    output : Path
        Actuator file for the drawing as the data have it, with the comments and the layout of the old one; not written
        where the numbers do not settle.
    runs : Path
        Directory of the sweeps, in which nothing is solved twice; runs/NAME-calibration by default.
    workers : int
        Number of processes on this machine; one a core by default.
    """
    from femfit.cli.output import status
    from femfit.identify.calibration.result import heading

    if not data:
        raise UsageError("No measurement is given. Give a bench table, or a record over time, behind the drawing.")
    assert runs is not None  # noqa: S101 - the default of Writes
    model = runs / _MODEL
    with status("Reading") as say:
        result = ff.calibrate(
            drawing,
            [ff.read_measurement(file, **table_options) for file in data],
            runs,
            **options,
            workers=workers or len(os.sched_getaffinity(0)),
            progress=say,
        )
    facts = {"drawing": drawing.name, "data": [file.name for file in data]}
    ff.write_model(result.model, model)
    ff.write_model(result.model_as_drawn, runs / _AS_DRAWN)
    if result.settled:
        write_text(output, heading(result, drawing.name, [file.name for file in data]) + result.drawing)
    written = f"written: {f'{output}, ' * result.settled}its sweep in {model.parent} and its model {model}"
    return Outcome(f"{result}\n{written}\nNext: femfit compare {model} {data[0]}", result.to_dict() | facts)
