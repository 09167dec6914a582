"""``femfit compare``: how far a model is from measurements, against their noise, and where."""

from pathlib import Path
from typing import Annotated

from femfit.cli.command import NO_MEASUREMENT_OPTIONS, MeasurementOptions, Outcome, Writes, command
from femfit.core.errors import UsageError


@command("File for the result as JSON, with the maps.")
def compare(
    model: Path,
    data: Path,
    *,
    pictures: Annotated[Path | None, Writes()] = None,
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
    pictures : Path
        Directory for pictures of the misfit over distance and current, and over what else it changes with.
    """
    from femfit.cli.output import status
    from femfit.fit.build import fit_model
    from femfit.identify.compare import compare as compared
    from femfit.model.json_file import read_model
    from femfit.report.bench_report import save_comparison_pictures
    from femfit.tables.sweep_table import read_sweep_table

    if model.suffix == ".toml":
        if pictures is not None or table_options.noise:
            raise UsageError("A probe scan is compared in words: leave --pictures and --noise out.")
        return _field_scan(model, data, table_options)
    with status("Comparing"):
        predicting = read_model(model) if model.suffix == ".json" else fit_model(read_sweep_table(model)).model
        comparison = compared(predicting, table_options.read(data))
    written = [] if pictures is None else save_comparison_pictures(comparison, pictures)
    return Outcome(comparison, last="\n".join(f"written: {file}" for file in written))


def _field_scan(drawing: Path, data: Path, table_options: MeasurementOptions) -> Outcome:
    """Compare a probe scan with the field of a drawing."""
    from femfit.cli.output import status
    from femfit.device.load import read_actuator
    from femfit.identify.field_scan import compare_field_scan
    from femfit.tables.measured_tables import read_field_scan

    keywords = table_options.keywords
    scan = read_field_scan(data, columns=keywords["columns"], units=keywords["units"], table=keywords["table"])
    with status("Solving the field at the places of the probe"):
        return Outcome(compare_field_scan(read_actuator(drawing), scan))
