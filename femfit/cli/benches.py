"""Measurements beside a model: ``femfit compare``, ``diagnose``, ``add``, ``calibrate``, ``suggest`` and ``trial``."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import (
    AT_LEAST_ONE,
    OUTPUT,
    Cores,
    Default,
    MeasurementOptions,
    Outcome,
    ToWrite,
    Writes,
    command,
    run_directory,
)
from femfit.cli.keywords import Keywords
from femfit.cli.output import progress, status
from femfit.core.errors import UsageError
from femfit.core.files import DRAWING, MODEL, PAGE, PICTURE, RESULT, write_json, write_text
from femfit.core.text import counted

_EXCLUDED = Keywords("diagnose", "exclude")
_TEMPERATURES = Keywords("add_effects", "coil_temperature_C magnet_temperature_C")
_NUMBERS = Keywords("calibrate", "numbers effects=with")

_CALIBRATED, _AS_DRAWN, _RESULTS = "calibrated/model.json", "drawn/model.json", "results.json"


@command(
    "File for the result as JSON, with the maps.",
    report="HTML file with measured points on the model's curves, and maps of the misfit.",
)
def compare(model: Path, data: Path, *, table_options: MeasurementOptions) -> Outcome:
    """How far a model is from measurements, against their noise, and where.

    Parameters
    ----------
    model : Path
        Model file (co-energy or law), or a sweep table (Parquet, CSV or its directory) whose co-energy is fitted on the
        fly.
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    """
    with status("Comparing"):
        predicting = model if model.suffix == ".json" else ff.fit_model(model).model
        return Outcome(ff.compare(predicting, ff.read_measurement(data, **table_options)))


@command()
def diagnose(
    model: Path,
    data: Path,
    *,
    options: Annotated[dict[str, Any], _EXCLUDED],
    report: Annotated[Path | None, Writes(PAGE)] = None,
    table_options: MeasurementOptions,
) -> Outcome:
    """Name the effect that measurements show and the model lacks.

    Parameters
    ----------
    model : Path
        Model file; best the co-energy reference (femfit fit TABLE).
    data : Path
        Bench table, or record over time (with a column time_s): CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with its
        sidecar .toml beside it where noise is declared.
    report : Path
        HTML file with what was measured, where the model fails, what would explain it, and what to measure next.
    """
    from femfit.report.bench_report import render_diagnosis
    from femfit.report.page import write_page
    from femfit.report.write import hashes

    with status("Reading") as say:
        measured = ff.read_measurement(data, **table_options)
        result = ff.diagnose(model, measured, **options, progress=say)

    def page(path: Path) -> None:
        with status("Finding what to measure next") as say:
            advice = ff.suggest(result.model, measured, result, progress=say).suggestions
            say("Writing the report")
            write_page(render_diagnosis(result, measured, suggestions=advice, hashes=hashes((model, data))), path)

    return Outcome(result, files=[(report, page)])


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
    options: Annotated[dict[str, Any], _TEMPERATURES],
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
    record, before = result.to_dict() | {"data": data.name}, result.model.provenance
    remembering = replace(result.model, provenance={**before, "added": [*before.get("added", []), record]})
    files: list[ToWrite] = [
        (output if result.accepted else None, partial(ff.write_model, remembering)),
        (picture, lambda path: write_before_after((actuator, result.model), cast("ff.TimeSeries", measured), path)),
    ]
    return Outcome(result, record, files)


@command("File for the result as JSON, with the covariance.")
def calibrate(
    drawing: Path,
    *data: Path,
    output: Annotated[Path, OUTPUT, Writes(DRAWING)],
    options: Annotated[dict[str, Any], _NUMBERS],
    runs: Annotated[
        Path, Default(run_directory("drawing", "-calibration")), Writes(MODEL, _CALIBRATED), Writes(MODEL, _AS_DRAWN)
    ],
    workers: Cores,
    table_options: MeasurementOptions,
) -> Outcome:
    """Find a drawing's wrong numbers from measurements; write it anew.

    Parameters
    ----------
    drawing : Path
        Actuator file (.toml), whose [tolerances] say how far its numbers may be off.
    data : Path
        Bench tables, or records over time, whose runs count together: CSV, Parquet, XLSX, MAT, HDF5, TDMS or WAV, with
        their sidecars .toml beside them where noise is declared.
    output : Path
        Actuator file for the drawing as the data have it, with the comments and the layout of the old one; not written
        where the numbers do not settle.
    runs : Path
        Directory of the sweeps, in which nothing is solved twice; runs/NAME-calibration by default.
    workers : int
        Number of processes on this machine; one a core by default.
    """
    from femfit.identify.calibration.result import heading

    if not data:
        raise UsageError("No measurement is given. Give a bench table, or a record over time, behind the drawing.")
    with status("Reading") as say:
        measured = [ff.read_measurement(file, **table_options) for file in data]
        result = ff.calibrate(drawing, measured, runs, **options, workers=workers, progress=say)
    model, names = runs / _CALIBRATED, [file.name for file in data]
    ff.write_model(result.model, model)
    ff.write_model(result.model_as_drawn, runs / _AS_DRAWN)
    if result.settled:
        write_text(output, heading(result, drawing.name, names) + result.drawing)
    written = f"written: {f'{output}, ' * result.settled}its sweep in {model.parent} and its model {model}"
    lines = f"{result}\n{written}\nNext: femfit compare {model} {data[0]}"
    return Outcome(lines, result.to_dict() | {"drawing": drawing.name, "data": names})


@command()
def suggest(
    model: Path, data: Path | None = None, *, plan: Path | None = None, table_options: MeasurementOptions
) -> Outcome:
    """The next measurement that separates what is still confounded.

    Parameters
    ----------
    model : Path
        Model file.
    data : Path
        Bench table, or record over time, that was diagnosed.
    plan : Path
        Planned bench table with settings and a column (its cells may be empty) for each channel to be read, examined
        for what it could never separate.
    """
    from femfit.identify.plan import examine_plan
    from femfit.tables.measurement_file import read_bench_table

    with status("Diagnosing") as say:
        if plan is not None and data is None:
            planned = read_bench_table(plan, planned=True, **table_options)
            return Outcome(examine_plan(ff.read_model(model), planned))
        if data is not None and plan is None:
            return Outcome(ff.suggest(model, ff.read_measurement(data, **table_options), progress=say))
    raise UsageError("Give either a bench table that was measured, or a planned one with --plan PLAN.csv.")


@command()
def trial(
    *,
    drawing: Path,
    output: Annotated[Path, OUTPUT, Writes(RESULT, _RESULTS)],
    cases: Annotated[int, AT_LEAST_ONE] = 60,
    seed: int = 1,
    workers: Annotated[int, AT_LEAST_ONE] = 2,
) -> Outcome:
    """How often the diagnosis is right, on campaigns with a hidden effect.

    Hidden are numbers of the drawing that are off (remanence, turns, saturating iron), of which the field is solved
    again, and errors of the bench (stage, meters, resistance, temperatures), which act by their definition. Each
    campaign is diagnosed from its files as femfit diagnose would.

    Parameters
    ----------
    drawing : Path
        Actuator file.
    output : Path
        Directory for campaigns, what was hidden in them, diagnoses and results.json; field solutions in it are used
        again.
    cases : int
        Number of campaigns; 60 take some minutes.
    seed : int
        Seed of the campaigns.
    workers : int
        Number of processes.
    """
    from femfit.trial.campaigns import diagnose_campaigns, make_campaigns, prepare_device
    from femfit.trial.counts import trial_data, trial_lines

    with progress("solve the fields", "points") as show:
        device = prepare_device(
            drawing, output, workers=workers, progress=lambda done: show(done.points_done, done.points)
        )
    numbers = make_campaigns(device, output, cases, seed)
    with progress("diagnose", "campaigns") as show:
        outcomes = diagnose_campaigns(output, numbers, workers=workers, progress=show)
    lines = trial_lines(outcomes)
    if len(numbers) < cases:
        omitted = counted(cases - len(numbers), "campaign")
        lines = [*lines, f"left out: {omitted} of which the device cannot show what was to be hidden"]
    data = trial_data(outcomes)
    return Outcome("\n".join(lines), data, [(output / _RESULTS, partial(write_json, data=data))])
