"""Close the loop around a model, and say whether it held, how well, and if not, why.

Which loops of a model hold, and how well they measure: every controller over the reference steps, on the same noise.
"""

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from math import ceil
from operator import attrgetter
from pathlib import Path

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.public import random_generator
from femfit.core.text import quoted
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.simulation.constants import SUPPORT_TIME_CONSTANTS
from femfit.simulation.controllers import ControllerName
from femfit.simulation.design import CONTROLLERS, LoopDesign, ObserverName, adjusted, design_loop
from femfit.simulation.experiment import Experiment, LoopRuns, direct_distance, run_together
from femfit.simulation.loop import LoopProgress
from femfit.simulation.margins import Margins
from femfit.simulation.summary import FILTER, Choice, ClosedLoopStudy, LoopSummary, StepRow

MOST_STEPS = 10**8
"""Conventional: samples of a run, whose record takes ten gigabytes and more."""


def close_loop(
    model: ActuatorModel | str | Path,
    *,
    controller: ControllerName | None = None,
    estimator: ObserverName = "ukf4",
    sensors: Sequence[str] | None = None,
    targets_m: Iterable[float] | None = None,
    runs: int = 20,
    seconds: float | None = None,
    plant: ActuatorModel | str | Path | None = None,
    rng: int | np.random.Generator = 1,
    gains: Mapping[str, float] | None = None,
    bandwidth_rad_s: float | None = None,
    latency: int = 0,
    noise: Mapping[str, float] | float | None = None,
    faulty: str | None = None,
    offset: float = 0.0,
    drift_per_s: float = 0.0,
    force_scale: float = 1.0,
    stuck_after_s: float | None = None,
    dropout: float = 0.0,
    recorded: int = 1,
    progress: LoopProgress | None = None,
) -> LoopSummary:
    """Simulate a closed loop many times with different noise.

    Controller, filter and reference are derived from the model.

    Parameters
    ----------
    model : ActuatorModel, str or Path
        What controller and filter believe, or its file.
    controller : {'pid', 'state-feedback', 'backstepping'} or None
        Controller: pid, state-feedback (a linear-quadratic regulator with an integral) or backstepping; by default the
        one whose linear loop keeps the largest margin of those that hold all runs, or pid where gains or a bandwidth
        are given.
    estimator : {'ukf4', 'ekf4', 'ukf', 'ekf', 'direct'}
        Filter: ukf4 or ekf4, which estimate the first sensor's bias as a further state; ukf or ekf, which do not; or
        direct, which inverts the first sensor's characteristic without a filter.
    sensors : sequence of str or None
        Sensors that the loop reads, by their names in the drawing; the Hall element by default, or all where there is
        none.
    targets_m : iterable of float or None
        Distances that the reference steps to in turn; those of the model where None.
    seconds : float > 0 or None
        Duration of one run in s; by default 1 s a reference distance, or 2000 samples and a step's time where that is
        less.
    plant : ActuatorModel, str, Path or None
        Model of what truly moves and is truly sensed, while controller and filter believe in the other.
    gains : mapping of str to float, or None
        Gains of the controller in place of the designed ones, as ``{"kp": 2000}``; of pid: kp, ki, kd, filter_rad_s; of
        backstepping: position, velocity, current; of state-feedback: distance, velocity, current, integral.
    bandwidth_rad_s : float > 0 or None
        Bandwidth of the controller in place of the one that its margins and the noise allow.
    latency : int >= 0
        Number of samples from a reading to the command that it leads to.
    noise : float, mapping of str to float, or None
        White noise of a sensor's sample in its unit, as ``{"laser": 0.002}``, or a number alone for the first sensor;
        the model's by default.
    faulty : str or None
        Sensor with the offset, drift, sticking and dropouts; the first by default.
    offset : float
        Constant error of the faulty sensor in its unit, which the model does not know.
    drift_per_s : float
        Growth of the faulty sensor's offset in its unit per second.
    force_scale : float > 0
        Ratio of the true force to the model's.
    stuck_after_s : float >= 0 or None
        Time from which the faulty sensor repeats its last reading.
    dropout : float >= 0 and <= 1
        Probability of a reading at the lower end of the faulty sensor's range.
    recorded : int
        Runs whose series are kept.
    progress : callable or None
        Called with what is simulated, the samples done and all of them, now and then.

    Raises
    ------
    MissingPartError
        If the model has no circuit, motion or sensor.
    DomainError
        If the body cannot be held at the reference distances, or an argument has no such value.

    Examples
    --------
    >>> import femfit as ff
    >>> loop = ff.close_loop("model.json", targets_m=(0.022,), runs=3, seconds=0.2, rng=1)
    >>> print(loop)
    Held: 3 of 3 runs of 0.2 s held the body; ... on ukf4, ...
    >>> loop.estimate_rms_m.median < 50e-6
    True
    """
    experiment = Experiment(
        controller or "pid", estimator, (), force_scale, faulty=faulty, offset=offset, drift_per_s=drift_per_s,
        stuck_after_s=np.inf if stuck_after_s is None else stuck_after_s, dropout_probability=dropout,
    )  # fmt: skip
    for name, count, least in (("runs", runs, 1), ("recorded", recorded, 0)):
        if not isinstance(count, int | np.integer) or count < least:
            raise DomainError(f"{name} must be a whole number >= {least}; instead received {name}={count!r}. Give 20.")
    if seconds is not None and not 0.0 < seconds < np.inf:
        raise DomainError(f"A closed loop must last a time > 0 s; instead received seconds={seconds:g}. Give 1, say.")
    random, truth = random_generator(rng), None if plant is None else model_of(plant)
    believed = with_reference(model_of(model), targets_m)
    design = design_loop(believed, noise, sensors=sensors, latency=latency)
    choice = {} if controller or gains or bandwidth_rad_s is not None else choose(design, estimator)
    experiment = replace(experiment, controller=next(iter(choice), experiment.controller), targets_m=design.targets_m)
    design = adjusted(design, experiment.controller, gains=gains, bandwidth_rad_s=bandwidth_rad_s)
    duration = len(design.targets_m) * design.stay_s if seconds is None else seconds
    run = partial(run_loops, design, runs=runs, duration_s=duration, recorded=recorded, plant=truth, progress=progress)
    # The best linear margin that holds all runs: steps of the reference may be more than a margin tells
    lost: list[ControllerName] = []
    for name in [name for name, margins in choice.items() if margins.stable]:
        noise_of_trial = deepcopy(random)
        (summary,) = run([replace(experiment, controller=name)], noise_of_trial, advised=False)
        if summary.held == summary.runs:
            random.bit_generator.state = noise_of_trial.bit_generator.state
            return replace(summary, choice=Choice(choice, tuple(lost)))
        lost.append(name)
    # Where none does, that of the best margin with the cause of its loss
    (summary,) = run([experiment], random)
    return replace(summary, choice=Choice(choice) if choice else None)


