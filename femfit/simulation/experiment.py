"""Several small experiments as one batch: what differs between them is an entry a run, not another loop.

One of them again on the same noise, as it was or with something taken away.
"""

from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.allocation import currents_for_acceleration
from femfit.simulation.controllers import ControllerName, SplitController
from femfit.simulation.design import LoopDesign, ObserverName
from femfit.simulation.loop import ClosedLoop, LoopProgress, LoopResult, TimeSeries, run_loop, stage
from femfit.simulation.observers import SplitObserver, distance_inverse
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant, with_force_scale
from femfit.simulation.sensor import SensorErrors
from femfit.simulation.targets import reference_steps, stack_references

_ERRORS = ("noise_scale", "offset", "drift_per_s", "stuck_after_s", "dropout_probability")


@dataclass(frozen=True)
class Experiment:
    """One experiment of a batch."""

    controller: ControllerName
    observer: ObserverName
    targets_m: tuple[float, ...]  # Reference distances in turn; one for a hold
    force_scale: float = 1.0
    faulty: str | None = None  # Name of the sensor that the faults are of; None: the first
    # In the unit of its reading
    offset: float = 0.0
    drift_per_s: float = 0.0
    stuck_after_s: float = np.inf
    dropout_probability: float = 0.0
    noise_scale: float = 1.0  # Noise of all sensors over the design's
    start_error_m: float = 0.0  # How far the body truly starts from the first reference distance

    def __post_init__(self) -> None:
        for name, value, lawful, needed in (
            ("force scale", self.force_scale, 0.0 < self.force_scale < np.inf, "> 0"),
            ("sensor offset", self.offset, np.isfinite(self.offset), "finite"),
            ("sensor drift per second", self.drift_per_s, np.isfinite(self.drift_per_s), "finite"),
            ("time in s after which the sensor is stuck", self.stuck_after_s, self.stuck_after_s >= 0.0, ">= 0"),
            ("probability of a dropout", self.dropout_probability, 0.0 <= self.dropout_probability <= 1.0, "0 to 1"),
            ("noise over the design's", self.noise_scale, 0.0 <= self.noise_scale < np.inf, ">= 0"),
        ):
            if not lawful:
                raise DomainError(
                    f"A loop's {name} must be {needed}; instead received {value:g}. Leave it out for a sensor and a "
                    "force without that fault."
                )


def run_experiments(
    design: LoopDesign,
    experiments: Sequence[Experiment],
    random: np.random.Generator,
    *,
    runs: int,
    steps: int,
    plant: ActuatorModel | None = None,
    path_steps: int | None = None,
    **options: Any,
) -> tuple[LoopResult, ...]:
    """Run experiments side by side on the same noise, so that what differs between them is not hidden by it.

    Parameters
    ----------
    plant : ActuatorModel or None
        What truly moves and is truly sensed, where that is another model than the design's.
    path_steps : int or None
        Samples that the reference is laid out for, where the runs end before its end.
    options : optional
        ``supported_steps``, ``windows``, ``recorded`` of the whole batch and ``show`` of
        :func:`femfit.simulation.loop.run_loop`.
    """
    model = design.model
    truth = model if plant is None else replace(plant, sample_time_s=model.sample_time_s)

    def each(values: Sequence[float]) -> FloatArray:
        return np.repeat(np.asarray(values, dtype=np.float64), runs)

    paths = {}
    for targets in dict.fromkeys(e.targets_m for e in experiments):
        path = reference_steps(targets, path_steps or steps, model.sample_time_s, design.reference_rate_rad_s)
        # The current that a linear controller adds to its own
        currents = currents_for_acceleration(model, path.distance, path.acceleration, path.velocity)
        paths[targets] = replace(path, currents=currents).at(slice(0, steps))
    scale = each([e.force_scale for e in experiments])
    loop = ClosedLoop(
        plant=Plant(with_force_scale(truth, scale) if np.any(scale != 1.0) else truth),
        sensors=design.loop_sensors(truth),
        errors=SensorErrors(
            faulty=each([_place(design, e.faulty) for e in experiments]),
            blocks=len(experiments),
            **{name: each([getattr(e, name) for e in experiments]) for name in _ERRORS},
        ),
        observer=_observers(design, experiments, runs),
        controller=SplitController(
            tuple(
                (_rows((e.controller == name for e in experiments), runs), design.controller(name))
                for name in dict.fromkeys(e.controller for e in experiments)
            )
        ),
        reference=paths[experiments[0].targets_m]
        if len(paths) == 1
        else stack_references([paths[e.targets_m] for e in experiments], [runs] * len(experiments)),
        latency=design.latency,
    )
    starts = np.array([operating_point(truth, e.targets_m[0]).state for e in experiments])
    beliefs = starts.copy()
    starts[:, 0] += [e.start_error_m for e in experiments]
    result = run_loop(
        loop,
        np.repeat(starts, runs, axis=0),
        random,
        start_estimate=np.repeat(beliefs, runs, axis=0),
        **options,
    )
    return tuple(result.part(slice(k * runs, (k + 1) * runs)) for k in range(len(experiments)))


