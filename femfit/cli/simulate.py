"""``femfit simulate``: close the loop around a model, or drive it in open loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

import femfit as ff
from femfit.cli.command import (
    AT_LEAST_ONE,
    NOT_NEGATIVE,
    POSITIVE,
    Outcome,
    ToWrite,
    Writes,
    command,
    in_si,
    pairs,
    parsed,
)
from femfit.core.errors import UsageError
from femfit.core.files import LOOP, OPEN_LOOP, PICTURE, Kind

ControllerOption = Literal["backstepping", "pid", "state-feedback"]
FilterOption = Literal["direct", "ukf", "ekf", "ukf4", "ekf4"]


@Parameter(name="*")
@dataclass(frozen=True)
class OpenLoopOptions:
    """What drives a model in open loop: any of these asks for one.

    Attributes
    ----------
    voltage : str
        Constant command in V in open loop; for several circuits by their names, as bias=2,diff=1.
    current : str
        Constant command in A of a current amplifier in open loop; for several circuits by their names.
    drive : Path
        Table with the columns time_s and voltage_V or current_A (voltage_NAME_V or current_NAME_A) for the open loop.
    duration_ms : float
        Duration of the open loop in ms; default: up to the table's last time, or 100.
    start_mm : float
        Distance in mm at which the body begins in open loop; default: where it rests without current.
    sample_time_ms : float
        Time in ms between two rows of the open loop's table; default: a 2000th of its duration.
    extrapolate : bool
        Motion in open loop that goes on where distance or current leave the validity domain.
    """

    voltage: str | None = None
    current: str | None = None
    drive: Path | None = None
    duration_ms: Annotated[float | None, POSITIVE] = None
    start_mm: float | None = None
    sample_time_ms: Annotated[float | None, Parameter(name="--step-ms"), POSITIVE] = None
    extrapolate: bool = False

    @property
    def keywords(self) -> dict[str, Any]:
        """All of them, as the library's open loop takes them."""
        options = in_si(self)
        texts = {name: (options.pop(name) or "").split(",") for name in ("voltage", "current")}
        voltage, current = (_by_name(f"--{name}", texts[name], "CIRCUIT", "bias=2,diff=1") for name in texts)
        outside = "extrapolate" if options.pop("extrapolate") else "stop"
        return {**options, "voltage_V": voltage, "current_A": current, "outside": outside}


@Parameter(name="*")
@dataclass(frozen=True)
class LoopOptions:
    """What a single closed loop is made of: any of these asks for one.

    Attributes
    ----------
    controller : str
        Controller: pid, state-feedback or backstepping; default: the one whose linear loop keeps the largest margin, or
        pid where gains are given; all of them where no option asks for a single loop.
    estimator : str
        Filter: ukf4 (default of one loop) or ekf4, which estimate the first sensor's bias as a further state; ukf or
        ekf, which do not; or direct, which inverts the first sensor's characteristic without a filter.
    gains : list of str
        Gain of the controller in place of the designed one, as in kp=2000; may be repeated; of pid: kp, ki, kd,
        filter_rad_s; of backstepping: position, velocity, current; of state-feedback: distance, velocity, current,
        integral.
    bandwidth_rad_s : float
        Bandwidth of the controller in rad/s, in place of the one that its margins and the noise allow.
    latency : int
        Number of samples from a reading to the command that it leads to.
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
    plant : Path
        Model file of what truly moves and is truly sensed, while controller and filter believe in MODEL.
    """

    controller: ControllerOption | None = None
    estimator: Annotated[FilterOption | None, Parameter(name="--filter")] = None
    gains: Annotated[list[str] | None, Parameter(name="--gain")] = None
    bandwidth_rad_s: Annotated[float | None, POSITIVE] = None
    latency: Annotated[int, NOT_NEGATIVE] = 0
    faulty: str | None = None
    offset: float = 0.0
    drift_per_s: float = 0.0
    force_scale: Annotated[float, POSITIVE] = 1.0
    stuck_after_s: Annotated[float | None, NOT_NEGATIVE] = None
    dropout: Annotated[float, Parameter(validator=Number(gte=0.0, lte=1.0))] = 0.0
    runs: Annotated[int | None, AT_LEAST_ONE] = None
    seconds: Annotated[float | None, POSITIVE] = None
    plant: Path | None = None

    @property
    def keywords(self) -> dict[str, Any]:
        """All of them, as the library's closed loop takes them."""
        gains = pairs(self.gains or (), "--gain", "NAME=NUMBER", "kp=2000", float)
        return vars(self) | {"estimator": self.estimator or "ukf4", "runs": self.runs or 1, "gains": gains}