def with_reference(model: ActuatorModel, targets_m: Iterable[float] | None) -> ActuatorModel:
    """The model with these reference distances in place of its own."""
    try:
        return model if targets_m is None else replace(model, reference_distances_m=tuple(map(float, targets_m)))
    except (TypeError, ValueError) as error:
        raise DomainError(
            f"targets_m must be a list of distances in m; instead received {quoted(targets_m)}. Give [0.02], say."
        ) from error


def choose(design: LoopDesign, observer: ObserverName) -> dict[ControllerName, Margins]:
    """Which controller a loop has where none is asked for: their margins, the farthest from instability first.

    Every controller is designed, since that takes seconds. Of those that are stable with their filter, delays and
    drivers the one with the largest margins at its worst point of rest is the first, cut where noise takes too much of
    the commands' room; then come those that hardly use their sensors, and those that grow.

    Raises
    ------
    DomainError
        If no controller can be designed at all.
    """
    judged = [design.judged(name, observer) for name in CONTROLLERS]
    margins = {loop.controller: loop.margins for loop in judged if loop.margins is not None}
    if not margins:
        raise DomainError(" ".join(dict.fromkeys(loop.refusal for loop in judged)))

    rank = attrgetter("stable", "uses_sensors", "kept", "modulus", "slowest_pole_rad_s")
    return {name: margins[name] for name in sorted(margins, key=lambda name: rank(margins[name]), reverse=True)}


