"""``femfit simulate``: close the loop around a model, or drive it in open loop."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.core.errors import UsageError

ControllerOption = Literal["backstepping", "pid", "state-feedback"]
FilterOption = Literal["direct", "ukf", "ekf", "ukf4", "ekf4"]


def simulate(
    model: Path,
    *,
    voltage: str | None = None,
    current: str | None = None,
    drive: Path | None = None,
    interpolation: Literal["held", "linear"] = "held",
    duration_ms: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None,
    start_mm: float | None = None,
    step_ms: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None,
    extrapolate: Annotated[bool, Parameter(negative=())] = False,
    picture: Path | None = None,
    controller: ControllerOption | None = None,
    observer: Annotated[FilterOption | None, Parameter(name="--filter")] = None,
    sensor: list[str] | None = None,
    gain: list[str] | None = None,
    bandwidth_rad_s: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None,
    pole_rad_s: Annotated[list[complex] | None, Parameter(name="--pole-rad-s", allow_leading_hyphen=True)] = None,
    latency: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    noise: list[str] | None = None,
    faulty: str | None = None,
    offset: float = 0.0,
    drift_per_s: float = 0.0,
    force_scale: Annotated[float, Parameter(validator=Number(gt=0.0))] = 1.0,
    stuck_after_s: Annotated[float | None, Parameter(validator=Number(gte=0.0))] = None,
    dropout: Annotated[float, Parameter(validator=Number(gte=0.0, lte=1.0))] = 0.0,
    runs: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    seconds: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1,
    plant: Path | None = None,
    csv: Path | None = None,
    json: Path | None = None,
) -> None:
    """Drive a model in open loop, or close the loop around it.

    With --voltage, --current or --drive: pull-in and drop-out, switching times, seating velocity, bounces, energies.

    Otherwise the loop is closed: controller, filter, sensors, steps, noise, faults. Without --controller, --filter,
    --runs, --seconds, --plant, --csv, --picture, gains or a fault: which controllers hold the body, how well the
    filters measure, and what a sensor offset, a force error, a wrong start and no filter do.

    Parameters
    ----------
    model : Path
        Model file with circuit and motion, and for a closed loop a sensor.
    voltage : str
        Constant command in V in open loop; for several circuits by their names, as bias=2,diff=1.
    current : str
        Constant command in A of a current amplifier in open loop; for several circuits by their names.
    drive : Path
        Table with the columns time_s and voltage_V or current_A (voltage_NAME_V or current_NAME_A) for the open loop.
    interpolation : str
        Interpolation of the drive table: held (each value up to the next time) or linear.
    duration_ms : float
        Duration of the open loop in ms; default: up to the table's last time, or 100.
    start_mm : float
        Distance in mm at which the body begins in open loop; default: where it rests without current.
    step_ms : float
        Time in ms between two rows of the open loop's table; default: a 2000th of its duration.
    extrapolate : bool
        Motion in open loop that goes on where distance or current leave the validity domain.
    picture : Path
        Picture of the open loop, or of one run of the closed one (.png, .svg, .pdf).
    controller : str
        Controller: pid, state-feedback or backstepping; default: the one whose linear loop keeps the largest margin, or
        pid where gains are given; all of them where no option asks for a single loop.
    observer : str
        Filter: ukf4 (default of one loop) or ekf4, which estimate the first sensor's bias as a further state; ukf or
        ekf, which do not; or direct, which inverts the first sensor's characteristic without a filter.
    sensor : list of str
        Sensor that the loop reads, by its name in the drawing; may be repeated; default: the Hall element, or all.
    gain : list of str
        Gain of the controller in place of the designed one, as in kp=2000; may be repeated; of pid: kp, ki, kd,
        filter_rad_s; of backstepping: position, velocity, current; of state-feedback: distance, velocity, current,
        integral.
    bandwidth_rad_s : float
        Bandwidth of the controller in rad/s, in place of the one that its margins and the noise allow.
    pole_rad_s : list of complex
        Pole of state feedback in rad/s, as in -40 or -40+30j; once for each of distance, velocity, current and
        integral.
    latency : int
        Number of samples from a reading to the command that it leads to.
    noise : list of str
        White noise of a sensor's sample in its unit, as in laser=0.002, or a number alone for the first sensor; may be
        repeated; default: the model's.
    faulty : str
        Sensor with the offset, drift, sticking and dropouts; default: the first.
    offset : float
        Constant error of the faulty sensor in its unit, which the model does not know.
    drift_per_s : float
        Growth of the faulty sensor's offset in its unit per second.
    force_scale : float
        Ratio of the true force to the model's.
    stuck_after_s : float
        Time in s from which the faulty sensor repeats its last reading.
    dropout : float
        Probability of a reading at the lower end of the faulty sensor's range.
    runs : int
        Number of repeats of one loop with different noise; default: 1.
    seconds : float
        Duration of one loop in s; default: 1 a reference distance, or 2000 samples and a step's time where that is
        less.
    seed : int
        Seed of the noise.
    plant : Path
        Model file of what truly moves and is truly sensed, while controller and filter believe in MODEL.
    csv : Path
        File for the time series of the open loop, or of up to ten runs.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import loop_progress, write_json
    from femfit.core.files import LOOP, PICTURE, RESULT, require_outputs
    from femfit.model.json_file import read_model

    loop = (controller, observer, runs, seconds, plant, gain, bandwidth_rad_s, pole_rad_s, faulty, stuck_after_s)
    chosen = (*loop, csv, picture)
    faults = (offset, drift_per_s, force_scale - 1.0, dropout, latency)
    open_loop = (voltage, current, drive, duration_ms, start_mm, step_ms)
    if any(choice is not None for choice in open_loop) or extrapolate:
        if any(choice is not None for choice in (*loop, noise, sensor)) or any(faults):
            raise UsageError(
                "--voltage, --current and --drive simulate in open loop, without controller, filter, noise and faults. "
                "Leave out the options of one of the two."
            )
        _open_loop(
            model,
            {
                "voltage_V": _constant("--voltage", voltage),
                "current_A": _constant("--current", current),
                "drive": drive,
                "interpolation": interpolation,
                "sample_time_s": None if step_ms is None else 1e-3 * step_ms,
            },
            duration_s=None if duration_ms is None else 1e-3 * duration_ms,
            start_m=None if start_mm is None else 1e-3 * start_mm,
            outside="extrapolate" if extrapolate else "stop",
            files=(csv, json, picture),
        )
        return
    require_outputs([model, plant], (csv, LOOP), (json, RESULT), (picture, PICTURE))
    actuator = read_model(model)
    white = noise_of(noise)
    if all(choice is None for choice in chosen) and not any(faults):
        from femfit.simulation.study import closed_loop_study

        with loop_progress(actuator.name) as shown:
            study = closed_loop_study(actuator, seed, white, sensors=sensor, progress=shown)
        print(study)
        write_json(json, study.data())
        return
    from femfit.simulation.close_loop import close_loop

    with loop_progress(actuator.name) as shown:
        summary = close_loop(
            actuator,
            controller=controller,
            estimator=observer or "ukf4",
            runs=1 if runs is None else runs,
            seconds=seconds,
            plant=plant,
            rng=seed,
            sensors=sensor,
            gains=dict(map(named_number, gain or ())),
            bandwidth_rad_s=bandwidth_rad_s,
            poles_rad_s=pole_rad_s,
            latency=latency,
            noise=white,
            faulty=faulty,
            offset=offset,
            drift_per_s=drift_per_s,
            force_scale=force_scale,
            stuck_after_s=stuck_after_s,
            dropout=dropout,
            recorded=10 if csv is not None else 0 if picture is None else 1,
            progress=shown,
        )
    print(summary)
    write_json(json, {"seed": seed, **summary.data()})
    if csv is not None:
        summary.write_csv(csv)
        print(f"written: {csv}")
    if picture is not None:
        from femfit.report.loop_report import closed_loop_figure
        from femfit.report.style import write_picture

        write_picture(partial(closed_loop_figure, summary), picture)
        print(f"written: {picture}")


