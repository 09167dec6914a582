"""Why a loop was lost: what was asked for, the gains, or what sensors and driver can do, in numbers.

The lost runs are repeated on the same noise. First what was asked for is taken away: another plant, faults. Where the
linear loop is unstable about its rest, the reason for that comes before all that a driver or a sensor could do: an
unstable loop swings until its commands reach the driver's limits, so that a lost run looks like a weak driver. Then
other gains are tried with all else as it is: where they hold, the gains were the cause. Where none do, the numbers of
the hardware tell the cause: the noise in the command against its room, the sensors' range, and the distances from which
the force at the driver's limits brings the body back.
"""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.files import json_ready
from femfit.core.numerics import BoolArray
from femfit.device.electrics import PositionSensor
from femfit.model.hall import HallSensor
from femfit.simulation.allocation import currents_for_force, force_range, limits_of
from femfit.simulation.constants import NOISE_FILLS
from femfit.simulation.controllers import Controller
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.experiment import Experiment, LoopRuns
from femfit.simulation.loop import LoopResult
from femfit.simulation.state_feedback import StateFeedback
from femfit.simulation.targets import blind
from femfit.simulation.tune import SEARCH_FREQUENCIES, Bench, make_bench

FEW = 8
"""Conventional: of more runs so many are repeated where some of them are lost, so that the trials take no longer."""

BEYOND, FOLLOWED = 1.5, 20.0
"""Conventional: a trial is followed for so many times the time of the last loss, and so many of the body's time
constants more: a loop that drifts away a fifth as fast as the body is lost by then."""

LITTLE_ROOM = 0.1
"""Conventional: room to the nearer limit over the driver's range, below which it is little."""

HALVINGS = 8
"""Conventional: steps of the search for the longest delay; it is then known to half a per cent of the delay."""

Holds = Callable[..., bool]
"""Takes what is tried, in words, and the loop's fields that differ; says whether all lost runs hold with them."""


@dataclass(frozen=True)
class Room:
    """Where the resting command has least room to the driver's limit."""

    distance_m: float
    room: float  # In V, or A for a current amplifier
    noise_share: float  # Rms that the sensors' noise takes of it
    little: bool  # Beside the driver's range


