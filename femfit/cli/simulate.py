"""``femfit simulate``: close the loop around a model."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel
    from femfit.simulation.design import LoopDesign
    from femfit.simulation.experiment import Experiment

ControllerOption = Literal["backstepping", "pid"]
FilterOption = Literal["direct", "ukf", "ekf", "srukf", "ukf4", "ekf4", "srukf4"]


def simulate(
    model: Path,
    *,
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
    """Close the loop around a model: controller, filter, sensor, steps, noise, faults.

    Without --controller, --filter, --runs, --seconds, --plant, --csv or a fault: the paper's Table 6 with this model's
    numbers beside it, the noise bound, and what a Hall bias, a force error, a wrong start and direct feedback do.

    Parameters
    ----------
    model : Path
        Model file with circuit, motion and sensor.
    controller : str
        backstepping (default) or pid.
    observer : str
        ukf (default), ekf, srukf, each with a trailing 4 for the Hall bias as a fourth state, or direct.
    noise_mV : float
        White noise of a Hall sample; default: the model's, or 3.2.
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
        File for the time series of up to ten runs.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.outputs import RESULT, TABLE, require_outputs
    from femfit.model.json_file import read_model
    from femfit.simulation.design import design_loop
    from femfit.simulation.experiment import Experiment

    require_outputs([model, plant], (csv, TABLE), (json, RESULT))
    actuator = read_model(model)
    noise = None if noise_mV is None else 1e-3 * noise_mV
    chosen = (controller, observer, runs, seconds, plant, csv, stuck_after_s)
    faults = (hall_bias_mV, drift_mV_per_s, force_scale - 1.0, dropout)
    if all(choice is None for choice in chosen) and not any(faults):
        from femfit.simulation.study import closed_loop_study
        from femfit.simulation.text import study_data, study_lines

        study = closed_loop_study(actuator, seed, noise)
        print("\n".join(study_lines(study)))
        write_json(json, study_data(study))
        return
    design = design_loop(actuator, noise)
    experiment = Experiment(
        controller=controller or "backstepping",
        observer=observer or "ukf",
        targets_m=design.targets_m,
        force_scale=force_scale,
        offset_V=1e-3 * hall_bias_mV,
        drift_V_per_s=1e-3 * drift_mV_per_s,
        stuck_after_s=float("inf") if stuck_after_s is None else stuck_after_s,
        dropout_probability=dropout,
    )
    duration = float(len(design.targets_m)) if seconds is None else seconds
    truth = None if plant is None else read_model(plant)
    _repeat(design, experiment, truth, 1 if runs is None else runs, duration, seed, csv, json)


def _repeat(
    design: "LoopDesign",
    experiment: "Experiment",
    truth: "ActuatorModel | None",
    runs: int,
    duration: float,
    seed: int,
    csv: Path | None,
    json: Path | None,
) -> None:
    from dataclasses import asdict

    import numpy as np

    from femfit.cli.output import write_json
    from femfit.simulation.monte_carlo import monte_carlo
    from femfit.simulation.text import design_lines, json_ready, summary_lines
    from femfit.simulation.time_series_csv import write_time_series

    summary, result = monte_carlo(
        design,
        experiment,
        np.random.default_rng(seed),
        runs=runs,
        duration_s=duration,
        recorded=0 if csv is None else min(runs, 10),
        plant=truth,
    )
    loop = design.model.name if truth is None else f"{design.model.name} around the plant {truth.name}"
    print("\n".join([f"Closed loop of {loop}, seed {seed}", *design_lines(design), ""]))
    print("\n".join(summary_lines(summary)))
    write_json(
        json,
        {
            "model": design.model.name,
            "plant": truth.name if truth else None,
            "seed": seed,
            **json_ready(asdict(summary)),
        },
    )
    if csv is not None:
        write_time_series(csv, result)
        print(f"written: {csv}")
