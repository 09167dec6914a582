"""``femfit integrate`` and ``femfit bench``: a coil's voltage to its flux or field, and to a bench table."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, TableOptions, command
from femfit.cli.keywords import Keywords
from femfit.cli.output import progress

_INTEGRAL = Keywords(
    "femfit.integrate.integrate_coil:integrate_coil",
    "coil_area_m2=coil-area method initial_field_T zero_reading_s settling_s still_A"
    " current_to_field_A_per_T=current-to-field lab coil_area_sigma_m2=coil-area-sigma reference_gain_sigma"
    " reference_offset_sigma_T offset_sigma_V=offset-sigma-uV coverage",
)
_PLATEAUS = Keywords(
    "femfit.integrate.bench_table:make_bench_table",
    "resistance_ohm turns_ratio settling_s still_A still_m=still-um model",
)


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
        result = ff.integrate_coil(record, output=output, **options, **table_options, progress=show)
    return Outcome(result)


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
