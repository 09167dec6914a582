"""``femfit compare``: how far a model is from measurements, against their noise, and where."""

from functools import partial
from pathlib import Path
from typing import Annotated

import femfit as ff
from femfit.cli.command import NO_MEASUREMENT_OPTIONS, MeasurementOptions, Outcome, Writes, command
from femfit.core.files import PAGE


@command("File for the result as JSON, with the maps.")
def compare(
    model: Path,
    data: Path,
    *,
    report: Annotated[Path | None, Writes(PAGE)] = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
) -> Outcome:
    """Compare a model with measurements: misfit per channel against the noise floor, lack of fit, and where it fails.

    Parameters
    ----------
    model : Path
        Model file (co-energy or law), or a sweep table (Parquet, CSV or its directory) whose co-energy is fitted on the
        fly.
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    report : Path
        HTML file with measured points on the model's curves, and maps of the misfit.
    """
    from femfit.cli.output import status

    with status("Comparing"):
        predicting = model if model.suffix == ".json" else ff.fit_model(model).model
        comparison = ff.compare(predicting, table_options.read(data))
    return Outcome(comparison, files=[(report, partial(ff.write_report, comparison))])
