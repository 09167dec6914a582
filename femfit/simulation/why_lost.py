"""Why a loop was lost: what was asked for, the loop itself, or what sensors and driver can do, in numbers.

The lost runs are repeated on the same noise without what was asked for: another plant, faults, gains, latency. Where
they are lost all the same, the linear loop about its rest comes before all that a driver or a sensor could do: an
unstable loop swings until its commands reach the driver's limits, so that a lost run looks like a weak driver. Of a
stable one the numbers of the hardware tell the cause: the noise in the command against its room, the sensors' range,
and the distances from which the force at the driver's limits brings the body back.
"""

from collections.abc import Mapping
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
from femfit.simulation.design import keeping_margins
from femfit.simulation.experiment import Experiment, LoopRuns
from femfit.simulation.loop import LoopResult
from femfit.simulation.targets import blind
from femfit.simulation.tune import SEARCH_FREQUENCIES

BEYOND, FOLLOWED = 1.5, 20.0
"""Conventional: a trial is followed for so many times the time of the last loss, and so many of the body's time
constants more: a loop that drifts away a fifth as fast as the body is lost by then."""

LITTLE_ROOM = 0.1
"""Conventional: room to the nearer limit over the driver's range, below which it is little."""


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
    in_vain: tuple[str, ...] = ()  # Codes of what was asked for and taken away without effect

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return {name: json_ready(value) for name, value in asdict(self).items()}


def why_lost(loop: LoopRuns, result: LoopResult) -> Cause:
    """The cause, and the numbers that tell it."""
    last = float(np.nanmax(result.outcome_time_s)) / loop.design.model.sample_time_s
    loop = replace(loop, steps=min(loop.steps, int(BEYOND * last) + loop.design.steps(FOLLOWED)))
    asked_for = _asked_for(loop)
    for codes, changes in asked_for.items():
        held = replace(loop, **changes).held(f"without {', '.join(codes)}")
        if held is not None and held[~result.held].all():
            return Cause("asked-for", {"asked_for": codes})
    if loop.grows:  # the estimate where the exact state makes the linear loop stable, the controller otherwise
        exact = loop.design.bench("exact").growth(loop.design.controller(loop.experiment.controller))
        cause = Cause("estimate" if exact < 0.0 else "controller", {"growth_per_s": loop.growth_per_s})
    else:
        cause = hardware_limit(loop)
    return replace(cause, in_vain=next(reversed(asked_for), ()))


def _asked_for(loop: LoopRuns) -> dict[tuple[str, ...], dict[str, Any]]:
    """Codes of what was asked for and can be taken away, each by itself and then all of it."""
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
    }
    if any(faults.values()):
        clean = Experiment(e.controller, e.observer, e.targets_m, noise_scale=e.noise_scale)
        asked_for[tuple(code for code, present in faults.items() if present)] = {"experiment": clean}
    if loop.design.given:
        asked_for["gains",] = {"design": replace(loop.design, given={})}
    if loop.design.latency:
        asked_for["latency",] = {"design": keeping_margins(replace(loop.design, latency=0))}
    if len(asked_for) > 1:
        asked_for[tuple(chain(*asked_for))] = {k: v for changes in asked_for.values() for k, v in changes.items()}
    return asked_for


def hardware_limit(loop: LoopRuns) -> Cause:
    """What of sensors and driver the runs are lost by where the loop itself is stable.

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
