"""From event to event: each stretch of smooth motion is integrated, each event located and answered.

References
----------
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I (Springer, 1993), section II.6: the
event is a zero of the dense output.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp

from femfit.core.errors import SimulationError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import circuit_currents
from femfit.simulation.profile import AT_MAX, AT_MIN, BLOCKED, CONDUCTING, FOLLOWING, Feed
from femfit.simulation.system import AWAY, ENERGIES, Mode, Side, System

SLACK = 1e-6
"""Conventional: part of the validity domain's width by which a point may lie outside of it, as one at its edge does."""

RTOL = 1e-9
"""Derived: a thousand steps may each miss by so much before the energies are off by a millionth."""

STIFF = 3000.0
"""Conventional: fastest rate times duration from which an implicit method costs less than an explicit one's steps."""

INTERPOLATED = 3.0
"""Chosen: longest step times the fastest rate; over longer ones the table between the steps, which is interpolated, is
off by a ten-thousandth of the range although the steps are right."""

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


Reading = Callable[[float, FloatArray], float]
"""A number at a time and a state."""


@dataclass(frozen=True)
class Watch:
    """An event: a reading comes to a level from one side, and what answers it."""

    reading: Reading
    level: float
    direction: float  # Of the crossing
    answer: Callable[[], None]
    terminal: ClassVar[bool] = True

    def __call__(self, time: float, state: FloatArray) -> float:
        """How far the reading is above the level, as SciPy asks for it."""
        return self.reading(time, state) - self.level


def entry(k: int) -> Reading:
    """The reading of a state."""
    return lambda _, state: float(state[k])