def run_loops(
    design: LoopDesign,
    experiments: Sequence[Experiment],
    random: np.random.Generator,
    *,
    runs: int,
    duration_s: float,
    recorded: int = 0,
    plant: ActuatorModel | None = None,
    progress: LoopProgress | None = None,
    advised: bool = True,
) -> list[LoopSummary]:
    """Repeat experiments that differ by their controllers alone, and sum each up while it runs on the same noise.

    Nothing is stored but what is to be recorded.

    Parameters
    ----------
    advised : bool
        Whether it is found out why runs are lost, by trials.
    """
    steps = max(1, round(duration_s / design.model.sample_time_s))
    if steps > MOST_STEPS:
        raise DomainError(
            f"A run must have at most {MOST_STEPS:.3g} samples; instead received {duration_s:g} s, {float(steps):.3g} "
            "samples. Simulate fewer seconds."
        )
    supported, noise = design.steps(SUPPORT_TIME_CONSTANTS), deepcopy(random)
    loops = [
        LoopRuns(design, experiment, noise, runs, steps, steps, supported, plant, progress)
        for experiment in experiments
    ]
    results = run_together(loops, "closed loop", random, recorded=recorded)
    return [LoopSummary.of(loop, result, advised=advised) for loop, result in zip(loops, results, strict=True)]


STUDIED_RUNS = 8
"""Conventional: repeats of the reference steps."""


def closed_loop_study(
    model: ActuatorModel,
    seed: int = 1,
    noise: Mapping[str, float] | float | None = None,
    *,
    sensors: Sequence[str] | None = None,
    progress: LoopProgress | None = None,
) -> ClosedLoopStudy:
    """Run every controller over the reference steps.

    The direct measurement is taken from the same readings as the filter's: root mean square of measured minus true
    distance over the whole run.

    Parameters
    ----------
    noise : mapping of str to float, float or None
        White noise of one sample by the sensors' names, or that of the first; the model's where None.
    sensors : sequence of str or None
        Which of the model's sensors the loops read; the Hall element, or all where there is none.
    progress : callable or None
        Called with what is simulated, the samples done and all of them, now and then.
    """
    design = design_loop(model, noise, sensors=sensors)
    if not design.controllers:
        raise DomainError(" ".join(design.why_no(name) for name in CONTROLLERS))
    samples = len(design.targets_m) * ceil(design.step_s / design.model.sample_time_s)
    experiments = [Experiment(name, FILTER, design.targets_m) for name in design.controllers]
    duration_s, runs, random = samples * design.model.sample_time_s, STUDIED_RUNS, np.random.default_rng(seed)
    loops = run_loops(
        design, experiments, random, runs=runs, duration_s=duration_s, recorded=runs, progress=progress, advised=False
    )
    rows = []
    for loop in loops:
        held, series = loop.result.held, loop.result.series
        measured = {} if design.why_no_direct else {"direct": direct_distance(design, series)}
        for measurement, distance in (measured | {FILTER: series.estimated_distance_m}).items():
            errors = (distance - series.distance_m)[:, held]
            rms = float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")
            rows.append(StepRow(loop.experiment.controller, measurement, rms, loop.held, loop.runs))
    return ClosedLoopStudy(design, seed, tuple(loops), tuple(rows))
