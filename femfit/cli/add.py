"""``femfit add``: refit a model with an effect, judged on runs left out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from femfit.cli.table_options import NO_MEASUREMENT_OPTIONS, MeasurementOptions

if TYPE_CHECKING:
    from femfit.tables.measurement import Measurement


def add(
    model: Path,
    effect: str,
    data: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    effects: Annotated[tuple[str, ...], Parameter(name="--with", negative=())] = (),
    base: Literal["auto", "always", "never"] = "auto",
    from_run: int | None = None,
    until_run: int | None = None,
    coil_temperature_C: Annotated[float | None, Parameter(name="--coil-temperature-C")] = None,
    magnet_temperature_C: Annotated[float | None, Parameter(name="--magnet-temperature-C")] = None,
    report: Path | None = None,
    picture: Path | None = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
    json: Path | None = None,
) -> None:
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
        New model file, which simulates, filters and exports like any other.
    effects : tuple of str
        Further effect, fitted after the first; repeat for more, in the order of adding.
    base : str
        Fit of the base's own amplitudes (magnet strength, turns, resistance, known to 2 %) beside the effect: auto
        (where that helps on runs left out), always or never.
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
    json : Path
        File for the result as JSON.
    """
    from dataclasses import replace

    from femfit.cli.output import status, write_json
    from femfit.core.files import MODEL, PAGE, PICTURE, RESULT, require_outputs
    from femfit.identify.refit.add_effects import add_effects
    from femfit.model.json_file import read_model, write_model
    from femfit.tables.measurement_file import read_measurement

    require_outputs([model, data], (output, MODEL), (report, PAGE), (picture, PICTURE), (json, RESULT))
    with status("Reading") as say:
        actuator, measured = read_model(model), read_measurement(data, **table_options.keywords)
        result = add_effects(
            actuator,
            measured,
            (effect, *effects),
            base=base,
            runs=_runs(effect, measured, from_run, until_run),
            coil_temperature_C=coil_temperature_C,
            magnet_temperature_C=magnet_temperature_C,
            progress=say,
        )
    record = result.to_dict() | {"data": data.name}
    provenance = dict(result.model.provenance)
    provenance["added"] = [*provenance.get("added", []), record]
    output.parent.mkdir(parents=True, exist_ok=True)
    write_model(replace(result.model, provenance=provenance), output)
    write_json(json, record)
    print(f"{result}\nwritten: {output}")
    if picture is not None:
        from femfit.core.errors import UsageError
        from femfit.report.motion_figures import write_before_after
        from femfit.tables.measurement import TimeSeries

        if not isinstance(measured, TimeSeries):
            raise UsageError("--picture shows a record over time through a filter; a bench table has --report.")
        write_before_after((actuator, result.model), measured, picture)
        print(f"written: {picture}")
    if report is not None:
        from femfit.report.bench_report import render_added
        from femfit.report.page import write_page
        from femfit.report.write import hashes

        with status("Writing the report"):
            write_page(render_added(result, hashes((model, data))), report)
        print(f"written: {report}")


def _runs(
    effect: str, measured: "Measurement", first: int | None, last: int | None
) -> dict[str, tuple[int, int]] | None:
    """The runs in which an effect acts, where they were given."""
    if first is None and last is None:
        return None
    count = len(set(measured.rows["run"])) if "run" in measured.rows else 1
    return {effect: (first or 1, last or count)}
