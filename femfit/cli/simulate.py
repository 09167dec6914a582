"""``femfit simulate``: close the loop around a model, or drive it in open loop."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import AT_LEAST_ONE, NOT_NEGATIVE, Outcome, ToWrite, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.errors import UsageError
from femfit.core.files import LOOP, OPEN_LOOP, PICTURE

_DRIVE = Keywords(
    "femfit.simulation.open_loop:simulate",
    "voltage_V=voltage current_A=current drive duration_s=duration-ms start_m=start-mm sample_time_s=step-ms"
    " interpolation",
)
_LOOP = Keywords(
    "femfit.simulation.close_loop:close_loop",
    "controller estimator=filter gains=gain bandwidth_rad_s latency faulty offset drift_per_s force_scale stuck_after_s"
    " dropout seconds plant",
)
_SENSED = Keywords("femfit.simulation.close_loop:close_loop", "sensors=sensor noise")


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
    csv: Annotated[
        Path | None, Writes(lambda arguments: OPEN_LOOP if arguments["drive"] or arguments["extrapolate"] else LOOP)
    ] = None,
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
    from femfit.cli.output import progress
    from femfit.report.style import write_picture
    from femfit.simulation.close_loop import closed_loop_study

    driven, looped = bool(drive) or extrapolate, bool(loop) or runs is not None
    if driven and (looped or sensed):
        raise UsageError(
            "--voltage, --current and --drive simulate in open loop, without controller, filter, noise and faults. "
            "Leave out the options of one of the two."
        )
    files: list[ToWrite]
    if driven:
        motion = ff.simulate(model, **drive, outside="extrapolate" if extrapolate else "stop")
        files = [(csv, motion.write_csv), (picture, partial(write_picture, motion.plot))]
        return Outcome(motion, files=files)
    actuator = ff.read_model(model)
    with progress(actuator.name, "samples") as show:

        def shown(part: str, done: int, total: int) -> None:
            show(done, total, part)

        if not (looped or csv or picture):
            study = closed_loop_study(actuator, seed, **sensed, progress=shown)
            return Outcome(study, study.data())
        recorded = 10 if csv is not None else 0 if picture is None else 1
        summary = ff.close_loop(actuator, **loop, **sensed, runs=runs or 1, rng=seed, recorded=recorded, progress=shown)
    files = [(csv, summary.write_csv), (picture, partial(write_picture, summary.plot))]
    return Outcome(summary, {"seed": seed, **summary.data()}, files)
