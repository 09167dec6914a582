"""``femfit add``: refit a model with an effect, judged on runs left out."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import OUTPUT, MeasurementOptions, Outcome, ToWrite, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.errors import UsageError
from femfit.core.files import MODEL, PICTURE

_OPTIONS = Keywords("femfit.identify.add_effects:add_effects", "coil_temperature_C magnet_temperature_C")


@command(report="HTML file with the measured points on the curves before and after, and how far the error fell.")
def add(
    model: Path,
    effect: str,
    data: Path,
    *,
    output: Annotated[Path, OUTPUT, Writes(MODEL)],
    effects: Annotated[tuple[str, ...], Parameter(name="--with")] = (),
    from_run: int | None = None,
    until_run: int | None = None,
    options: Annotated[dict[str, Any], _OPTIONS],
    picture: Annotated[Path | None, Writes(PICTURE)] = None,
    table_options: MeasurementOptions,
) -> Outcome:
    """Refit a model with an effect, judged on runs that were not fitted.

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
    picture : Path
        PNG, SVG or PDF with the distance of a record as filters without a distance sensor estimate it, before and
        after.
    """
    from femfit.cli.output import status
    from femfit.report.motion_figures import write_before_after

    with status("Reading") as say:
        actuator, measured = ff.read_model(model), ff.read_measurement(data, **table_options)
        if picture is not None and not isinstance(measured, ff.TimeSeries):
            raise UsageError("--picture shows a record over time through a filter; a bench table has --report.")
        runs = None
        if from_run is not None or until_run is not None:
            count = len(set(measured.rows["run"])) if "run" in measured.rows else 1
            runs = {effect: (from_run or 1, until_run or count)}
        result = ff.add_effects(actuator, measured, (effect, *effects), runs=runs, **options, progress=say)
    record = result.to_dict() | {"data": data.name}
    added = [*result.model.provenance.get("added", []), record]
    remembering = replace(result.model, provenance={**result.model.provenance, "added": added})

    files: list[ToWrite] = [
        (output if result.accepted else None, partial(ff.write_model, remembering)),
        (picture, lambda path: write_before_after((actuator, result.model), cast("ff.TimeSeries", measured), path)),
    ]
    return Outcome(result, record, files)