@dataclass(frozen=True)
class Cause:
    """Why runs were lost: a code, and the numbers that tell it."""

    code: str
    numbers: Mapping[str, Any] = field(default_factory=dict)
    short_of_room: Room | None = None  # Where the noise would fill the room with other gains too
    in_vain: tuple[str, ...] = ()  # Codes of what was asked for and taken away without effect

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the controllers that were tried."""
        data = asdict(replace(self, numbers={k: v for k, v in self.numbers.items() if not isinstance(v, Controller)}))
        return {name: json_ready(value) for name, value in data.items()}


def why_lost(loop: LoopRuns, result: LoopResult) -> Cause:
    """The cause, and the numbers that tell it."""
    last = float(np.nanmax(result.outcome_time_s)) / loop.design.model.sample_time_s
    loop = replace(loop, steps=min(loop.steps, int(BEYOND * last) + loop.design.steps(FOLLOWED)))
    few = replace(loop, runs=min(FEW, loop.runs))
    held = few.held("a few of them again")
    if held is None or held.all():
        held = loop.held("all of them again")
    else:
        loop = few
    gone = ~held if held is not None else np.ones(loop.runs, dtype=np.bool_)
    if not gone.any():
        return Cause("late-by-chance")

    def holds(trial: str, **changes: Any) -> bool:
        again = replace(loop, **changes).held(trial)
        return again is not None and bool(again[gone].all())

    asked_for = _asked_for(loop)
    for codes, changes in asked_for.items():
        if holds(f"without {', '.join(codes)}", **changes):
            return Cause("asked-for", {"asked_for": codes})
    if loop.grows:
        if cause := _gains_or_delay(loop) or _other_gains(loop, holds):
            return cause
        # The estimate where the exact state makes the linear loop stable, the controller otherwise
        exact = loop.design.bench("exact").growth(loop.design.controller(loop.experiment.controller))
        return Cause("estimate" if exact < 0.0 else "controller", {"growth_per_s": loop.growth_per_s})
    if gains := _other_gains(loop, holds):
        return replace(gains, short_of_room=short_of_room(loop))
    limit = hardware_limit(loop)
    known = replace(loop.experiment, observer="exact")
    if (
        limit.code == "authority"
        and loop.experiment.observer != "exact"
        and holds("with the exact state", experiment=known)
    ):
        limit = Cause("estimate-off", {**limit.numbers, "off_m": _first_errors(loop)})
    return replace(limit, in_vain=next(reversed(asked_for), ()))


def _first_errors(loop: LoopRuns) -> float:
    """The largest error in m of the estimate in lost runs as the loop is closed."""
    result = loop.result("why runs are lost, their estimates", deepcopy(loop.random))
    first = np.abs(result.series.estimated_distance_m[0] - result.series.distance_m[0])
    return float(np.nanmax(first[~result.held], initial=0.0))


def _asked_for(loop: LoopRuns) -> dict[tuple[str, ...], dict[str, Any]]:
    """Codes of what was asked for and can be taken away, plant and faults each by itself and then all of it."""
    asked_for: dict[tuple[str, ...], dict[str, Any]] = {}
    if loop.plant is not None:
        asked_for["plant",] = {"plant": None}
    e = loop.experiment
    faults = {
        "sensor-offset": e.offset != 0.0,
        "sensor-drift": e.drift_per_s != 0.0,
        "sensor-stuck": np.isfinite(e.stuck_after_s),
        "dropouts": e.dropout_probability != 0.0,
        "force-scale": e.force_scale != 1.0,
        "first-estimate": e.believed_m is not None,
    }
    if any(faults.values()):
        clean = Experiment(
            e.controller, e.observer, e.targets_m, noise_scale=e.noise_scale, start_error_m=e.start_error_m
        )
        asked_for[tuple(code for code, present in faults.items() if present)] = {"experiment": clean}
    if len(asked_for) > 1:
        asked_for[tuple(chain(*asked_for))] = {k: v for changes in asked_for.values() for k, v in changes.items()}
    return asked_for


def _other_gains(loop: LoopRuns, holds: Holds) -> Cause | None:
    """The gains are the cause where others hold the same runs with all else as it is."""
    e, designed = loop.experiment, replace(loop.design, given={})
    lame = e.controller
    if lame in loop.design.given and holds("with gains as designed", design=designed):
        return Cause("given-gains")
    rivals = [name for name in reversed(CONTROLLERS) if name != lame]
    for name in rivals:
        if holds(f"with {name}", design=designed, experiment=replace(e, controller=name)):
            return Cause("gains", {"rival": name})
    for name in (lame, *rivals) if e.observer == "direct" else ():
        filtered = replace(e, controller=name, observer="ukf4")
        if holds(f"with {name} on ukf4", design=designed, experiment=filtered):
            return Cause("no-filter", {"rival": name})
    return None


def _gains_or_delay(loop: LoopRuns) -> Cause | None:
    """The gains given, or the delays, where the linear loop is stable without them; None where neither is it."""
    design, name = loop.design, loop.experiment.controller
    bench = design.bench(loop.experiment.observer)
    if name in design.given:
        designed = replace(design, given={}).controller(name)
        if bench.growth(designed) < 0.0:
            return Cause("given-gains-unstable", {"growth_per_s": loop.growth_per_s, "designed": designed})
    if design.delay_s == 0.0 or (prompt := _without_delay(loop, bench)) is None:
        return None
    return Cause("delay", {"growth_per_s": loop.growth_per_s, "borne_s": _borne(bench, prompt)})


def _without_delay(loop: LoopRuns, bench: Bench) -> Controller | None:
    """A controller with which the loop is stable without delays: the loop's own, or one designed for none."""
    controller = loop.design.controller(loop.experiment.controller)
    prompt = _delayed(bench, 0.0)
    if not isinstance(controller, StateFeedback) and prompt.growth(controller) < 0.0:
        return controller
    made = replace(loop.design, latency=0, given={}).controller(loop.experiment.controller)
    return made if prompt.growth(made) < 0.0 else None


