"""``femfit observe``: a recorded log through the filters of a model."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import MeasurementOptions, Outcome, ToWrite, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.errors import TableError, UsageError
from femfit.core.files import MODEL

_OPTIONS = Keywords("femfit.estimate.observe:observe", "filter sensors biases")


@command(
    picture="PNG, SVG or PDF with the estimates beside the record, and normalised innovations.",
    csv="File for record, estimates, their deviations and normalised innovations.",
)
def observe(
    model: Path,
    record: Path,
    *,
    options: Annotated[dict[str, Any], _OPTIONS],
    keep_noise: bool = False,
    write_noise: Annotated[Path | None, Writes(MODEL)] = None,
    table_options: MeasurementOptions,
) -> Outcome:
    """Run a recorded log through filters: estimate, innovations, noise.

    Parameters
    ----------
    model : Path
        Model file with circuit and motion.
    record : Path
        Record over time with the commanded voltage: CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV.
    keep_noise : bool
        Noise of the model as it is, without a look at the noise in the record.
    write_noise : Path
        Model file to write, with the noise found in the record.
    """
    from femfit.cli.output import status
    from femfit.estimate.find_noise import with_noise
    from femfit.estimate.observe import NO_NOISE_FOUND

    if keep_noise and write_noise is not None:
        raise UsageError("--write-noise writes the noise that was found; remove --keep-noise.")
    with status("Filtering"):
        observation = ff.observe(model, ff.read_measurement(record, **table_options), **options, find=not keep_noise)
    files: list[ToWrite] = []
    if write_noise is not None:
        if observation.noise is None:
            raise TableError(f"--write-noise needs a noise that the record shows. {NO_NOISE_FOUND}")
        files = [(write_noise, partial(ff.write_model, with_noise(observation.model, observation.noise)))]
    return Outcome(observation, files=files)