def _constant(option: str, text: str | None) -> float | dict[str, float] | None:
    """One number, or one by the name of each circuit."""
    if text is None:
        return None
    try:
        if "=" not in text:
            return float(text)
        pairs = (pair.partition("=") for pair in text.split(","))
        return {name.strip(): float(value) for name, _, value in pairs}
    except ValueError as error:
        raise UsageError(
            f"{option} must be a number, or one for each of several circuits; instead received {text!r}. Give it as "
            f"{option} 12, or {option} bias=2,diff=1."
        ) from error


def named_number(text: str) -> tuple[str, float]:
    """``kp=2000`` as a name and a number."""
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError as error:
        raise UsageError(
            f"A gain or noise must be given as NAME=NUMBER, as in kp=2000; instead received {text!r}."
        ) from error


def noise_of(texts: list[str] | None) -> dict[str, float] | float | None:
    """Noise by the sensors' names; a number alone is the first sensor's."""
    if not texts:
        return None
    if len(texts) == 1 and "=" not in texts[0]:
        return named_number(f"first={texts[0]}")[1]
    return dict(map(named_number, texts))


def _open_loop(
    model: Path,
    command: Mapping[str, Any],
    *,
    duration_s: float | None,
    start_m: float | None,
    outside: Literal["stop", "extrapolate"],
    files: tuple[Path | None, Path | None, Path | None],
) -> None:
    from femfit.cli.output import write_json
    from femfit.core.files import OPEN_LOOP, PICTURE, RESULT, require_outputs
    from femfit.simulation.open_loop import simulate as simulate_open_loop

    csv, json, picture = files
    require_outputs([model, command["drive"]], (csv, OPEN_LOOP), (json, RESULT), (picture, PICTURE))
    motion = simulate_open_loop(model, **command, duration_s=duration_s, start_m=start_m, outside=outside)
    print(motion)
    write_json(json, motion.to_dict())
    if csv is not None:
        motion.write_csv(csv)
        print(f"written: {csv}")
    if picture is not None:
        from femfit.report.motion_figures import open_loop_figure
        from femfit.report.style import write_picture

        write_picture(partial(open_loop_figure, motion), picture)
        print(f"written: {picture}")
