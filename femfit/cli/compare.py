"""``femfit compare``: how far a model is from measurements, against their noise, and where."""

from pathlib import Path
from typing import TYPE_CHECKING

from femfit.cli.table_options import NO_MEASUREMENT_OPTIONS, MeasurementOptions

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


def compare(
    model: Path,
    data: Path,
    *,
    pictures: Path | None = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
    json: Path | None = None,
) -> None:
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
    json : Path
        File for the result as JSON, with the maps.
    """
    from femfit.cli.output import conclude, status
    from femfit.core.files import RESULT, require_outputs
    from femfit.identify.comparison.compare import compare as compared
    from femfit.tables.measurement_file import read_measurement

    require_outputs([model, data], (json, RESULT))
    if model.suffix == ".toml":
        _field_scan(model, data, pictures, table_options, json)
        return
    with status("Comparing"):
        measured = read_measurement(data, **table_options.keywords)
        comparison = compared(_model(model), measured)
    written = []
    if pictures is not None:
        from femfit.report.bench_report import save_comparison_pictures

        written = save_comparison_pictures(comparison, pictures)
    conclude(comparison, json, written)


def _field_scan(
    drawing: Path, data: Path, pictures: Path | None, table_options: MeasurementOptions, json: Path | None
) -> None:
    """Compare a probe scan with the field of a drawing."""
    from femfit.cli.output import conclude, status
    from femfit.core.errors import UsageError
    from femfit.device.load import read_actuator
    from femfit.identify.comparison.field_scan import compare_field_scan
    from femfit.tables.field_scan import read_field_scan

    if pictures is not None or table_options.noise:
        raise UsageError("A probe scan is compared in words: leave --pictures and --noise out.")
    scan = read_field_scan(data, columns=table_options.columns, units=table_options.units, table=table_options.table)
    with status("Solving the field at the places of the probe"):
        comparison = compare_field_scan(read_actuator(drawing), scan)
    conclude(comparison, json)


def _model(path: Path) -> "ActuatorModel":
    """A model file's model, or the co-energy of a sweep table."""
    from femfit.fit.build import fit_model
    from femfit.model.json_file import read_model
    from femfit.tables.sweep_table import read_sweep_table

    return read_model(path) if path.suffix == ".json" else fit_model(read_sweep_table(path)).model
