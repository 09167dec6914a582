"""Close the loop around a model, and say whether it held, how well, and if not, why."""

from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core import atomic
from femfit.core.amount import amount, counted
from femfit.core.arrays import FloatArray
from femfit.core.atomic import json_ready
from femfit.core.errors import DomainError
from femfit.core.outputs import LOOP, require_outputs
from femfit.core.paths import path_of
from femfit.core.printed import Printed
from femfit.core.quoted import quoted
from femfit.core.random_numbers import random_generator
from femfit.filters.theory import ConsistencyBand, consistency_band
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.simulation.constants import SUPPORT_TIME_CONSTANTS
from femfit.simulation.design import CONTROLLERS, OBSERVERS, ControllerName, LoopDesign, ObserverName, design_loop
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopOutcome, LoopResult
from femfit.simulation.loop_text import design_data, design_lines, verdict
from femfit.simulation.why_lost import LostLoop, why_lost

SERIES_COLUMNS = (
    "voltage_V",
    "current_A",
    "distance_m",
    "hall_V",
    "reference_m",
    "estimated_distance_m",
    "estimated_velocity_m_s",
    "estimated_current_A",
)

_MOST_STEPS = 2**48
"""Numbers in more than which no machine's addresses reach."""


@dataclass(frozen=True)
class Spread:
    """Median and 95 % quantile of a number over the runs that were held; NaN if none was."""

    median: float
    upper: float


@dataclass(frozen=True, eq=False, repr=False)
class LoopSummary(Printed):
    """What many runs of one closed loop came to; printed, it says so in a few lines.

    Parameters
    ----------
    plant : str or None
        Name of what truly moves, where that is another model than the design's.
    outcomes : mapping of str to int
        Runs by the name of their outcome.
    first_loss_s, last_loss_s : float or None
        When runs were lost, where any was.
    estimate_rms_m, tracking_rms_m : Spread
        Of each run's rms of (estimated - true distance) and of (true distance - reference).
    normalised_innovation_squared : float or None
        Mean over held runs; None without a filter.
    innovation_band : ConsistencyBand
        95 % for that mean.
    advice : str
        Why runs were lost and what to do; empty where all were held.
    result : LoopResult
        Outcome of each run, and the series of those that were recorded.

    Examples
    --------
    >>> import femfit as ff
    >>> loop = ff.close_loop("model.json", controller="backstepping", targets_m=(0.022,), runs=2, seconds=0.1)
    >>> loop.held, loop.result.series.distance_m.shape
    (2, (200, 1))
    """

    design: LoopDesign
    experiment: Experiment
    plant: str | None
    runs: int
    steps: int
    outcomes: Mapping[str, int]
    first_loss_s: float | None
    last_loss_s: float | None
    estimate_rms_m: Spread
    tracking_rms_m: Spread
    normalised_innovation_squared: float | None
    innovation_band: ConsistencyBand
    advice: str
    result: LoopResult

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get(LoopOutcome.HELD.name, 0)

    def __str__(self) -> str:
        return "\n".join([*self._lines(), "", *design_lines(self.design)])

    def _lines(self) -> list[str]:
        seconds = self.steps * self.design.model.sample_time_s
        lines = [verdict(self.design, seconds, [(self.experiment, self.held, self.runs)], self.plant)]
        for name, count in self.outcomes.items():
            if name != LoopOutcome.HELD.name:
                runs = counted(count, "run")
                lines.append(f"  {runs} lost: {LoopOutcome[name].sentence}")
        if self.last_loss_s is not None:
            lines.append(f"  lost between {self.first_loss_s:.4g} and {self.last_loss_s:.4g} s")
        if self.advice:
            lines.append(f"  {self.advice}")
        if self.held:
            for text, spread in (
                ("estimated - true distance", self.estimate_rms_m),
                ("true distance - reference", self.tracking_rms_m),
            ):
                median, upper = amount(spread.median, "m", 3), amount(spread.upper, "m", 3)
                lines.append(f"  rms of {text}: median {median}, 95 % below {upper}")
        if self.normalised_innovation_squared is not None:
            band = self.innovation_band
            lines.append(
                f"  squared errors of the filter's predictions are {self.normalised_innovation_squared:.3f} of what it "
                f"expects (a filter that knows its errors: {band.lower:.3f} to {band.upper:.3f}, 95 %)"
            )
        return lines

    def data(self) -> dict[str, Any]:
        """The numbers without the series, ready for JSON."""
        names = ("plant", "runs", "steps", "first_loss_s", "last_loss_s", "normalised_innovation_squared", "advice")
        return {
            "model": self.design.model.name,
            "experiment": json_ready(asdict(self.experiment)),
            "outcomes": dict(self.outcomes),
            **{name: json_ready(getattr(self, name)) for name in names},
            **{
                name: json_ready(asdict(getattr(self, name)))
                for name in ("estimate_rms_m", "tracking_rms_m", "innovation_band")
            },
            "design": design_data(self.design),
        }

    def write_csv(self, path: str | Path) -> None:
        """Write the recorded runs, one row a sample, up to the sample at which a run was lost."""
        require_outputs([], (path_of(path, "The table of the runs"), LOOP))
        series, rows = self.result.series, []
        for run in range(series.distance_m.shape[1]):
            known = np.flatnonzero(np.isfinite(series.distance_m[:, run]))
            columns = (getattr(series, name)[known, run] for name in SERIES_COLUMNS)
            rows.append(np.stack([np.full(len(known), run + 1.0), self.result.time_s[known], *columns], axis=1))
        names = ("run", "time_s", *SERIES_COLUMNS)
        table = np.concatenate(rows) if rows else np.empty((0, len(names)))
        with atomic.replacing(path) as partial:
            np.savetxt(partial, table, delimiter=",", header=",".join(names), comments="", fmt=["%d"] + ["%.9g"] * 9)