_UNDRIVEN, _NO_LOOP = OpenLoopOptions(), LoopOptions()


def _series(arguments: Mapping[str, Any]) -> Kind:
    return LOOP if arguments["drive_options"] == _UNDRIVEN else OPEN_LOOP


@command()
def simulate(
    model: Path,
    *,
    drive_options: OpenLoopOptions = _UNDRIVEN,
    interpolation: Literal["held", "linear"] = "held",
    picture: Annotated[Path | None, Writes(PICTURE)] = None,
    loop_options: LoopOptions = _NO_LOOP,
    sensor: list[str] | None = None,
    noise: list[str] | None = None,
    seed: Annotated[int, NOT_NEGATIVE] = 1,
    csv: Annotated[Path | None, Writes(_series)] = None,
) -> Outcome:
    """Drive a model in open loop, or close the loop around it.

    With --voltage, --current or --drive: pull-in and drop-out, switching times, seating velocity, bounces, energies.

    Otherwise the loop is closed: controller, filter, sensors, steps, noise, faults. Without --controller, --filter,
    --runs, --seconds, --plant, --csv, --picture, gains or a fault: which controllers hold the body over the reference
    steps, and how well filter and direct measurement tell the distance.

    Parameters
    ----------
    model : Path
        Model file with circuit and motion, and for a closed loop a sensor.
    interpolation : str
        Interpolation of the drive table: held (each value up to the next time) or linear.
    picture : Path
        Picture of the open loop, or of one run of the closed one (.png, .svg, .pdf).
    sensor : list of str
        Sensor that the loop reads, by its name in the drawing; may be repeated; default: the Hall element, or all.
    noise : list of str
        White noise of a sensor's sample in its unit, as in laser=0.002, or a number alone for the first sensor; may be
        repeated; default: the model's.
    seed : int
        Seed of the noise.
    csv : Path
        File for the time series of the open loop, or of up to ten runs.
    """
    from femfit.cli.output import progress
    from femfit.report.style import write_picture
    from femfit.simulation.close_loop import closed_loop_study

    driven, looped = drive_options != _UNDRIVEN, loop_options != _NO_LOOP
    if driven and (looped or noise is not None or sensor is not None):
        raise UsageError(
            "--voltage, --current and --drive simulate in open loop, without controller, filter, noise and faults. "
            "Leave out the options of one of the two."
        )
    files: list[ToWrite]
    if driven:
        motion = ff.simulate(model, interpolation=interpolation, **drive_options.keywords)
        files = [(csv, motion.write_csv), (picture, partial(write_picture, motion.plot))]
        return Outcome(motion, files=files)
    actuator = ff.read_model(model)
    white = _by_name("--noise", noise, "SENSOR", "laser=0.002")
    with progress(actuator.name, "samples") as show:

        def shown(part: str, done: int, total: int) -> None:
            show(done, total, part)

        if not (looped or csv or picture):
            study = closed_loop_study(actuator, seed, white, sensors=sensor, progress=shown)
            return Outcome(study, study.data())
        recorded = 10 if csv is not None else 0 if picture is None else 1
        summary = ff.close_loop(
            actuator, **loop_options.keywords, rng=seed, sensors=sensor, noise=white, recorded=recorded, progress=shown
        )
    files = [(csv, summary.write_csv), (picture, partial(write_picture, summary.plot))]
    return Outcome(summary, {"seed": seed, **summary.data()}, files)


def _by_name(option: str, texts: Sequence[str] | None, form: str, example: str) -> float | dict[str, float] | None:
    """One number, or one by each name."""
    given = [text for text in texts or () if text]
    if len(given) == 1 and "=" not in given[0]:
        return parsed(given[0], option, "NUMBER", f"{option} 12, or {option} {example}", float)
    return pairs(given, option, f"{form}=NUMBER", f"{option} {example}", float) or None
