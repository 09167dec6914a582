"""``femfit integrate``: drift-free flux or field from a coil's voltage."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import NO_TABLE_OPTIONS, NOT_NEGATIVE, OUTPUT, POSITIVE, Outcome, TableOptions, command, in_si
from femfit.cli.output import progress

MethodOption = Literal["trapezoid", "ffa1", "ffa2", "cs1-offset", "cs2", "cs2-identified"]


@Parameter(name="*")
@dataclass(frozen=True)
class IntegrateOptions:
    """How the voltage is integrated, and how sure is what it takes.

    Attributes
    ----------
    coil_area_m2 : float
        Total area of the coil in m2, which the filters need.
    method : str
        Method of integration: trapezoid; ffa1 (offset from an initial zero reading); ffa2 (mean on each plateau);
        cs1-offset (Kalman filter with a Hall probe, which estimates the offset voltage too); cs2, cs2-identified (the
        same with the current, by a ratio, by a field identified from --lab); default: cs1-offset where the record has
        a Hall probe and an area is given, else ffa2.
    initial_field_T : float
        Field in T at the record's begin (flux linkage in Wb without an area); default: 0, or the reference's first
        reading.
    zero_reading_s : float
        Time in s at the record's begin in which nothing moves, for the zero reading of ffa1.
    settling_s : float
        Time in s left out after each ramp until the eddy currents have decayed, for ffa2; default: 1.
    still_A : float
        Largest change of the current in A within a second on a plateau of ffa2; default: 0.1.
    current_to_field_A_per_T : float
        Ratio of the magnet's current to its field in A/T for cs2, as sure as --reference-gain-sigma says.
    lab : Path
        Record with Hall probe and current of a cycled magnet, from which cs2-identified identifies its field.
    coil_area_sigma_m2 : float
        Standard uncertainty of the area in m2.
    reference_gain_sigma : float
        Relative standard uncertainty of the Hall probe's (or the current-to-field ratio's) gain.
    reference_offset_sigma_T : float
        Standard uncertainty of the reference's zero in T.
    offset_sigma_uV : float
        Standard uncertainty in uV of the offset voltage that a method leaves; default: 20 (trapezoid), 5 (ffa1, ffa2)
        and 0 (the filters, which estimate it).
    coverage : float
        Coverage factor of the printed uncertainty.
    """

    coil_area_m2: Annotated[float | None, Parameter(name="--coil-area")] = None
    method: MethodOption | None = None
    initial_field_T: float | None = None
    zero_reading_s: Annotated[float | None, POSITIVE] = None
    settling_s: Annotated[float | None, NOT_NEGATIVE] = None
    still_A: Annotated[float | None, POSITIVE] = None
    current_to_field_A_per_T: Annotated[float | None, Parameter(name="--current-to-field"), POSITIVE] = None
    lab: Path | None = None
    coil_area_sigma_m2: Annotated[float | None, Parameter(name="--coil-area-sigma"), NOT_NEGATIVE] = None
    reference_gain_sigma: Annotated[float | None, NOT_NEGATIVE] = None
    reference_offset_sigma_T: Annotated[float | None, NOT_NEGATIVE] = None
    offset_sigma_uV: Annotated[float | None, NOT_NEGATIVE] = None
    coverage: Annotated[float, POSITIVE] = 2.0


_DEFAULTS = IntegrateOptions()


@command()
def integrate(
    record: Path,
    *,
    output: Annotated[Path, OUTPUT],
    options: IntegrateOptions = _DEFAULTS,
    table_options: TableOptions = NO_TABLE_OPTIONS,
) -> Outcome:
    """Integrate a coil's voltage to its field (or, without an area, its flux linkage) and say how sure that is.

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
        result = ff.integrate_coil(record, output=output, **in_si(options), **table_options.keywords, progress=show)
    return Outcome(result)
