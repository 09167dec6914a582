"""``femfit compare``: how far a model is from measurements, against their noise, and where."""

from functools import partial
from pathlib import Path
from typing import Annotated

import femfit as ff
from femfit.cli.command import NO_MEASUREMENT_OPTIONS, MeasurementOptions, Outcome, Writes, command
from femfit.core.errors import UsageError
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
        fly; for a probe scan the actuator file (.toml), whose field is solved at the places of the probe.
    data : Path
        Bench table, record over time (with a column time_s) or probe scan (distance_mm, current_A, r_mm, z_mm,
        field_mT): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its sidecar .toml beside it where noise is declared.
    report : Path
        HTML file with measured points on the model's curves, and maps of the misfit.
    """
    from femfit.cli.output import status
    from femfit.identify.field_scan import compare_field_scan
    from femfit.tables.measurement_file import read_field_scan

    if model.suffix == ".toml":
        if report is not None or table_options.noise:
            raise UsageError("A probe scan is compared in words: leave --report and --noise out.")
        keywords = table_options.keywords
        scan = read_field_scan(data, columns=keywords["columns"], units=keywords["units"], table=keywords["table"])
        with status("Solving the field at the places of the probe"):
            return Outcome(compare_field_scan(ff.read_actuator(model), scan))
    with status("Comparing"):
        predicting = model if model.suffix == ".json" else ff.fit_model(model).model
        comparison = ff.compare(predicting, table_options.read(data))
    return Outcome(comparison, files=[(report, partial(ff.write_report, comparison))])
