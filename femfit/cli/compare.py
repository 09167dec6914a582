"""``femfit compare``: how far a model is from measurements, against their noise, and where."""

from pathlib import Path

import femfit as ff
from femfit.cli.command import MeasurementOptions, Outcome, command


@command(
    "File for the result as JSON, with the maps.",
    report="HTML file with measured points on the model's curves, and maps of the misfit.",
)
def compare(
    model: Path,
    data: Path,
    *,
    table_options: MeasurementOptions,
) -> Outcome:
    """How far a model is from measurements, against their noise, and where.

    Parameters
    ----------
    model : Path
        Model file (co-energy or law), or a sweep table (Parquet, CSV or its directory) whose co-energy is fitted on the
        fly.
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    """
    from femfit.cli.output import status

    with status("Comparing"):
        predicting = model if model.suffix == ".json" else ff.fit_model(model).model
        return Outcome(ff.compare(predicting, ff.read_measurement(data, **table_options)))
