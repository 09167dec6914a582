"""``femfit bench``: a bench table with flux linkage from a record of a coil's voltage."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from femfit.cli.command import NO_TABLE_OPTIONS, NOT_NEGATIVE, OUTPUT, POSITIVE, Outcome, TableOptions, command, in_si


@Parameter(name="*")
@dataclass(frozen=True)
class BenchOptions:
    """How the record is integrated, and what a plateau is.

    Attributes
    ----------
    resistance_ohm : float
        Resistance of the excitation winding in ohm, whose R i is taken off where the voltage is that winding's own; not
        for a separate sensing coil.
    turns_ratio : float
        Turns of the excitation winding over those of the sensing coil.
    settling_s : float
        Time in s left out after each change, until the eddy currents have decayed.
    still_A : float
        Largest change of the current in A from sample to sample on a plateau.
    still_um : float
        Largest change of the distance in um from sample to sample on a plateau.
    model : Path
        Model file that gives the flux linkage on each run's first plateau; default: 0.
    """

    resistance_ohm: Annotated[float | None, NOT_NEGATIVE] = None
    turns_ratio: Annotated[float, POSITIVE] = 1.0
    settling_s: Annotated[float, NOT_NEGATIVE] = 0.0
    still_A: Annotated[float, NOT_NEGATIVE] = 1e-3
    still_um: Annotated[float, NOT_NEGATIVE] = 1.0
    model: Path | None = None


_DEFAULTS = BenchOptions()


@command()
def bench(
    record: Path,
    *,
    output: Annotated[Path, OUTPUT],
    options: BenchOptions = _DEFAULTS,
    table_options: TableOptions = NO_TABLE_OPTIONS,
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

    return Outcome(make_bench_table(record, output=output, **in_si(options), **table_options.keywords))
