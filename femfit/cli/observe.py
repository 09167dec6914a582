"""``femfit observe``: a recorded log through the filters of a model."""

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from femfit.cli.table_options import NO_MEASUREMENT_OPTIONS, MeasurementOptions


def observe(
    model: Path,
    record: Path,
    *,
    filters: Annotated[str, Parameter(name="--filter")] = "ukf",
    sensors: str | None = None,
    biases: str | None = None,
    keep_noise: Annotated[bool, Parameter(negative=())] = False,
    write_noise: Path | None = None,
    picture: Path | None = None,
    csv: Path | None = None,
    table_options: Annotated[MeasurementOptions, Parameter(name="*")] = NO_MEASUREMENT_OPTIONS,
    json: Path | None = None,
) -> None:
    """Run a recorded log through filters: the estimate beside the record, innovations, and the noise in the record.

    Parameters
    ----------
    model : Path
        Model file with circuit and motion.
    record : Path
        Record over time with the commanded voltage: CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV.
    filters : str
        Filters with commas between them, placed side by side: ukf, ekf, ukf4 or ekf4 (with a bias as a further state).
    sensors : str
        Names of the sensors that the filters read, with commas; default: all in the record; the others check the
        estimate.
    biases : str
        Sensors whose bias ukf4 and ekf4 estimate, with commas.
    keep_noise : bool
        Noise of the model as it is, without a look at the noise in the record.
    write_noise : Path
        Model file to write, with the noise found in the record.
    picture : Path
        PNG, SVG or PDF with the estimates beside the record, and normalised innovations.
    csv : Path
        File for record, estimates, their deviations and normalised innovations.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import conclude, status
    from femfit.core.errors import TableError, UsageError
    from femfit.core.files import MODEL, PICTURE, REPLAYED, RESULT, require_outputs, write_text
    from femfit.estimate.found_noise import with_noise
    from femfit.estimate.observe import NO_NOISE_FOUND
    from femfit.estimate.observe import observe as observed
    from femfit.model.json_file import write_model
    from femfit.tables.measurement_file import read_measurement

    if keep_noise and write_noise is not None:
        raise UsageError("--write-noise writes the noise that was found; remove --keep-noise.")
    require_outputs([model, record], (write_noise, MODEL), (picture, PICTURE), (csv, REPLAYED), (json, RESULT))
    with status("Filtering"):
        measured = read_measurement(record, **table_options.keywords)
        observation = observed(
            model,
            measured,
            filter=_names(filters) or (),
            sensors=_names(sensors),
            biases=_names(biases),
            find=not keep_noise,
        )
    written = []
    if write_noise is not None:
        if observation.noise is None:
            raise TableError(f"--write-noise needs a noise that the record shows. {NO_NOISE_FOUND}")
        write_model(with_noise(observation.model, observation.noise), write_noise)
        written.append(write_noise)
    if picture is not None:
        from femfit.report.motion_figures import replay_figure
        from femfit.report.style import write_picture

        write_picture(partial(replay_figure, observation), picture)
        written.append(picture)
    if csv is not None:
        write_text(csv, observation.table.to_csv(index=False))
        written.append(csv)
    conclude(observation, json, written)


def _names(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(name.strip() for name in text.split(",") if name.strip())
