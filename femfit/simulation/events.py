"""From event to event: each stretch of smooth motion is integrated, each event located and answered.

References
----------
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I (Springer, 1993), section II.6: the
event is a zero of the dense output.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.integrate import OdeSolution

from femfit.core.errors import SimulationError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import circuit_currents
from femfit.simulation.feed import AT_MAX, AT_MIN, BLOCKED, CONDUCTING, FOLLOWING, Line
from femfit.simulation.profile import Profile
from femfit.simulation.system import ENERGIES, Lines, Mode, Reading, Side, System, integrated

SLACK = 1e-6
"""Conventional: part of the validity domain's width by which a point may lie outside of it, as one at its edge does."""

_MOST_EVENTS = 100_000
_MOST_AT_ONCE = 50


@dataclass(frozen=True)
class Event:
    """Something that happened: when, what, and in which state."""

    time_s: float
    name: str
    distance_m: float
    velocity_m_s: float  # Before it
    current_A: float | tuple[float, ...]  # One each of several circuits
    circuit: str = ""  # Which of several it happens to


@dataclass(frozen=True, eq=False)
class Stretch:
    """Motion without events."""

    start_s: float
    end_s: float
    mode: Mode
    lines: Lines
    solution: OdeSolution


@dataclass(frozen=True)
class Watch:
    """An event: a function of time and state whose zero it is, the direction that counts, and what answers it."""

    value: Reading
    direction: float
    answer: Callable[[], None]