def _borne(bench: Bench, controller: Controller) -> float | None:
    """The longest delay in s with which a controller's loop is stable; None where each latency has a regulator."""
    if isinstance(controller, StateFeedback) and bench.latency:
        return None
    good, bad = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if _delayed(bench, middle).growth(controller) < 0.0 else (good, middle)
    borne = int(good * bench.latency) * bench.model.sample_time_s
    return borne + max(good * sensor.delay for sensor in bench.sensors) * bench.model.sample_time_s


def _delayed(bench: Bench, share: float) -> Bench:
    """The bench with a part of its delays."""
    sensors = [replace(sensor, delay=share * sensor.delay) for sensor in bench.sensors]
    return make_bench(bench.model, bench.points, sensors, bench.observer, int(share * bench.latency))


def short_of_room(loop: LoopRuns) -> Room | None:
    """Where the resting command leaves the feedback less room than the sensors' noise takes; None where nowhere."""
    room = _fullest(loop)
    return room if room is not None and room.noise_share >= NOISE_FILLS and room.little else None


def hardware_limit(loop: LoopRuns) -> Cause:
    """What of sensors and driver the runs are lost by where no gains hold them.

    Noise that fills the command's room comes first, then a sensor that ends before the driver does, then the driver.
    """
    room, off = _fullest(loop), bearable(loop)
    numbers = {"room": room, **off}
    if room is not None and room.noise_share >= NOISE_FILLS:
        return Cause("noise-without-room" if room.little else "noise", numbers)
    ends_first = any(sensed < reach for sensed, reach in zip(off["sensed_m"], off["reach_m"], strict=True))
    return Cause("range" if ends_first else "authority", numbers)


def _fullest(loop: LoopRuns) -> Room | None:
    """Where the command has least room; None where no margins tell what noise takes of it."""
    design, limits = loop.design, limits_of(loop.design.model)
    try:
        bench = design.bench(loop.experiment.observer)
        margins = bench.judge(design.controller(loop.experiment.controller), SEARCH_FREQUENCIES)
    except (DomainError, FilterError):
        return None
    rooms = [np.minimum(point.commands - limits[0], limits[1] - point.commands).min() for point in bench.points]
    worst = int(np.argmin(rooms))
    little = bool(rooms[worst] <= LITTLE_ROOM * np.min(limits[1] - limits[0]))
    return Room(bench.points[worst].distance_m, float(rooms[worst]), float(margins[worst].noise_share), little)


def bearable(loop: LoopRuns) -> dict[str, tuple[float, float]]:
    """How far in m a body at rest may be off, nearer and farther.

    ``reach_m`` for the force at the limits to turn it back: the current is taken to be at its limit at once; a coil
    needs time, and so less is true. ``sensed_m`` for a sensor to tell its distance.
    """
    model, target, box = loop.design.model, loop.experiment.targets_m[0], loop.design.model.validity
    distance = np.linspace(box.distance_min_m, box.distance_max_m, 401)

    def off_by(bad: BoolArray) -> tuple[float, float]:
        near = float(distance[bad & (distance < target)].max(initial=box.distance_min_m))
        return target - near, float(distance[bad & (distance > target)].min(initial=box.distance_max_m)) - target

    weakest, strongest = force_range(model, distance)
    needed = model.require_motion().static_force(distance)
    currents = currents_for_force(model, distance, needed)
    ended = [
        blind(model, (sensor.name,), distance, currents)
        for sensor in loop.design.loop_sensors()
        if isinstance(sensor.sensor, HallSensor | PositionSensor)
    ]
    return {
        "reach_m": off_by(np.where(distance > target, strongest < needed, weakest > needed)),
        "sensed_m": off_by(np.all(ended, axis=0) if ended else np.zeros(len(distance), dtype=np.bool_)),
    }
