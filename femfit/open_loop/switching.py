"""Pull-in and drop-out: when the body leaves one stop and reaches the other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from femfit.open_loop.chopping import command_before
from femfit.open_loop.profile import Profile
from femfit.open_loop.run import Event
from femfit.open_loop.system import Side

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
        The last change of the command before the body started; of a chopped one, where the chopping began.
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
            command = command_before(profiles, started, ways[-1].reached_s if ways else 0.0)
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