class Walk:
    """A motion from a state at rest, one profile a circuit: its stretches and events so far, and the last state.

    Behind its own states the state has the energies that have gone. ``left_domain`` says which ranges (distance,
    current, current_NAME) were left, and when; what comes after is extrapolated, or none.
    """

    def __init__(
        self, system: System, profiles: Sequence[Profile], state: FloatArray, duration: float, extrapolate: bool
    ) -> None:
        state = np.concatenate([state, np.zeros(len(ENERGIES))])
        self.system, self.profiles, self.extrapolate = system, profiles, extrapolate
        self.first, self.state, self.time = state.copy(), state.copy(), 0.0
        turns = sorted({turn for profile in profiles for turn in profile.turns_s.tolist() if 0.0 < turn < duration})
        self.turns = [*turns, duration]
        self.stretches: list[Stretch] = []
        self.events: list[Event] = []
        self.left_domain: dict[str, float] = {}
        self.ended = False
        self.longest_step = np.inf
        self.at_once = 0
        # The first mode: on a stop or not, held or moving
        self.mode = Mode((CONDUCTING,) * len(profiles))
        self._command()
        reached = [side for side, stop in system.stops.items() if stop.distance_m == float(state[0])]
        support = next((side for side in reached if system.stops[side].stiffness_N_per_m is None), None)
        self.mode = replace(self.mode, touching=next((side for side in reached if side != support), None))
        self._rest_or_move(support, self._net())
        while self.time < duration and not self.ended:
            self._advance()

    def _advance(self) -> None:
        """To the next event or turn of the command."""
        system, start = self.system, self.time
        end = next(turn for turn in self.turns if turn > start)
        watches = [*self._of_body(), *self._of_domain()]
        for k in range(len(self.lines)):
            watches += self._of_circuit(k)
        events = [(watch.value, watch.direction) for watch in watches]
        solution = integrated(system, self.mode, self.lines, self.state, (start, end), events, self.longest_step)
        self.state, self.time = solution.y[:, -1].copy(), float(solution.t[-1])
        self.stretches.append(Stretch(start, self.time, self.mode, self.lines, solution.sol))
        self.longest_step = np.inf
        occurred = [watch for watch, times in zip(watches, solution.t_events, strict=True) if len(times)]
        if not occurred:
            self._command()
        for watch in occurred:
            watch.answer()
        self.at_once = self.at_once + 1 if self.time == start else 0
        if len(self.events) > _MOST_EVENTS or self.at_once > _MOST_AT_ONCE:
            raise SimulationError(
                f"The motion must have at most {_MOST_EVENTS} events, and not more than {_MOST_AT_ONCE} at one time; "
                f"at {1e3 * self.time:.6g} ms it goes back and forth between {self.events[-2].name} and "
                f"{self.events[-1].name}. Simulate a shorter time, or give the stops a smaller restitution."
            )

    def _of_body(self) -> list[Watch]:
        """The body starts, comes to a stop or leaves it, or stands still."""
        system, mode, lines = self.system, self.mode, self.lines
        if mode.held:
            moment = system.moment(mode, lines)

            def over(time: float, state: FloatArray, way: int = 1) -> float:
                return way * float(moment(time, state)[-1]) - system.breakaway_N

            ways = [way for way, blocked in ((1, "far"), (-1, "near")) if mode.support != blocked]
            return [Watch(partial(over, way=way), 1.0, partial(self._start, way)) for way in ways]
        watches = []
        for side, stop in system.stops.items():

            def depth(_: float, state: FloatArray, side: Side = side, risen: float = 0.0) -> float:
                return system.depth(side, state) + risen

            if stop.stiffness_N_per_m is None:
                watches.append(Watch(depth, 1.0, partial(self._hit, side)))
            elif mode.touching == side:  # a body that rises by less is not said to leave
                leaving = partial(depth, risen=system.least_rebound_m)
                watches.append(Watch(leaving, -1.0, partial(self._touch, side, touching=False)))
            else:
                watches.append(Watch(depth, 1.0, partial(self._touch, side, touching=True)))
        if mode.sliding:
            watches.append(Watch(lambda _, state: float(state[1]), -float(mode.sliding), self._still))
        return watches

    def _of_domain(self) -> list[Watch]:
        """Distance or a current leaves the validity domain."""
        windings, box = self.system.feed.windings, self.system.feed.model.validity
        names = [column.rpartition("_")[0] for column in circuit_currents([w.circuit.name for w in windings])]
        limits = box.current_limits_A.tolist()
        ranges = {"distance": (0, box.distance_min_m, box.distance_max_m)}
        ranges |= {name: (2 + k, *limits[k]) for k, name in enumerate(names)}
        watches = []
        for name, (index, low, high) in ranges.items():
            slack = SLACK * (high - low)

            def inside(
                _: float, state: FloatArray, k: int = index, low: float = low - slack, high: float = high + slack
            ) -> float:
                # Of a mirrored domain all currents count reversed together, where most of them flow that way
                reversed_together = k >= 2 and box.mirrored and float(np.sum(state[2 : 2 + len(limits)])) < 0.0
                value = -float(state[k]) if reversed_together else float(state[k])
                return min(value - low, high - value)

            if name not in self.left_domain:
                watches.append(Watch(inside, -1.0, partial(self._leave, name)))
        return watches

    def _of_circuit(self, k: int) -> list[Watch]:
        """A diode or an amplifier of one circuit begins or ends to hold its current."""
        feed, size, mode, lines = self.system.feed, self.system.size, self.mode, self.lines
        winding, circuit, state_of_drive = feed.windings[k], feed.windings[k].circuit, mode.feed[k]
        if state_of_drive == BLOCKED:
            flows = partial(self._switch, k, "current_flows", CONDUCTING)
            return [Watch(lambda time, state: feed.conducts(mode.feed, k, lines, time, state[:size]), 1.0, flows)]
        if state_of_drive == FOLLOWING:

            def volts(time: float, state: FloatArray) -> float:
                return feed.voltages(mode.feed, lines, time, state[:size])[k]

            slack = 1e-9 * winding.voltage_scale_V
            return [
                Watch(lambda time, state: volts(time, state) - circuit.voltage_max_V - slack, 1.0, self._settle),
                Watch(lambda time, state: circuit.voltage_min_V - slack - volts(time, state), 1.0, self._settle),
            ]
        if state_of_drive in {AT_MAX, AT_MIN}:
            sign = 1.0 if state_of_drive == AT_MAX else -1.0
            behind = lambda time, state: sign * (lines[k].at(time) - float(state[2 + k]))  # noqa: E731
            return [Watch(behind, -1.0, partial(self._reach, k))]
        stops = partial(self._switch, k, "current_stops", BLOCKED)
        return [] if winding.diode_V is None else [Watch(lambda _, state: float(state[2 + k]), -1.0, stops)]

    def _command(self) -> None:
        """The line from now on, and the feed's mode that it asks for."""
        self.lines: Lines = tuple(Line(self.time, *profile.line(self.time)) for profile in self.profiles)
        self._settle()

    def _settle(self) -> None:
        feed, state = self.system.feed, self.state[: self.system.size]
        self.mode = replace(self.mode, feed=feed.settled(self.mode.feed, self.lines, self.time, state))

    def _tell(self, name: str, circuit: int | None = None) -> None:
        d, v, *i = (float(value) for value in self.state[: 2 + len(self.lines)])
        windings = self.system.feed.windings
        named = windings[circuit].circuit.name if circuit is not None and len(windings) > 1 else ""
        self.events.append(Event(self.time, name, d, v, i[0] if len(i) == 1 else tuple(i), named))

    def _leave(self, name: str) -> None:
        self._tell(f"{name}_leaves_domain")
        self.left_domain[name] = self.time
        self.ended = not self.extrapolate

    def _switch(self, k: int, event: str, state_of_drive: str) -> None:
        self._tell(event, k)
        if state_of_drive == BLOCKED:
            self.state[2 + k] = 0.0
        feed = self.mode.feed
        self.mode = replace(self.mode, feed=(*feed[:k], state_of_drive, *feed[k + 1 :]))

    def _reach(self, k: int) -> None:
        """An amplifier comes to its command."""
        self.state[2 + k] = self.lines[k].at(self.time)
        self._settle()

    def _slides(self, direction: int) -> int:
        """The direction that dry friction brakes; 0 where there is none."""
        return direction if self.system.mechanics.coulomb_N else 0

    def _start(self, direction: int) -> None:
        self._tell("starts")
        self.mode = replace(self.mode, held=False, support=None, sliding=self._slides(direction))

    def _net(self) -> float:
        return float(self.system.moment(self.mode, self.lines)(self.time, self.state)[-1])

    def _rest_or_move(self, support: Side | None, net: float, event: str = "") -> None:
        """A body at rest stays so, which is told as an event, or moves where the net force in N takes it."""
        system = self.system
        up, down = net > system.breakaway_N and support != "far", net < -system.breakaway_N and support != "near"
        if up or down:
            self.mode = replace(self.mode, held=False, support=None, sliding=self._slides(1 if up else -1))
            return
        self.mode = replace(self.mode, held=True, support=support, sliding=0)
        if event:
            self._tell(event)

    def _still(self) -> None:
        self.state[1] = 0.0
        self._rest_or_move(None, self._net(), "sticks")

    def _touch(self, side: Side, touching: bool) -> None:
        self._tell(f"{'hits' if touching else 'leaves'}_{side}")
        if touching:
            self.state[0] = self.system.stops[side].distance_m
        self.mode = replace(self.mode, touching=side if touching else None)

    def _hit(self, side: Side) -> None:
        """The speed is turned round and cut by the restitution; one that ends the rebounds is taken whole."""
        system, stop, mass = self.system, self.system.stops[side], self.system.mechanics.mass_kg
        self._tell(f"hits_{side}")
        away = 1 if side == "near" else -1
        before, self.state[0] = float(self.state[1]), stop.distance_m
        net = self._net()
        pressing = (-away * net + system.mechanics.coulomb_N) / mass
        after = -stop.restitution * before
        if pressing > 0.0 and after**2 < 2.0 * pressing * system.least_rebound_m:
            after = 0.0
        self.state[1] = after
        self.state[system.size + ENERGIES.index("impact")] += 0.5 * mass * (before**2 - after**2)
        if after == 0.0:
            self._rest_or_move(side, net, f"rests_{side}")
            return
        self.mode = replace(self.mode, sliding=self._slides(away))
        if pressing > 0.0:  # so that the rebound is not stepped over
            self.longest_step = 0.5 * abs(after) / pressing
