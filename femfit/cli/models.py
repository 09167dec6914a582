"""What a model is good for: ``femfit simulate``, ``sense``, ``audit``, ``tolerance`` and ``export``."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import AT_LEAST_ONE, NOT_NEGATIVE, OUTPUT, Outcome, Writes, command
from femfit.cli.keywords import Keywords
from femfit.cli.output import progress, status
from femfit.core.errors import UsageError
from femfit.core.files import LOOP, MODEL, OPEN_LOOP, PICTURE

_DRIVE = Keywords(
    "simulate",
    "voltage_V=voltage current_A=current drive duration_s=duration-ms start_m=start-mm sample_time_s=step-ms"
    " interpolation",
)
_LOOP = Keywords(
    "close_loop",
    "controller estimator=filter gains=gain bandwidth_rad_s latency faulty offset drift_per_s force_scale stuck_after_s"
    " dropout seconds plant",
)
_SENSED = Keywords("close_loop", "sensors=sensor noise")
_SENSING = Keywords(
    "sense", "sensors voltage_V=voltage drive test_voltage_V=test-voltage test_frequency_Hz runs rng=seed"
)
_SCATTER = Keywords("analyse_tolerances", "currents_A=current-A quantity=of")
_TARGET = Keywords("export", "to filter real sensors")
_SERIES = Writes(lambda arguments: OPEN_LOOP if arguments["drive"] or arguments["extrapolate"] else LOOP)


@command()
def simulate(
    model: Path,
    *,
    drive: Annotated[dict[str, Any], _DRIVE],
    extrapolate: bool = False,
    picture: Annotated[Path | None, Writes(PICTURE)] = None,
    loop: Annotated[dict[str, Any], _LOOP],
    runs: Annotated[int | None, AT_LEAST_ONE] = None,
    sensed: Annotated[dict[str, Any], _SENSED],
    seed: Annotated[int, NOT_NEGATIVE] = 1,
    csv: Annotated[Path | None, _SERIES] = None,
) -> Outcome:
    """Drive a model in open loop, or close the loop: controller, filter, sensors, steps, noise, faults.

    With --voltage, --current or --drive: pull-in and drop-out, switching times, seating velocity, bounces, energies.

    Otherwise the loop is closed. Without --controller, --filter, --runs, --seconds, --plant, --csv, --picture, gains
    or a fault: which controllers hold the body over the reference steps, and how well filter and direct measurement
    tell the distance.

    Parameters
    ----------
    model : Path
        Model file with circuit and motion, and for a closed loop a sensor.
    extrapolate : bool
        Motion in open loop that goes on where distance or current leave the validity domain.
    picture : Path
        Picture of the open loop, or of one run of the closed one (.png, .svg, .pdf).
    runs : int
        Number of repeats of one loop with different noise; default: 1.
    seed : int
        Seed of the noise.
    csv : Path
        File for the time series of the open loop, or of up to ten runs.
    """
    from femfit.report.style import write_picture
    from femfit.simulation.close_loop import closed_loop_study

    driven, looped = bool(drive) or extrapolate, bool(loop) or runs is not None
    if driven and (looped or sensed):
        raise UsageError(
            "--voltage, --current and --drive simulate in open loop, without controller, filter, noise and faults. "
            "Leave out the options of one of the two."
        )
    result: ff.OpenLoop | ff.LoopSummary
    if driven:
        result = ff.simulate(model, **drive, outside="extrapolate" if extrapolate else "stop")
        data = result.to_dict()
    else:
        actuator = ff.read_model(model)
        with progress(actuator.name, "samples") as show:
            shown: dict[str, Any] = {"progress": lambda stage, done, total: show(done, total, stage)}
            if not (looped or csv or picture):
                study = closed_loop_study(actuator, seed, **sensed, **shown)
                return Outcome(study)
            recorded = 10 if csv is not None else 0 if picture is None else 1
            result = ff.close_loop(actuator, **loop, **sensed, **shown, runs=runs or 1, rng=seed, recorded=recorded)
        data = {"seed": seed, **result.to_dict()}
    return Outcome(result, data, [(csv, result.write_csv), (picture, partial(write_picture, result.plot))])


@command(
    picture="PNG, SVG or PDF with the motion, the filter's error and its bound.",
    csv="File for time, distance, the filter's error, what it claims, and the bound.",
)
def sense(model: Path, *, options: Annotated[dict[str, Any], _SENSING]) -> Outcome:
    """How well the current tells the distance: error in simulation, and bound.

    Parameters
    ----------
    model : Path
        Model file with circuit, motion and the sensors.
    """
    with status("Simulating"):
        return Outcome(ff.sense(model, **options))


@command("File for the findings as JSON.")
def audit(model: Path, *, table: Path | None = None) -> Outcome:
    """Check a model against its table, physics and supply; exits with 1 if wrong.

    Parameters
    ----------
    model : Path
        Model file (.json).
    table : Path
        Sweep table that the model was fitted to, or its directory; default: the one beside the model.

    The exit code is 1 where something is wrong, 0 where it holds or is only worth a look.
    """
    from femfit.audit.audit_model import audit_model

    result = audit_model(model, table)
    wrong = SystemExit(1) if result.count("wrong") else None
    return Outcome(result, {"file": model.name, **result.to_dict()}, error=wrong)


@command()
def tolerance(sweep: Path, *, distance_mm: float, options: Annotated[dict[str, Any], _SCATTER]) -> Outcome:
    """How a series of devices scatters by the drawing's tolerances.

    Parameters
    ----------
    sweep : Path
        Directory of a sweep with --signatures.
    distance_mm : float
        Distance in mm, of which the nearest swept point is taken.
    """
    return Outcome(ff.analyse_tolerances(sweep, distance_m=1e-3 * distance_mm, **options))


@command()
def export(
    model: Path,
    *,
    options: Annotated[dict[str, Any], _TARGET],
    output: Annotated[Path, OUTPUT, Writes(MODEL, "model.json")],
) -> Outcome:
    """Export a model: filters and simulator in C or in Python alone.

    Parameters
    ----------
    model : Path
        Model file.
    output : Path
        Directory that is absent, empty, or an earlier export.
    """
    return Outcome(ff.export(model, output, **options))
