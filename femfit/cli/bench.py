"""``femfit bench``: a bench table with flux linkage from a record of a coil's voltage."""

from pathlib import Path
from typing import Annotated, Any

from femfit.cli.command import OUTPUT, Outcome, TableOptions, command
from femfit.cli.keywords import Keywords

_OPTIONS = Keywords(
    "femfit.integrate.bench_table:make_bench_table",
    "resistance_ohm turns_ratio settling_s still_A still_m=still-um model",
)


@command()
def bench(
    record: Path,
    *,
    output: Annotated[Path, OUTPUT],
    options: Annotated[dict[str, Any], _OPTIONS],
    table_options: TableOptions,
) -> Outcome:
    """Make a bench table for compare and diagnose from a record of a coil's voltage: one row a plateau.

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
