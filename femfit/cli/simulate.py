"""``femfit simulate``: close the loop around a model, or drive it in open loop."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.core.errors import UsageError

ControllerOption = Literal["backstepping", "pid"]
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
    extrapolate: Annotated[bool, Parameter(negative=())] = False,
    picture: Path | None = None,
    controller: ControllerOption | None = None,
    observer: Annotated[FilterOption | None, Parameter(name="--filter")] = None,
    noise_mV: Annotated[float | None, Parameter(name="--noise-mV", validator=Number(gte=0.0))] = None,
    hall_bias_mV: Annotated[float, Parameter(name="--hall-bias-mV")] = 0.0,
    drift_mV_per_s: Annotated[float, Parameter(name="--drift-mV-per-s")] = 0.0,
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

    Otherwise the loop is closed: controller, filter, sensor, steps, noise, faults. Without --controller, --filter,
    --runs, --seconds, --plant, --csv or a fault: which controllers hold the body, how well the filters measure, and
    what a Hall offset, a force error, a wrong start and no filter do.

    Parameters
    ----------
    model : Path
        Model file with circuit and motion, and for a closed loop a sensor.
    voltage : str
        Constant command in V: open loop. Of several circuits by their names, as bias=2,diff=1.
    current : str
        Constant command in A of a current amplifier: open loop; of several by their names.
    drive : Path
        Table with the columns time_s and voltage_V or current_A (voltage_NAME_V or current_NAME_A): open loop.
    interpolation : str
        Of that table: held (each value up to the next time) or linear.
    duration_ms : float
        Of the open loop; default: up to the table's last time, or 100.
    start_mm : float
        Where the body begins in open loop; default: where it rests without current.
    extrapolate : bool
        Go on in open loop where distance or current leave the validity domain.
    picture : Path
        File for a picture of the open loop (.png, .svg, .pdf).
    controller : str
        pid (default) or backstepping.
    observer : str
        ukf4 (default) or ekf4, which estimate the Hall offset as a fourth state; ukf or ekf, which do not; or direct,
        which inverts the Hall voltage without a filter.
    noise_mV : float
        White noise of a Hall sample; default: the model's.
    hall_bias_mV : float
        Offset of the Hall sensor that the model does not know.
    drift_mV_per_s : float
        Ramp of that offset.
    force_scale : float
        True force over the model's.
    stuck_after_s : float
        From then on the sensor repeats its last reading.
    dropout : float
        Probability of a reading at the lower end of the sensor's range.
    runs : int
        Repeats of one loop with different noise; default 1.
    seconds : float
        Of one loop; default 1 a reference distance.
    seed : int
        Of the noise.
    plant : Path
        Model file of what truly moves and is truly sensed, while controller and filter believe in MODEL.
    csv : Path
        File for the time series: of the open loop, or of up to ten runs.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.outputs import LOOP, RESULT, require_outputs
    from femfit.model.json_file import read_model

    chosen = (controller, observer, runs, seconds, plant, csv, stuck_after_s)
    faults = (hall_bias_mV, drift_mV_per_s, force_scale - 1.0, dropout)
    open_loop = (voltage, current, drive, duration_ms, start_mm, picture)
    if any(choice is not None for choice in open_loop) or extrapolate:
        if any(choice is not None for choice in (*chosen[:5], stuck_after_s, noise_mV)) or any(faults):
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
            },
            duration_s=None if duration_ms is None else 1e-3 * duration_ms,
            start_m=None if start_mm is None else 1e-3 * start_mm,
            outside="extrapolate" if extrapolate else "stop",
            files=(csv, json, picture),
        )
        return
    require_outputs([model, plant], (csv, LOOP), (json, RESULT))
    actuator = read_model(model)
    noise = None if noise_mV is None else 1e-3 * noise_mV
    if all(choice is None for choice in chosen) and not any(faults):
        from femfit.simulation.study import closed_loop_study

        study = closed_loop_study(actuator, seed, noise)
        print(study)
        write_json(json, study.data())
        return
    from femfit.simulation.close_loop import close_loop

    summary = close_loop(
        actuator,
        controller=controller or "pid",
        estimator=observer or "ukf4",
        runs=1 if runs is None else runs,
        seconds=seconds,
        plant=plant,
        rng=seed,
        noise_V=noise,
        hall_offset_V=1e-3 * hall_bias_mV,
        drift_V_per_s=1e-3 * drift_mV_per_s,
        force_scale=force_scale,
        stuck_after_s=stuck_after_s,
        dropout=dropout,
        recorded=0 if csv is None else 10,
    )
    print(summary)
    write_json(json, {"seed": seed, **summary.data()})
    if csv is not None:
        summary.write_csv(csv)
        print(f"written: {csv}")


def _constant(option: str, text: str | None) -> float | dict[str, float] | None:
    """One number, or one by the name of each circuit."""
    if text is None:
        return None
    try:
        if "=" not in text:
            return float(text)
        pairs = (part.partition("=") for part in text.split(","))
        return {name.strip(): float(value) for name, _, value in pairs}
    except ValueError as error:
        raise UsageError(
            f"{option} must be a number, or one for each of several circuits; instead received {text!r}. Give it as "
            f"{option} 12, or {option} bias=2,diff=1."
        ) from error


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
    from femfit.core.outputs import OPEN_LOOP, PICTURE, RESULT, require_outputs
    from femfit.open_loop.simulate import simulate as simulate_open_loop

    csv, json, picture = files
    require_outputs([model, command["drive"]], (csv, OPEN_LOOP), (json, RESULT), (picture, PICTURE))
    motion = simulate_open_loop(model, **command, duration_s=duration_s, start_m=start_m, outside=outside)
    print(motion)
    write_json(json, motion.to_dict())
    if csv is not None:
        motion.write_csv(csv)
        print(f"written: {csv}")
    if picture is not None:
        from femfit.report.open_loop_figure import write_open_loop_picture

        write_open_loop_picture(motion, picture)
        print(f"written: {picture}")