class Walk:
    """A motion from a state at rest: its stretches without events, its events so far, and the last state.

    Behind its own states the state has the energies that have gone. ``left_domain`` says which ranges (distance,
    current, current_NAME) were left, and when; what comes after is extrapolated, or none.
    """

    def __init__(self, system: System, state: FloatArray, duration: float, extrapolate: bool) -> None:
        self.system, self.extrapolate = system, extrapolate
        self.first, self.time = np.concatenate([state, np.zeros(len(ENERGIES))]), 0.0
        self.state = self.first.copy()
        turns = {turn for driver in system.drivers for turn in driver.commanded.turns_s.tolist()}
        self.turns = [*sorted(turn for turn in turns if 0.0 < turn < duration), duration]
        self.stretches: list[tuple[Mode, OdeSolution]] = []
        self.events: list[Event] = []
        self.left_domain: dict[str, float] = {}
        self.longest_step = np.inf
        # The first mode: on a stop or not, held or moving
        self.mode = Mode(())
        self._command()
        reached = [side for side, stop in system.stops.items() if stop.distance_m == float(state[0])]
        support = next((side for side in reached if system.stops[side].stiffness_N_per_m is None), None)
        self.mode = replace(self.mode, touching=next((side for side in reached if side != support), None))
        self._rest_or_move(support)
        at_once = 0
        while self.time < duration and (extrapolate or not self.left_domain):
            start = self.time
            self._advance(next(turn for turn in self.turns if turn > start))
            at_once = at_once + 1 if self.time == start else 0
            if len(self.events) > _MOST_EVENTS or at_once > _MOST_AT_ONCE:
                raise SimulationError(
                    f"The motion must have at most {_MOST_EVENTS} events, and not more than {_MOST_AT_ONCE} at one "
                    f"time; at {1e3 * self.time:.6g} ms it goes back and forth between {self.events[-2].name} and "
                    f"{self.events[-1].name}. Simulate a shorter time, or give the stops a smaller restitution."
                )

    def _advance(self, turn: float) -> None:
        """To the next event, or to a turn of the command."""
        watches = [*self._of_body(), *self._of_domain(), *self._of_circuits()]
        solution = self._integrated(turn, watches)
        self.state, self.time = solution.y[:, -1].copy(), float(solution.t[-1])
        self.stretches.append((self.mode, solution.sol))
        self.longest_step = np.inf
        occurred = [watch for watch, times in zip(watches, solution.t_events, strict=True) if len(times)]
        for watch in occurred:
            watch.answer()
        if not occurred:
            self._command()

    def _integrated(self, end: float, watches: list[Watch]) -> Any:
        """SciPy's solution up to the first event, or the end."""
        moment, fastest = self.system.moment(self.mode), self.system.fastest_rate(self.mode, self.state)
        stiff = fastest * (end - self.time) > STIFF
        with np.errstate(over="ignore", invalid="ignore"):
            solution = solve_ivp(
                lambda time, state: moment(time, state)[:-1],
                (self.time, end),
                self.state,
                method="LSODA" if stiff else "DOP853",
                rtol=RTOL,
                atol=RTOL * self.system.scales,
                events=watches,
                dense_output=True,
                max_step=self.longest_step if stiff or not fastest else min(self.longest_step, INTERPOLATED / fastest),
            )
        if solution.status < 0 or not np.all(np.isfinite(solution.y[:, -1])):
            currents = solution.y[2 : 2 + len(self.system.drivers), -1]
            raise SimulationError(
                f"The motion must be finite; it cannot be followed beyond {1e3 * solution.t[-1]:.6g} ms, at "
                f"{1e3 * solution.y[0, -1]:.4g} mm{''.join(f' and {current:.4g} A' for current in currents)}. Keep it "
                "within the validity domain."
            )
        return solution

    def _of_body(self) -> Iterator[Watch]:
        """The body starts, comes to a stop or leaves it, or stands still."""
        system, mode = self.system, self.mode
        if not mode.sliding:
            moment = system.moment(mode)

            def net(time: float, state: FloatArray) -> float:
                return float(moment(time, state)[-1])

            for way, side in ((1, "far"), (-1, "near")):
                if mode.support != side:
                    yield Watch(net, way * system.breakaway_N, way, partial(self._start, way))
            return
        for side, stop in system.stops.items():
            level, away = stop.distance_m, AWAY[side]
            if stop.stiffness_N_per_m is None:
                yield Watch(entry(0), level, -away, partial(self._hit, side))
            elif mode.touching == side:  # a body that rises by less is not said to leave
                leaves = partial(self._touch, side, touching=False)
                yield Watch(entry(0), level + away * system.least_rebound_m, away, leaves)
            else:
                yield Watch(entry(0), level, -away, partial(self._touch, side, touching=True))
        if system.mechanics.coulomb_N:
            yield Watch(entry(1), 0.0, -mode.sliding, self._still)

    def _of_domain(self) -> Iterator[Watch]:
        """Distance or a current leaves the validity domain."""
        box, circuits = self.system.model.validity, [driver.circuit.name for driver in self.system.drivers]
        limits = box.current_limits_A.tolist()

        def mirrored(_: float, state: FloatArray, k: int) -> float:
            # All currents count reversed together, where most of them flow that way
            return float(state[k]) * (-1.0 if np.sum(state[2 : 2 + len(limits)]) < 0.0 else 1.0)

        ranges: dict[str, tuple[Reading, float, float]] = {
            "distance": (entry(0), box.distance_min_m, box.distance_max_m)
        }
        for k, column in enumerate(circuit_currents(circuits)):
            current = partial(mirrored, k=2 + k) if box.mirrored else entry(2 + k)
            ranges[column.removesuffix("_A")] = (current, *limits[k])
        for name, (reading, low, high) in ranges.items():
            if name not in self.left_domain:
                slack, leave = SLACK * (high - low), partial(self._leave, name)
                yield Watch(reading, low - slack, -1.0, leave)
                yield Watch(reading, high + slack, 1.0, leave)

    def _of_circuits(self) -> Iterator[Watch]:
        """A diode or an amplifier begins or ends to hold its current."""
        system, mode = self.system, self.mode

        def volts(time: float, state: FloatArray, k: int) -> float:
            return system.voltages(mode, time, state)[k]

        def behind(time: float, state: FloatArray, k: int) -> float:
            return mode.feeds[k].command(time) - float(state[2 + k])

        for k, (driver, feed) in enumerate(zip(system.drivers, mode.feeds, strict=True)):
            if feed.mode == BLOCKED:
                flows = partial(self._switch, k, "current_flows", CONDUCTING)
                yield Watch(partial(system.conducts, mode, k), 0.0, 1.0, flows)
            elif feed.mode == FOLLOWING:
                yield Watch(partial(volts, k=k), driver.circuit.voltage_max_V + driver.slack_V, 1.0, self._settle)
                yield Watch(partial(volts, k=k), driver.circuit.voltage_min_V - driver.slack_V, -1.0, self._settle)
            elif feed.mode in {AT_MAX, AT_MIN}:
                yield Watch(partial(behind, k=k), 0.0, -1.0 if feed.mode == AT_MAX else 1.0, partial(self._reach, k))
            elif driver.diode_V is not None:
                yield Watch(entry(2 + k), 0.0, -1.0, partial(self._switch, k, "current_stops", BLOCKED))

    def _command(self) -> None:
        """The lines of the commands from now on, and the drivers' modes that they ask for."""
        lines = [driver.commanded.line(self.time) for driver in self.system.drivers]
        self.mode = replace(self.mode, feeds=tuple(Feed(CONDUCTING, self.time, *line) for line in lines))
        self._settle()

    def _settle(self) -> None:
        self.mode = self.system.settled(self.mode, self.time, self.state)

    def _tell(self, name: str, circuit: int | None = None) -> None:
        drivers = self.system.drivers
        d, v, *i = (float(value) for value in self.state[: 2 + len(drivers)])
        named = drivers[circuit].circuit.name if circuit is not None and len(drivers) > 1 else ""
        self.events.append(Event(self.time, name, d, v, i[0] if len(i) == 1 else tuple(i), named))

    def _leave(self, name: str) -> None:
        self._tell(f"{name}_leaves_domain")
        self.left_domain[name] = self.time

    def _switch(self, k: int, event: str, driver_mode: str) -> None:
        self._tell(event, k)
        if driver_mode == BLOCKED:
            self.state[2 + k] = 0.0
        self.mode = self.mode.driven_as(k, driver_mode)

    def _reach(self, k: int) -> None:
        """An amplifier comes to its command."""
        self.state[2 + k] = self.mode.feeds[k].command(self.time)
        self._settle()

    def _start(self, direction: int) -> None:
        self._tell("starts")
        self.mode = replace(self.mode, support=None, sliding=direction)

    def _net(self) -> float:
        return float(self.system.moment(self.mode)(self.time, self.state)[-1])

    def _rest_or_move(self, support: Side | None, event: str = "") -> None:
        """A body at rest stays so, which is told as an event, or moves where the net force takes it."""
        net = self._net()
        direction = 1 if net > 0.0 else -1
        blocked = support is not None and direction == -AWAY[support]
        held = blocked or abs(net) <= self.system.breakaway_N
        if held and event:
            self._tell(event)
        self.mode = replace(self.mode, support=support if held else None, sliding=0 if held else direction)

    def _still(self) -> None:
        self.state[1] = 0.0
        self._rest_or_move(None, "sticks")

    def _touch(self, side: Side, touching: bool) -> None:
        self._tell(f"{'hits' if touching else 'leaves'}_{side}")
        if touching:
            self.state[0] = self.system.stops[side].distance_m
        self.mode = replace(self.mode, touching=side if touching else None)

    def _hit(self, side: Side) -> None:
        """The speed is turned round and cut by the restitution; one that ends the rebounds is taken whole."""
        system, stop, mass = self.system, self.system.stops[side], self.system.mechanics.mass_kg
        self._tell(f"hits_{side}")
        before, self.state[0] = float(self.state[1]), stop.distance_m
        pressing = (-AWAY[side] * self._net() + system.mechanics.coulomb_N) / mass
        after = -stop.restitution * before
        if pressing > 0.0 and after**2 < 2.0 * pressing * system.least_rebound_m:
            after = 0.0
        self.state[system.model.order + ENERGIES.index("impact")] += 0.5 * mass * (before**2 - after**2)
        if after == 0.0:
            self.state[1] = 0.0
            self._rest_or_move(side, f"rests_{side}")
            return
        self.state[1] = after
        self.mode = replace(self.mode, sliding=AWAY[side])
        if pressing > 0.0:  # so that the rebound is not stepped over
            self.longest_step = 0.5 * abs(after) / pressing
