"""An experiment on a loop, the same again on the same noise with something taken away, and why its runs are lost.

What was asked for, the loop itself, or what sensors and driver can do: the lost runs are repeated on the same noise
without what was asked for, another plant, faults, gains, latency. Where they are lost all the same, the linear loop
about its rest comes before all that a driver or a sensor could do: an unstable loop swings until its commands reach the
driver's limits, so that a lost run looks like a weak driver. Of a stable one the numbers of the hardware tell the
cause: the noise in the command against its room, and the distances from which the force at the driver's limits brings
the body back.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.allocation import currents_for_acceleration, force_range
from femfit.simulation.constants import NOISE_FILLS
from femfit.simulation.controllers import ControllerName
from femfit.simulation.design import CONTROLLERS, OBSERVERS, LoopDesign, LoopObserver, ObserverName, keeping_margins
from femfit.simulation.loop import ClosedLoop, LoopProgress, LoopResult, TimeSeries, run_loop
from femfit.simulation.observers import distance_inverse
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant, SensorErrors, with_force_scale
from femfit.simulation.targets import Reference, reference_steps


@dataclass(frozen=True)
class Experiment(SensorErrors):
    """What is asked of a loop, and what is wrong with it."""

    controller: ControllerName
    observer: ObserverName
    targets_m: tuple[float, ...] = ()  # Reference distances in turn; one for a hold
    force_scale: float = 1.0

    def __post_init__(self) -> None:
        chosen = ("controller", self.controller, CONTROLLERS), ("estimator", self.observer, OBSERVERS)
        for option, choice, names in chosen:
            if choice not in names:
                raise DomainError(f"There is no {option} {choice!r}. Give one of {', '.join(names)}.")
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

    @property
    def truth(self) -> ActuatorModel:
        """The model of what moves."""
        model = self.design.model
        return model if self.plant is None else replace(self.plant, sample_time_s=model.sample_time_s)

    @property
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

    def growth_per_s(self, observer: LoopObserver | None = None) -> float:
        """Rate at which a deviation grows in the linear loop, of another observer too; zero where nothing tells."""
        margins = self.design.judged(self.experiment.controller, observer or self.experiment.observer).margins
        return 0.0 if margins is None else -margins.slowest_pole_rad_s

    @property
    def growths(self) -> float:
        """By how many factors e a deviation grows within the runs; below zero where the linear loop is stable."""
        return self.growth_per_s() * self.path_steps * self.design.model.sample_time_s


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


BEYOND, FOLLOWED = 1.5, 20.0
"""Conventional: a trial is followed for so many times the time of the last loss, and so many of the body's time
constants more: a loop that drifts away a fifth as fast as the body is lost by then."""


@dataclass(frozen=True)
class Cause:
    """Why runs were lost: a code, and the numbers that tell it."""

    code: str
    numbers: Mapping[str, Any] = field(default_factory=dict)
    in_vain: tuple[str, ...] = ()  # Codes of what was asked for and taken away without effect


def why_lost(loop: LoopRuns, result: LoopResult) -> Cause:
    """The cause, and the numbers that tell it."""
    last = float(np.nanmax(result.outcome_time_s)) / loop.design.model.sample_time_s
    loop = replace(loop, steps=min(loop.steps, int(BEYOND * last) + loop.design.steps(FOLLOWED)))
    e, design = loop.experiment, loop.design
    asked_for = {
        "plant": loop.plant is not None,
        "sensor-offset": e.offset != 0.0,
        "sensor-drift": e.drift_per_s != 0.0,
        "sensor-stuck": np.isfinite(e.stuck_after_s),
        "dropouts": e.dropout_probability != 0.0,
        "force-scale": e.force_scale != 1.0,
        "gains": bool(design.given),
        "latency": bool(design.latency),
    }
    codes = tuple(code for code, present in asked_for.items() if present)
    if codes:
        plain = replace(design, given={}, latency=0) if design.given or design.latency else design
        plain = keeping_margins(plain) if design.latency else plain
        without = replace(loop, plant=None, design=plain, experiment=Experiment(e.controller, e.observer, e.targets_m))
        try:
            held = run_together([without], f"why runs are lost, without {', '.join(codes)}", recorded=0)[0].held
        except (DomainError, FilterError):  # no such loop can be designed
            held = result.held
        if held[~result.held].all():
            return Cause("asked-for", {"asked_for": codes})
    if loop.growths > 1.0:  # the estimate where the exact state makes the linear loop stable, the controller otherwise
        code = "estimate" if loop.growth_per_s("exact") < 0.0 else "controller"
        return Cause(code, {"growth_per_s": loop.growth_per_s()}, codes)
    return replace(_hardware_limit(loop), in_vain=codes)


def _hardware_limit(loop: LoopRuns) -> Cause:
    """What of sensors and driver the runs are lost by where the loop itself is stable.

    The noise where it fills the command's room at the point of rest that leaves least of it, the driver otherwise. The
    room is in V, or A for a current amplifier, of which noise takes a share rms; ``reach_m`` is how far nearer
    and farther a body at rest may be for the force at the limits to turn it back. The current is taken to be at its
    limit at once; a coil needs time, and so less is true.
    """
    design, controller, observer = loop.design, loop.experiment.controller, loop.experiment.observer
    model, target = design.model, loop.experiment.targets_m[0]
    ends = model.validity.distance_min_m, model.validity.distance_max_m
    distance = np.linspace(*ends, 401)
    needed, (weakest, strongest) = model.require_motion().static_force(distance), force_range(model, distance)
    near = distance[(distance < target) & (weakest > needed)].max(initial=ends[0])
    far = distance[(distance > target) & (strongest < needed)].min(initial=ends[1])
    numbers: dict[str, Any] = {"reach_m": (float(target - near), float(far - target)), "room": None}
    if design.judged(controller, observer).margins is None:  # nothing tells what noise takes
        return Cause("authority", numbers)
    pairs = zip(design.bench(observer).rests, design.margins(controller, observer), strict=True)
    rest, worst = min(pairs, key=lambda pair: float(pair[0].room.min()))
    share = worst.noise_share
    numbers["room"] = {"distance_m": rest.point.distance_m, "room": float(rest.room.min()), "noise_share": share}
    return Cause("noise" if share >= NOISE_FILLS else "authority", numbers)