def close_loop(
    model: ActuatorModel | str | Path,
    *,
    controller: ControllerName = "pid",
    estimator: ObserverName = "ukf4",
    targets_m: Iterable[float] | None = None,
    runs: int = 20,
    seconds: float | None = None,
    plant: ActuatorModel | str | Path | None = None,
    rng: int | np.random.Generator = 1,
    noise_V: float | None = None,
    hall_offset_V: float = 0.0,
    drift_V_per_s: float = 0.0,
    force_scale: float = 1.0,
    stuck_after_s: float | None = None,
    dropout: float = 0.0,
    recorded: int = 1,
) -> LoopSummary:
    """Simulate a closed loop many times with different noise.

    Controller, filter and reference are derived from the model.

    Parameters
    ----------
    model : ActuatorModel, str or Path
        What controller and filter believe, or its file.
    targets_m : iterable of float or None
        Distances that the reference steps to in turn; those of the model where None.
    seconds : float or None
        Of one run; one second a target where None.
    plant : ActuatorModel, str, Path or None
        What truly moves and is truly sensed, where that is another model.
    noise_V : float or None
        White noise of a Hall sample; the model's where None.
    hall_offset_V, drift_V_per_s : float
        Offset of the Hall sensor that the model does not know, and its drift.
    force_scale : float
        True force over the model's.
    stuck_after_s : float or None
        From then on the sensor repeats its last reading.
    dropout : float
        Probability of a reading at the lower end of the sensor's range.
    recorded : int
        Runs whose series are kept.

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
    Held: 3 of 3 runs of 0.2 s held the body; pid on ukf4, ...
    >>> loop.estimate_rms_m.median < 50e-6
    True
    """
    for given, value, known in (("controller", controller, CONTROLLERS), ("estimator", estimator, OBSERVERS)):
        if value not in known:
            raise DomainError(f"There is no {given} {value!r}. Give one of {', '.join(known)}.")
    for name, count, least in (("runs", runs, 1), ("recorded", recorded, 0)):
        if not isinstance(count, int | np.integer) or count < least:
            raise DomainError(
                f"{name} must be a whole number >= {least}; instead received {name}={count!r}. Give 20, say."
            )
    if seconds is not None and not 0.0 < seconds < np.inf:
        raise DomainError(f"A closed loop must last a time > 0 s; instead received seconds={seconds:g}. Give 1, say.")
    random = random_generator(rng)
    believed, truth = model_of(model), None if plant is None else model_of(plant)
    if targets_m is not None:
        believed = replace(believed, reference_distances_m=_distances(targets_m))
    design = design_loop(believed, noise_V)
    experiment = Experiment(
        controller=controller,
        observer=estimator,
        targets_m=design.targets_m,
        force_scale=force_scale,
        offset_V=hall_offset_V,
        drift_V_per_s=drift_V_per_s,
        stuck_after_s=np.inf if stuck_after_s is None else stuck_after_s,
        dropout_probability=dropout,
    )
    duration = float(len(design.targets_m)) if seconds is None else seconds
    return run_loops(design, experiment, random, runs=runs, duration_s=duration, recorded=recorded, plant=truth)


