"""Why a loop was lost: what was asked for, the gains, or what sensors and driver can do, in numbers.

The lost runs are repeated on the same noise. First what was asked for is taken away: another plant, faults. Where the
linear loop is unstable about its rest, the reason for that comes before all that a driver or a sensor could do. Then
other gains are tried with all else as it is: where they hold, the gains were the cause. Where none do, the numbers of
the hardware tell the cause: the noise in the command against its room, the sensors' range, and the distances from which
the force at the driver's limits brings the body back.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import amount
from femfit.device.electrics import PositionSensor
from femfit.model.drive import circuit_terms
from femfit.model.hall import HallSensor
from femfit.simulation.allocation import current_ranges, currents_for_force, limits_of
from femfit.simulation.constants import NOISE_FILLS
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopResult
from femfit.simulation.loop_text import command_unit, sensor_word
from femfit.simulation.lost_loop import LostLoop
from femfit.simulation.targets import blind
from femfit.simulation.tune import SEARCH_FREQUENCIES
from femfit.simulation.why_unstable import growth_of, why_unstable

FEW = 8
"""Conventional: of more runs so many are repeated where some of them are lost, so that the trials take no longer."""

BEYOND, FOLLOWED = 1.5, 20.0
"""Conventional: a trial is followed for so many times the time of the last loss, and so many of the body's time
constants more: a loop that drifts away a fifth as fast as the body is lost by then."""

LITTLE_ROOM = 0.1
"""Conventional: room to the nearer limit over the driver's range, below which it is little."""

Holds = Callable[..., bool]
"""Takes what is tried, in words, and the loop's fields that differ; says whether all lost runs hold with them."""


def why_lost(loop: LostLoop, result: LoopResult) -> str:
    """A sentence or two: the cause, and the numbers that tell it."""
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
        return "The loss comes late and by chance: the same runs hold up to soon after it."

    def holds(trial: str, **changes: Any) -> bool:
        again = replace(loop, **changes).held(trial)
        return again is not None and bool(again[gone].all())

    asked_for = _asked_for(loop)
    for name, changes in asked_for.items():
        if holds(f"without {name}", **changes):
            helped = " Compare the model with measurements (femfit diagnose) and add what is missing."
            return f"Without {name} the same runs hold.{helped if 'plant' in changes else ''}"
    if growth := growth_of(loop):
        return why_unstable(loop, lambda: _other_gains(loop, holds), growth)
    if gains := _other_gains(loop, holds):
        return gains + short_of_room(loop)
    *_, last_name = asked_for or [""]
    return hardware_limit(loop) + (f" Without {last_name} the same runs are lost too." if last_name else "")


def _asked_for(loop: LostLoop) -> dict[str, dict[str, Any]]:
    """What was asked for and can be taken away, each by itself and then all of it."""
    asked_for: dict[str, dict[str, Any]] = {}
    if loop.plant is not None:
        asked_for["the difference between plant and model"] = {"plant": None}
    if faults := _faults(loop.experiment):
        e = loop.experiment
        clean = Experiment(
            e.controller, e.observer, e.targets_m, noise_scale=e.noise_scale, start_error_m=e.start_error_m
        )
        asked_for[f"the fault ({faults})"] = {"experiment": clean}
    if len(asked_for) > 1:
        asked_for[" and ".join(asked_for)] = {
            name: value for changes in asked_for.values() for name, value in changes.items()
        }
    return asked_for


def _faults(experiment: Experiment) -> str:
    faults = {
        "sensor offset": experiment.offset != 0.0,
        "sensor drift": experiment.drift_per_s != 0.0,
        "sensor stuck": np.isfinite(experiment.stuck_after_s),
        "dropouts": experiment.dropout_probability != 0.0,
        "true force unlike the model's": experiment.force_scale != 1.0,
        "wrong first estimate": experiment.believed_m is not None,
    }
    return ", ".join(name for name, present in faults.items() if present)


def _other_gains(loop: LostLoop, holds: Holds) -> str:
    """The gains are the cause where others hold the same runs with all else as it is."""
    e, designed = loop.experiment, replace(loop.design, given={})
    lame = e.controller
    if lame in loop.design.given and holds("with gains as designed", design=designed):
        return f"The gains: {lame} loses the body with these, and holds the same runs with those that femfit designs."
    rivals = [name for name in reversed(CONTROLLERS) if name != lame]
    for name in rivals:
        if holds(f"with {name}", design=designed, experiment=replace(e, controller=name)):
            return f"The gains: {lame} loses the body with these. Use {name}: with it the same runs hold."
    for name in (lame, *rivals) if e.observer == "direct" else ():
        filtered = replace(e, controller=name, observer="ukf4")
        if holds(f"with {name} on ukf4", design=designed, experiment=filtered):
            return (
                "The sensors' noise reaches the driver: each difference of two readings is a velocity here. Use a "
                f"filter: with {name} on ukf4 the same runs hold with the noise as it is."
            )
    return ""


def short_of_room(loop: LostLoop) -> str:
    """A sentence where the resting command leaves the feedback less room than the sensors' noise takes; else empty."""
    worst = _fullest(loop)
    if worst is None:
        return ""
    distance, room, share, little = worst
    if share < NOISE_FILLS or not little:
        return ""
    return f" The authority is short too: {_noise_in_room(loop, distance, room, share)}."


