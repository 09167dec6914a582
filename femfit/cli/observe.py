"""``femfit observe``: a recorded log through the filters of a model."""

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import (
    NO_MEASUREMENT_OPTIONS,
    MeasurementOptions,
    Outcome,
    ToWrite,
    Writes,
    command,
    names_of,
)
from femfit.core.errors import TableError, UsageError
from femfit.core.files import MODEL, PICTURE, REPLAYED, write_text


@command()
def observe(
    model: Path,
    record: Path,
    *,
    filters: Annotated[str, Parameter(name="--filter")] = "ukf",
    sensors: str | None = None,
    biases: str | None = None,
    keep_noise: bool = False,
    write_noise: Annotated[Path | None, Writes(MODEL)] = None,
    picture: Annotated[Path | None, Writes(PICTURE)] = None,
    csv: Annotated[Path | None, Writes(REPLAYED)] = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
) -> Outcome:
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
    """
    from femfit.cli.output import status
    from femfit.estimate.find_noise import with_noise
    from femfit.estimate.observe import NO_NOISE_FOUND
    from femfit.report.style import write_picture

    if keep_noise and write_noise is not None:
        raise UsageError("--write-noise writes the noise that was found; remove --keep-noise.")
    with status("Filtering"):
        observation = ff.observe(
            model,
            table_options.read(record),
            filter=names_of(filters),
            sensors=None if sensors is None else names_of(sensors),
            biases=None if biases is None else names_of(biases),
            find=not keep_noise,
        )
    files: list[ToWrite] = [
        (picture, partial(write_picture, observation.plot)),
        (csv, lambda path: write_text(path, observation.table.to_csv(index=False))),
    ]
    if write_noise is not None:
        if observation.noise is None:
            raise TableError(f"--write-noise needs a noise that the record shows. {NO_NOISE_FOUND}")
        files.insert(0, (write_noise, partial(ff.write_model, with_noise(observation.model, observation.noise))))
    return Outcome(observation, files=files)
