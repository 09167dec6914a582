"""An experiment on a loop, and the same again on the same noise, as it was or with something taken away."""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.allocation import currents_for_acceleration
from femfit.simulation.controllers import ControllerName
from femfit.simulation.design import LoopDesign, ObserverName
from femfit.simulation.loop import ClosedLoop, LoopProgress, LoopResult, TimeSeries, run_loop
from femfit.simulation.observers import distance_inverse
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant, with_force_scale
from femfit.simulation.sensor import SensorErrors
from femfit.simulation.targets import Reference, reference_steps


@dataclass(frozen=True)
class Experiment(SensorErrors):
    """What is asked of a loop, and what is wrong with it."""

    controller: ControllerName
    observer: ObserverName
    targets_m: tuple[float, ...]  # Reference distances in turn; one for a hold
    force_scale: float = 1.0

    def __post_init__(self) -> None:
        for name, value, lawful, needed in (
            ("force scale", self.force_scale, 0.0 < self.force_scale < np.inf, "> 0"),
            ("sensor offset", self.offset, np.isfinite(self.offset), "finite"),
            ("sensor drift per second", self.drift_per_s, np.isfinite(self.drift_per_s), "finite"),
            ("time in s after which the sensor is stuck", self.stuck_after_s, self.stuck_after_s >= 0.0, ">= 0"),
            ("probability of a dropout", self.dropout_probability, 0.0 <= self.dropout_probability <= 1.0, "0 to 1"),
        ):
            if not lawful:
                raise DomainError(
                    f"A loop's {name} must be {needed}; instead received {value:g}. Leave it out for a sensor and a "
                    "force without that fault."
                )


def direct_distance(design: LoopDesign, series: TimeSeries) -> FloatArray:
    """The direct measurement of a recorded loop in m: its readings inverted with the current that its observer had.

    Between the readings of a slow sensor it stays what the last one said; it is NaN before the first and in lost runs.
    """
    readings, n = series.readings[..., 0], len(design.model.circuits)
    currents = series.estimated_currents_A[..., :n].reshape(readings.size, n)
    distance = distance_inverse(design.model, design.sensors[0])(readings.ravel(), currents)
    rows = np.arange(len(readings))[:, None]
    latest = np.maximum.accumulate(np.where(np.isnan(readings), 0, rows), axis=0)
    held = np.take_along_axis(distance.reshape(readings.shape), latest, axis=0)
    return np.where(np.isnan(series.distance_m), np.nan, held)


CERTAIN = 30.0
"""Derived: growth times duration from which a deviation of one rounding, 1e-13 of the range, has grown to the range."""


@dataclass(frozen=True, eq=False)
class LoopRuns:
    """Everything that is needed to run a loop, and to run it again on the same noise."""

    design: LoopDesign
    experiment: Experiment
    random: np.random.Generator  # As it was before the first run; it is copied
    runs: int
    steps: int  # Of each run, as far as it is to be followed
    path_steps: int  # That the reference is laid out for
    supported_steps: int
    plant: ActuatorModel | None = None  # What truly moves and is sensed, where that is another model than the design's
    progress: LoopProgress | None = None

    @cached_property
    def loop(self) -> ClosedLoop:
        """The loop that is run."""
        design, e, model = self.design, self.experiment, self.design.model
        if e.faulty not in {None, *design.sensors}:
            raise DomainError(
                f"A fault must be of a sensor that the loop reads ({', '.join(design.sensors)}); instead received "
                f"{e.faulty!r}."
            )
        r, v, a = reference_steps(e.targets_m, self.path_steps, model.sample_time_s, design.reference_rate_rad_s)
        # The current that a linear controller adds to its own
        path = Reference(r, v, a, currents_for_acceleration(model, r, a, v))
        return ClosedLoop(
            plant=Plant(self.truth if e.force_scale == 1.0 else with_force_scale(self.truth, e.force_scale)),
            sensors=design.loop_sensors(self.truth),
            errors=e,
            observer=design.observer(e.observer),
            controllers=(design.controller(e.controller),),
            reference=path.at(slice(0, self.steps)),
            latency=design.latency,
        )

    @property
    def truth(self) -> ActuatorModel:
        """The model of what moves."""
        model = self.design.model
        return model if self.plant is None else replace(self.plant, sample_time_s=model.sample_time_s)

    def held(self, trial: str) -> BoolArray | None:
        """Which runs are held this time, on the same noise; None where no such loop can be designed.

        Parameters
        ----------
        trial : str
            What is tried, as the progress says it.
        """
        try:
            return run_together([self], f"why runs are lost, {trial}", recorded=0)[0].held
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


def run_together(
    loops: Sequence[LoopRuns], stage_name: str, random: np.random.Generator | None = None, **options: Any
) -> list[LoopResult]:
    """Run loops that differ by their controllers alone in one batch, on the same noise; the result of each.

    Options are those of :func:`femfit.simulation.loop.run_loop`.

    Parameters
    ----------
    stage_name : str
        What the progress is told.
    random : Generator or None
        A copy of the noise where None.
    """
    first = loops[0]
    controllers = tuple(loop.design.controller(loop.experiment.controller) for loop in loops)
    rest = operating_point(first.truth, first.experiment.targets_m[0]).state
    return run_loop(
        replace(first.loop, controllers=controllers),
        np.tile(rest, (len(loops) * first.runs, 1)),
        deepcopy(first.random) if random is None else random,
        supported_steps=first.supported_steps,
        show=first.progress and partial(first.progress, stage_name),
        **options,
    )