def hardware_limit(loop: LostLoop) -> str:
    """What of sensors and driver the runs are lost by where no gains hold them.

    Noise that fills the command's room comes first, then a sensor that ends before the driver does, then the driver.
    """
    worst = _fullest(loop)
    if worst is not None and worst[2] >= NOISE_FILLS:
        distance, room, share, little = worst
        filled = _noise_in_room(loop, distance, room, share)
        if little:
            return f"The authority: {filled}; {_brought_back(loop)}."
        noise = ", ".join(
            f"{sensor_word(sensor.name)} {amount(sensor.reading.noise, sensor.reading.unit, 3)}"
            for sensor in loop.design.loop_sensors()
        )
        return f"The sensors' noise: {noise} rms; {filled}."
    (near, far), (sensed_near, sensed_far) = reach(loop), sensed(loop)
    if sensed_near < near or sensed_far < far:
        return (
            f"The sensors' range: their readings end {amount(sensed_near, 'm')} nearer and "
            f"{amount(sensed_far, 'm')} farther, although {_brought_back(loop)}."
        )
    noisy = "" if worst is None else f", of whose room to the driver's limit noise takes {100.0 * worst[2]:.2g} %"
    return (
        f"The authority: {_brought_back(loop)}. The loop is stable about its rest with its commands{noisy}"
        f"{_late(loop)}. Choose reference distances nearer to each other, or compare the model with a bench."
    )


def _fullest(loop: LostLoop) -> tuple[float, float, float, bool] | None:
    """Where the command has least room: the distance, the room, the noise's share of it, and whether it is little."""
    design, limits = loop.design, limits_of(loop.design.model)
    try:
        bench = design.bench(loop.experiment.observer)
        margins = bench.judge(design.controller(loop.experiment.controller), SEARCH_FREQUENCIES)
    except (DomainError, FilterError):
        return None
    rooms = [np.minimum(point.commands - limits[0], limits[1] - point.commands).min() for point in bench.points]
    worst = int(np.argmin(rooms))
    little = bool(rooms[worst] <= LITTLE_ROOM * np.min(limits[1] - limits[0]))
    return bench.points[worst].distance_m, float(rooms[worst]), float(margins[worst].noise_share), little


def _noise_in_room(loop: LostLoop, distance_m: float, room: float, share: float) -> str:
    unit = command_unit(loop.design)
    return (
        f"at {amount(distance_m, 'm', 3)} the resting command leaves {amount(room, unit)} to the driver's limit, and "
        f"the sensors' noise alone takes {amount(share * room, unit)} rms of it"
    )


def _brought_back(loop: LostLoop) -> str:
    near, far = reach(loop)
    return (
        f"at {amount(loop.experiment.targets_m[0], 'm', 3)} the force at the driver's limits brings a body at rest "
        f"back from {amount(near, 'm')} nearer and {amount(far, 'm')} farther at most"
    )


def _late(loop: LostLoop) -> str:
    """The delay beside the time in which the body runs away; empty where there is none of either."""
    late, unstable = loop.design.delay_s, max(point.runaway_rad_s for point in loop.design.points)
    if not late * unstable:
        return ""
    return (
        f", and with its delay of {amount(late, 's')}, {late * unstable:.2g} of the time in which the body runs away "
        "by a factor e"
    )


def reach(loop: LostLoop) -> tuple[float, float]:
    """How far in m a body at rest may be off, nearer and farther, for the force at the limits to turn it back.

    The current is taken to be at its limit at once; a coil needs time, and so less is true.
    """
    model, distance = loop.design.model, _distances(loop)
    corners = np.stack(np.meshgrid(*current_ranges(model)), axis=-1).reshape(-1, len(model.circuits))
    forces = [circuit_terms(model, distance, np.tile(corner, (len(distance), 1)))[0] for corner in corners]
    needed, target = model.require_motion().static_force(distance), loop.experiment.targets_m[0]
    too_far = (np.max(forces, axis=0) < needed) & (distance > target)
    return _off_by(loop, too_far | ((np.min(forces, axis=0) > needed) & (distance < target)))


def sensed(loop: LostLoop) -> tuple[float, float]:
    """How far in m a body at rest may be off, nearer and farther, for a sensor to tell its distance."""
    model, distance = loop.design.model, _distances(loop)
    currents = currents_for_force(model, distance, model.require_motion().static_force(distance))
    ended = [
        blind(model, (sensor.name,), distance, currents)
        for sensor in loop.design.loop_sensors()
        if isinstance(sensor.sensor, HallSensor | PositionSensor)
    ]
    return _off_by(loop, np.all(ended, axis=0) if ended else np.zeros(len(distance), dtype=np.bool_))


def _distances(loop: LostLoop) -> FloatArray:
    box = loop.design.model.validity
    return np.linspace(box.distance_min_m, box.distance_max_m, 401)


def _off_by(loop: LostLoop, bad: BoolArray) -> tuple[float, float]:
    """From the first target to the nearest bad distance on either side, or to the end of the validity domain."""
    box, distance, target = loop.design.model.validity, _distances(loop), loop.experiment.targets_m[0]
    near = float(distance[bad & (distance < target)].max(initial=box.distance_min_m))
    return target - near, float(distance[bad & (distance > target)].min(initial=box.distance_max_m)) - target
