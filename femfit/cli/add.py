"""``femfit add``: refit a model with an effect, judged on runs left out."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, cast

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import NO_MEASUREMENT_OPTIONS, OUTPUT, MeasurementOptions, Outcome, ToWrite, Writes, command
from femfit.core.errors import UsageError
from femfit.core.files import MODEL, PAGE, PICTURE


@command()
def add(
    model: Path,
    effect: str,
    data: Path,
    *,
    output: Annotated[Path, OUTPUT, Writes(MODEL)],
    effects: Annotated[tuple[str, ...], Parameter(name="--with")] = (),
    from_run: int | None = None,
    until_run: int | None = None,
    coil_temperature_C: float | None = None,
    magnet_temperature_C: float | None = None,
    report: Annotated[Path | None, Writes(PAGE)] = None,
    picture: Annotated[Path | None, Writes(PICTURE)] = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
) -> Outcome:
    """Refit a model with an effect: error before and after on runs that were not fitted, and the noise floor.

    Parameters
    ----------
    model : Path
        Model file, whose earlier effects are refitted where the data can show them.
    effect : str
        Name of the effect in the catalogue, as femfit diagnose gives it; or unexplained, which learns what all effects
        leave.
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    output : Path
        New model file, which simulates, filters and exports like any other; not written where the addition is not
        accepted.
    effects : tuple of str
        Further effect, fitted after the first; repeat for more, in the order of adding.
    from_run : int
        First run in which the effect acts, counted from 1, as femfit diagnose gives it; default: the first.
    until_run : int
        Last run in which the effect acts, whose state the new model has; default: the last.
    coil_temperature_C : float
        Temperature of the winding in degC at which the new model runs; default: the recorded mean.
    magnet_temperature_C : float
        Temperature of the magnet in degC at which the new model runs; default: the recorded mean.
    report : Path
        HTML file with the measured points on the curves before and after, and how far the error fell.
    picture : Path
        PNG, SVG or PDF with the distance of a record as filters without a distance sensor estimate it, before and
        after.
    """
    from femfit.cli.output import status
    from femfit.report.motion_figures import write_before_after

    with status("Reading") as say:
        actuator, measured = ff.read_model(model), table_options.read(data)
        if picture is not None and not isinstance(measured, ff.TimeSeries):
            raise UsageError("--picture shows a record over time through a filter; a bench table has --report.")
        runs = None
        if from_run is not None or until_run is not None:
            count = len(set(measured.rows["run"])) if "run" in measured.rows else 1
            runs = {effect: (from_run or 1, until_run or count)}
        result = ff.add_effects(
            actuator,
            measured,
            (effect, *effects),
            runs=runs,
            coil_temperature_C=coil_temperature_C,
            magnet_temperature_C=magnet_temperature_C,
            progress=say,
        )
    record = result.to_dict() | {"data": data.name}
    added = [*result.model.provenance.get("added", []), record]
    remembering = replace(result.model, provenance={**result.model.provenance, "added": added})

    files: list[ToWrite] = [
        (output if result.accepted else None, partial(ff.write_model, remembering)),
        (picture, lambda path: write_before_after((actuator, result.model), cast("ff.TimeSeries", measured), path)),
        (report, partial(ff.write_report, result)),
    ]
    return Outcome(result, record, files)
