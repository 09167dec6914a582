"""What the drawing's own supply does to a body at rest: it switches there and back, or answers a step."""

import numpy as np

from femfit.core.errors import DomainError, MissingPartError, SimulationError
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.open_loop import simulate
from femfit.simulation.open_result import OpenLoop
from femfit.simulation.profile import Profile
from femfit.simulation.rest import rest_distance

FIRST_S, LONGEST_S = 0.05, 3.0
"""Conventional: duration that is tried first and doubled while something still moves, and the longest."""

WEAKEST = 1.0 / 64.0
"""Conventional: smallest part of the supply's voltage that is tried on a body that it drives out of its travel."""


def motion_at_supply(model: ActuatorModel) -> OpenLoop | None:
    """The motion that the supply's largest voltage makes of a body at rest.

    A body that rests on one of two stops is switched on and, once it is at rest again, off. A body that springs hold
    between them gets a step of the whole voltage, or of half, a quarter ... of it where that drives it to its ends.

    Returns
    -------
    OpenLoop or None
        None where there is no voltage drive, no mechanics, or nothing that keeps the body within the model, as with a
        levitated one.
    """
    circuit, motion = model.circuit, model.motion
    if circuit is None or motion is None or circuit.drive.kind == "current":
        return None
    voltage = max((circuit.voltage_max_V, circuit.voltage_min_V), key=abs)
    try:
        stops = [stop.distance_m for stop in (motion.near_stop, motion.far_stop) if stop is not None]
        if len(stops) == 2 and rest_distance(model) in stops:
            on = _until_rest(model, [voltage], [0.0])
            if on is None or not on.switchings or on.left_domain:
                return on
            return _until_rest(model, [voltage, 0.0], [0.0, on.duration_s])
        return _stepped(model, voltage) if motion.springs else None
    except (DomainError, MissingPartError, SimulationError):
        return None


def _until_rest(model: ActuatorModel, values: list[float], times: list[float]) -> OpenLoop | None:
    """A simulation of the command that lasts until nothing moves any more; None where the body leaves the domain."""
    after = FIRST_S
    while True:
        command = Profile("voltage", np.array(times), np.array(values))
        motion = simulate(model, drive=command, duration_s=times[-1] + after)
        if motion.left_domain:
            return None if any(name == "distance" for name, _ in motion.left_domain) else motion
        moving = [event.time_s for event in motion.events if event.name != "sticks"]
        still = abs(motion.table["velocity_m_s"][-1]) == 0.0 and (not moving or max(moving) < times[-1] + 0.8 * after)
        if (still and len(motion.switchings) == len(values)) or after > LONGEST_S:
            return motion
        after *= 2.0


def _stepped(model: ActuatorModel, voltage: float) -> OpenLoop | None:
    share, duration = 1.0, FIRST_S
    while share >= WEAKEST:
        motion = simulate(model, voltage_V=share * voltage, duration_s=duration)
        if motion.step is not None:
            return motion
        if motion.left_domain or motion.switchings or motion.touched:
            share *= 0.5
        elif duration > LONGEST_S:
            return None
        else:
            duration *= 2.0
    return None