def _distances(targets_m: Iterable[float]) -> tuple[float, ...]:
    try:
        return tuple(float(d) for d in targets_m)
    except (TypeError, ValueError) as error:
        raise DomainError(
            f"targets_m must be a list of distances in m; instead received {quoted(targets_m)}. Give [0.02], say."
        ) from error


def run_loops(
    design: LoopDesign,
    experiment: Experiment,
    random: np.random.Generator,
    *,
    runs: int,
    duration_s: float,
    recorded: int = 0,
    plant: ActuatorModel | None = None,
) -> LoopSummary:
    """Repeat one experiment and sum it up while it runs: nothing is stored but what is to be recorded."""
    steps = max(1, round(duration_s / design.model.sample_time_s))
    supported = 0 if experiment.believed_m is not None else design.steps(SUPPORT_TIME_CONSTANTS)
    before = deepcopy(random)
    too_long = DomainError(
        f"The memory does not suffice for {counted(runs, 'run')} of {duration_s:g} s, "
        f"{float(steps):.3g} samples each. Simulate "
        "fewer seconds, or fewer runs."
    )
    if steps > _MOST_STEPS:
        raise too_long
    try:
        (result,) = run_experiments(
            design,
            [experiment],
            random,
            runs=runs,
            steps=steps,
            windows=(slice(0, steps),),
            supported_steps=supported,
            recorded=recorded,
            plant=plant,
        )
    except MemoryError as error:
        raise too_long from error
    held, statistics = result.held, result.windows[0]
    quality = statistics.normalised_innovation_squared[held]
    return LoopSummary(
        design=design,
        experiment=experiment,
        plant=plant.name if plant is not None else None,
        runs=runs,
        steps=steps,
        outcomes=result.counts(),
        first_loss_s=None if held.all() else float(np.nanmin(result.outcome_time_s)),
        last_loss_s=None if held.all() else float(np.nanmax(result.outcome_time_s)),
        estimate_rms_m=_spread(statistics.estimate_rms_m[held]),
        tracking_rms_m=_spread(statistics.tracking_rms_m[held]),
        normalised_innovation_squared=float(quality.mean()) if np.isfinite(quality).any() else None,
        innovation_band=consistency_band(max(1, int(held.sum())) * steps),
        advice=""
        if held.all()
        else why_lost(LostLoop(design, experiment, before, runs, steps, supported, plant), result),
        result=result,
    )


def _spread(values: FloatArray) -> Spread:
    if not values.size:
        return Spread(float("nan"), float("nan"))
    return Spread(*(float(q) for q in np.quantile(values, (0.5, 0.95))))