def _rows(mask: Iterable[bool], runs: int) -> IntArray:
    return np.flatnonzero(np.repeat(list(mask), runs))


def _observers(design: LoopDesign, experiments: Sequence[Experiment], runs: int) -> SplitObserver:
    """One observer for all experiments that can share it."""
    kinds = [e.observer for e in experiments]
    parts = [(_rows((each == kind for each in kinds), runs), design.observer(kind)) for kind in dict.fromkeys(kinds)]
    return SplitObserver(tuple(parts), 2 + len(design.model.circuits))


def _place(design: LoopDesign, name: str | None) -> int:
    """Which of the loop's sensors a name means."""
    if name is None:
        return 0
    if name not in design.sensors:
        raise DomainError(
            f"A fault must be of a sensor that the loop reads ({', '.join(design.sensors)}); instead received {name!r}."
        )
    return design.sensors.index(name)


def direct_distance(design: LoopDesign, series: TimeSeries) -> FloatArray:
    """The direct measurement of a recorded loop in m: its readings inverted with the current that its observer had.

    Between the readings of a slow sensor it stays what the last one said; it is NaN before the first and in lost runs.
    """
    readings, n = series.readings[..., 0], len(design.model.circuits)
    currents = series.estimated_currents_A[..., :n].reshape(readings.size, n)
    distance, _ = distance_inverse(design.model, design.sensors[0]).distance(readings.ravel(), currents)
    rows = np.arange(len(readings))[:, None]
    latest = np.maximum.accumulate(np.where(np.isnan(readings), 0, rows), axis=0)
    held = np.take_along_axis(distance.reshape(readings.shape), latest, axis=0)
    return np.where(np.isnan(series.distance_m), np.nan, held)


CERTAIN = 30.0
"""Derived: growth times duration from which a deviation of one rounding, 1e-13 of the range, has grown to the range."""


@dataclass(frozen=True, eq=False)
class LoopRuns:
    """Everything that is needed to run a loop, and to run it again."""

    design: LoopDesign
    experiment: Experiment
    random: np.random.Generator  # As it was before the first run; it is copied
    runs: int
    steps: int  # Of each run, as far as it is to be followed
    path_steps: int  # That the reference is laid out for
    supported_steps: int
    plant: ActuatorModel | None  # What truly moves, where that is another model than the design's
    progress: LoopProgress | None = None

    def result(self, stage_name: str, random: np.random.Generator, **options: Any) -> LoopResult:
        """Run them, which the progress is told by a name; options are those of run_experiments."""
        (result,) = run_experiments(
            self.design,
            [self.experiment],
            random,
            runs=self.runs,
            steps=self.steps,
            supported_steps=self.supported_steps,
            plant=self.plant,
            path_steps=self.path_steps,
            show=stage(self.progress, stage_name),
            **options,
        )
        return result

    def held(self, trial: str) -> BoolArray | None:
        """Which runs are held this time, on the same noise; None where no such loop can be designed.

        Parameters
        ----------
        trial : str
            What is tried, as the progress says it.
        """
        try:
            if self.plant is None and self.growth_per_s * self.steps * self.design.model.sample_time_s > CERTAIN:
                # The linear loop tells already that this is no loop to advise, so that it need not be run
                return np.zeros(self.runs, dtype=np.bool_)
            return self.result(f"why runs are lost, {trial}", deepcopy(self.random), recorded=0).held
        except (DomainError, FilterError):
            return None

    @cached_property
    def growth_per_s(self) -> float:
        """Rate at which a deviation grows in the linear loop; below zero where it is stable."""
        return self.design.bench(self.experiment.observer).growth(self.design.controller(self.experiment.controller))

    @property
    def grows(self) -> bool:
        """Whether a deviation grows within the runs; no where nothing tells."""
        try:
            return self.growth_per_s * self.path_steps * self.design.model.sample_time_s > 1.0
        except (DomainError, FilterError):
            return False
