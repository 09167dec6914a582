"""Records over time: ``femfit observe`` filters them, ``integrate`` and ``bench`` make flux of a coil's voltage."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, MeasurementOptions, Outcome, TableOptions, ToWrite, Writes, command
from femfit.cli.keywords import Keywords
from femfit.cli.output import progress, status
from femfit.core.errors import TableError, UsageError
from femfit.core.files import MODEL

_FILTERS = Keywords("observe", "filter sensors biases")
_INTEGRAL = Keywords(
    "integrate_coil",
    "coil_area_m2=coil-area method initial_field_T zero_reading_s settling_s still_A"
    " current_to_field_A_per_T=current-to-field lab coil_area_sigma_m2=coil-area-sigma reference_gain_sigma"
    " reference_offset_sigma_T offset_sigma_V=offset-sigma-uV coverage",
)
_PLATEAUS = Keywords(
    "femfit.integrate.bench_table:make_bench_table",
    "resistance_ohm turns_ratio settling_s still_A still_m=still-um model",
)


@command(
    picture="PNG, SVG or PDF with the estimates beside the record, and normalised innovations.",
    csv="File for record, estimates, their deviations and normalised innovations.",
)
def observe(
    model: Path,
    record: Path,
    *,
    options: Annotated[dict[str, Any], _FILTERS],
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


@command()
def integrate(
    record: Path,
    *,
    output: Annotated[Path, OUTPUT],
    options: Annotated[dict[str, Any], _INTEGRAL],
    table_options: TableOptions,
) -> Outcome:
    """Drift-free flux or field from a coil's voltage.

    Writes the record's rows with field_T (or flux_linkage_Wb), its standard uncertainty and the offset voltage.

    Parameters
    ----------
    record : Path
        Record as CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV with time_s, coil_voltage_V, and hall_T or current_A; or
        raw float32 (.bin, .raw, .f32) with a sidecar .toml or .json that has sample_rate_Hz and columns.
    output : Path
        File of the integrated record: .csv or .parquet.
    """
    with progress(f"integrate {record.name}", "samples") as show:
        return Outcome(ff.integrate_coil(record, output=output, **options, **table_options, progress=show))


@command()
def bench(
    record: Path,
    *,
    output: Annotated[Path, OUTPUT],
    options: Annotated[dict[str, Any], _PLATEAUS],
    table_options: TableOptions,
) -> Outcome:
    """A bench table with flux linkage from a record of a coil's voltage.

    Parameters
    ----------
    record : Path
        Record as CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV with time_s, coil_voltage_V, current_A and distance_m,
        whose runs are integrated one by one and whose other columns (run, mount, force_N, ...) are averaged on the
        plateaus.
    output : Path
        Bench table (.csv), with a sidecar .toml for noise and notes beside it.
    """
    from femfit.integrate.bench_table import make_bench_table

    return Outcome(make_bench_table(record, output=output, **options, **table_options))
