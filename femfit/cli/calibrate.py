"""``femfit calibrate``: the drawing's wrong numbers from measurements, and the drawing written anew."""

import os
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from femfit.cli.table_options import NO_MEASUREMENT_OPTIONS, MeasurementOptions


def calibrate(
    drawing: Path,
    *data: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    numbers: str | None = None,
    effects: Annotated[tuple[str, ...], Parameter(name="--with", negative=())] = (),
    runs: Path | None = None,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
    json: Path | None = None,
) -> None:
    """Find the wrong numbers of a drawing from measurements, write it anew and solve its field again.

    Parameters
    ----------
    drawing : Path
        Actuator file (.toml), whose [tolerances] say how far its numbers may be off.
    data : Path
        Bench tables, or records over time, whose runs count together: CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with
        their sidecars .toml beside them where noise is declared.
    output : Path
        Actuator file for the drawing as the data have it, with the comments and the layout of the old one.
    numbers : str
        Key paths of the numbers with commas between them, or all; default: those that femfit diagnose names.
    effects : str
        Effect of the catalogue that is fitted beside the numbers; repeat for more; default: those that femfit diagnose
        names.
    runs : Path
        Directory of the sweeps, in which nothing is solved twice; runs/NAME-calibration by default.
    workers : int
        Number of processes on this machine; one a core by default.
    json : Path
        File for the result as JSON, with the covariance.
    """
    from femfit.cli.output import status, write_json
    from femfit.core.errors import UsageError
    from femfit.core.files import DRAWING, MODEL, RESULT, require_outputs, write_text
    from femfit.device.load import read_actuator
    from femfit.device.rewrite import require_same_elsewhere
    from femfit.identify.calibration.calibrate import calibrate as calibrated
    from femfit.identify.calibration.result import heading
    from femfit.model.json_file import write_model
    from femfit.tables.measurement_file import read_measurement

    if not data:
        raise UsageError("No measurement is given. Give a bench table, or a record over time, behind the drawing.")
    directory = runs or Path("runs") / f"{read_actuator(drawing).name}-calibration"
    model, as_drawn = directory / "calibrated" / "model.json", directory / "drawn" / "model.json"
    require_outputs([drawing, *data], (output, DRAWING), (json, RESULT), (model, MODEL), (as_drawn, MODEL))
    require_same_elsewhere(drawing, output)
    with status("Reading") as say:
        result = calibrated(
            drawing,
            [read_measurement(file, **table_options.keywords) for file in data],
            directory,
            numbers=None if numbers is None else tuple(key.strip() for key in numbers.split(",") if key.strip()),
            effects=effects or None,
            workers=workers or len(os.sched_getaffinity(0)),
            progress=say,
        )
    names = [file.name for file in data]
    write_text(output, heading(result, drawing.name, names) + result.drawing)
    write_model(result.model, model)
    write_model(result.model_as_drawn, as_drawn)
    write_json(json, result.to_dict() | {"drawing": drawing.name, "data": names})
    print(f"{result}\nwritten: {output}, its sweep in {model.parent} and its model {model}")
    print(f"Next: femfit compare {model} {data[0]}")
