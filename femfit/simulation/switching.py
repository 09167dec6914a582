"""Pull-in and drop-out: when the body leaves one stop and reaches the other.

How a body that reaches no stop answers one step of the command: rise, overshoot, settling.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.simulation.events import Event
from femfit.simulation.profile import Profile
from femfit.simulation.system import Side

Kind = Literal["pull_in", "drop_out", "to_near", "to_far"]


@dataclass(frozen=True)
class Switching:
    """One way to a stop.

    Parameters
    ----------
    kind : str
        ``pull_in`` from rest on the far stop to the near one, ``drop_out`` back; ``to_near`` or ``to_far`` from between
        them, or rebounding from the other one without having come to rest there.
    command_s : float
        The last change of the command before the body started.
    started_s, reached_s : float
        When it started, and when it first touched the stop.
    rested_s : float or None
        When it came to rest on it; None where it has not, or the stop gives way.
    seating_velocity_m_s : float
        Speed of the first touch.
    bounces : int
        Touches after the first.
    """

    kind: Kind
    command_s: float
    started_s: float
    reached_s: float
    rested_s: float | None
    seating_velocity_m_s: float
    bounces: int

    @property
    def switching_time_s(self) -> float:
        """From the command to the first touch."""
        return self.reached_s - self.command_s


def switchings(events: Sequence[Event], begun_at: Side | None, profiles: Sequence[Profile]) -> tuple[Switching, ...]:
    """Every way to a stop in a list of events, from a start on a stop or in the air."""
    ways: list[Switching] = []
    turns = np.concatenate([[0.0], *(profile.turns_s for profile in profiles)])
    last_side, started, rebounds = begun_at, 0.0, False
    for event in events:
        action, _, place = event.name.partition("_")
        side: Side | None = "near" if place == "near" else "far" if place == "far" else None
        if event.name == "starts":
            started = event.time_s
        elif action == "rests" and ways:
            ways[-1] = replace(ways[-1], rested_s=event.time_s)
        elif action == "hits" and side == last_side and ways:
            ways[-1] = replace(ways[-1], bounces=ways[-1].bounces + 1, rested_s=None)
        elif action == "hits" and side != last_side:
            command = float(turns[turns <= started].max())
            kind: Kind = "pull_in" if side == "near" else "drop_out"
            if last_side is None or rebounds:
                kind = "to_near" if side == "near" else "to_far"
            ways.append(Switching(kind, command, started, event.time_s, None, abs(event.velocity_m_s), 0))
            last_side = side
        if action in {"hits", "rests", "starts", "leaves"}:
            rebounds = action == "hits"
        if action in {"hits", "leaves"}:  # where it goes on without resting
            started = event.time_s
    return tuple(ways)


BAND = 0.02
"""Conventional: settled is what stays within this part of the whole change."""

LAST = 0.1
"""Conventional: part of the time at whose beginning the motion must have settled for its end to be known."""


@dataclass(frozen=True)
class StepResponse:
    """From one place of rest to another.

    Parameters
    ----------
    start_m, end_m : float
        Distances at rest.
    rise_s : float
        From 10 to 90 % of the change, at their first passing.
    overshoot : float
        Largest excess over the change, as a part of it; 0 where there is none.
    settling_s : float
        After which the distance stays within 2 % of the change.
    """

    start_m: float
    end_m: float
    rise_s: float
    overshoot: float
    settling_s: float


def step_response(time: FloatArray, distance: FloatArray) -> StepResponse | None:
    """Of a motion that begins at rest at time 0; None where it does not move, or has not settled at its end."""
    change = float(distance[-1] - distance[0])
    if change == 0.0:
        return None
    way = (distance - distance[0]) / change
    outside = np.flatnonzero(np.abs(way - 1.0) > BAND)
    settled = outside[-1] + 1
    if time[settled] > (1.0 - LAST) * time[-1]:
        return None
    crossings = []
    for level in (0.1, 0.9):  # linear between the samples on either side
        after = int(np.argmax(way >= level))
        pair = slice(after - 1, after + 1)
        crossings.append(float(np.interp(0.0, way[pair] - level, time[pair])))
    rise = crossings[1] - crossings[0]
    excess = float(way.max() - 1.0)
    overshoot = excess if excess > 1e-6 else 0.0
    return StepResponse(float(distance[0]), float(distance[-1]), rise, overshoot, float(time[settled]))
