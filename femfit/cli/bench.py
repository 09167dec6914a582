"""``femfit bench``: a bench table with flux linkage from a record of a coil's voltage."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.cli.table_options import NO_TABLE_OPTIONS, TableOptions

NotNegative = Number(gte=0.0)


def bench(
    record: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    resistance_ohm: Annotated[float | None, Parameter(validator=NotNegative)] = None,
    turns_ratio: Annotated[float, Parameter(validator=Number(gt=0.0))] = 1.0,
    method: Literal["trapezoid", "ffa1", "plateaus"] = "plateaus",
    settling_s: Annotated[float, Parameter(validator=NotNegative)] = 0.0,
    still_A: Annotated[float, Parameter(name="--still-A", validator=NotNegative)] = 1e-3,
    still_um: Annotated[float, Parameter(validator=NotNegative)] = 1.0,
    model: Path | None = None,
    initial_flux_Wb: Annotated[float | None, Parameter(name="--initial-flux-Wb")] = None,
    table_options: Annotated[TableOptions, Parameter(name="*")] = NO_TABLE_OPTIONS,
    json: Path | None = None,
) -> None:
    """Make a bench table for compare and diagnose from a record of a coil's voltage: one row a plateau.

    Parameters
    ----------
    record : Path
        Record as CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV with time_s, coil_voltage_V, current_A and distance_m,
        whose runs are integrated one by one and whose other columns (run, mount, force_N, ...) are averaged on the
        plateaus.
    output : Path
        Bench table (.csv), with a sidecar .toml for noise and notes beside it.
    resistance_ohm : float
        Resistance of the excitation winding in ohm, whose R i is taken off where the voltage is that winding's own; not
        for a separate sensing coil.
    turns_ratio : float
        Turns of the excitation winding over those of the sensing coil.
    method : str
        Method for the offset voltage: plateaus (from each settled plateau, linear between), ffa1 (from each run's first
        plateau), or trapezoid (none: drifts).
    settling_s : float
        Time in s left out after each change, until the eddy currents have decayed.
    still_A : float
        Largest change of the current in A from sample to sample on a plateau.
    still_um : float
        Largest change of the distance in um from sample to sample on a plateau.
    model : Path
        Model file that gives the flux linkage on each run's first plateau.
    initial_flux_Wb : float
        Flux linkage in Wb on each run's first plateau, where it is known; default: 0.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.files import RESULT, require_outputs
    from femfit.integrate.bench_table import make_bench_table

    require_outputs([record, model, output, output.with_suffix(".toml")], (json, RESULT))
    made = make_bench_table(
        record,
        output=output,
        resistance_ohm=resistance_ohm,
        turns_ratio=turns_ratio,
        method=method,
        settling_s=settling_s,
        still_A=still_A,
        still_m=1e-6 * still_um,
        model=model,
        initial_flux_Wb=initial_flux_Wb,
        **table_options.keywords,
    )
    print(made)
    write_json(json, made.to_dict())
