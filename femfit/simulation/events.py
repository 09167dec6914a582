"""From event to event: each stretch of smooth motion is integrated, each event located and answered.

References
----------
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I (Springer, 1993), section II.6: the
event is a zero of the dense output.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp

from femfit.core.errors import SimulationError
from femfit.core.numerics import FloatArray
from femfit.simulation.feed import BLOCKED, CONDUCTING, Line
from femfit.simulation.profile import Profile
from femfit.simulation.system import ENERGIES, SIDES, Lines, Mode, Side, System, Watch

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


@dataclass(frozen=True, eq=False)
class Stretch:
    """Motion without events."""

    start_s: float
    end_s: float
    mode: Mode
    lines: Lines
    solution: OdeSolution


@dataclass(frozen=True, eq=False)
class Run:
    """All stretches and events, and the last state with its energies."""

    stretches: tuple[Stretch, ...]
    events: tuple[Event, ...]
    first: FloatArray
    last: FloatArray
    end_s: float
    # Name of the range (distance, current, current_NAME) that was left, and when; the rest is extrapolated, or none
    left_domain: tuple[tuple[str, float], ...]


def run(system: System, profiles: Sequence[Profile], state: FloatArray, duration: float, extrapolate: bool) -> Run:
    """Simulate from a state at rest; one profile a circuit."""
    walk = _Walk(system, profiles, np.concatenate([state, np.zeros(len(ENERGIES))]), duration, extrapolate)
    walk.begin()
    while walk.time < duration and not walk.ended:
        walk.advance()
    return Run(
        tuple(walk.stretches), tuple(walk.events), walk.first, walk.state, walk.time, tuple(walk.left_domain.items())
    )


class _Walk:
    """The state between two stretches."""

    def __init__(
        self, system: System, profiles: Sequence[Profile], state: FloatArray, duration: float, extrapolate: bool
    ) -> None:
        self.system, self.profiles, self.duration, self.extrapolate = system, profiles, duration, extrapolate
        self.first, self.state, self.time = state.copy(), state.copy(), 0.0
        self.mode = Mode((CONDUCTING,) * len(profiles))
        self.lines: Lines = tuple(Line(0.0, 0.0, 0.0) for _ in profiles)
        turns = sorted({turn for profile in profiles for turn in profile.turns_s.tolist() if 0.0 < turn < duration})
        self.turns = [*turns, duration]
        self.stretches: list[Stretch] = []
        self.events: list[Event] = []
        self.left_domain: dict[str, float] = {}
        self.ended = False
        self.longest_step = np.inf
        self.at_once = 0
        self.answers: dict[str, Callable[[], None]] = {  # of the body
            "hits_near": lambda: self._hit("near"),
            "hits_far": lambda: self._hit("far"),
            "touches_near": lambda: self._touch("near", True),
            "touches_far": lambda: self._touch("far", True),
            "leaves_near": lambda: self._touch("near", False),
            "leaves_far": lambda: self._touch("far", False),
            "still": self._still,
            "up": lambda: self._start(1),
            "down": lambda: self._start(-1),
        }

    def begin(self) -> None:
        """The first mode: on a stop or not, held or moving."""
        self._command()
        d = float(self.state[0])
        stops = {side: self.system.stop(side) for side in SIDES}
        reached = [(side, stop) for side, stop in stops.items() if stop is not None and stop.distance_m == d]
        support = next((side for side, stop in reached if stop.stiffness_N_per_m is None), None)
        self.mode = replace(self.mode, touching=next((side for side, _ in reached if side != support), None))
        self.mode = self.system.from_rest(self.mode, support, self._net())

    def advance(self) -> None:
        """To the next event or turn of the command."""
        system, start = self.system, self.time
        end = next(turn for turn in self.turns if turn > start)
        watches = system.watches(self.mode, self.lines, tuple(self.left_domain))
        solution = self._integrate(watches, end)
        self.state, self.time = solution.y[:, -1].copy(), float(solution.t[-1])
        self.stretches.append(Stretch(start, self.time, self.mode, self.lines, solution.sol))
        self.longest_step = np.inf
        occurred = [watch for watch, times in zip(watches, solution.t_events, strict=True) if len(times)]
        if not occurred:
            self._command()
        for watch in occurred:
            self._answer(watch)
        self.at_once = self.at_once + 1 if self.time == start else 0
        if len(self.events) > _MOST_EVENTS or self.at_once > _MOST_AT_ONCE:
            raise SimulationError(
                f"The motion must have at most {_MOST_EVENTS} events, and not more than {_MOST_AT_ONCE} at one time; "
                f"at {1e3 * self.time:.6g} ms it goes back and forth between {self.events[-2].name} and "
                f"{self.events[-1].name}. Simulate a shorter time, or give the stops a smaller restitution."
            )

    def _integrate(self, watches: list[Watch], end: float) -> Any:
        system, functions = self.system, []
        for watch in watches:

            def value(time: float, state: FloatArray, watch: Watch = watch) -> float:
                return watch.value(time, state)

            value.terminal, value.direction = True, watch.direction  # type: ignore[attr-defined]
            functions.append(value)
        fastest = self._fastest_rate()
        stiff = fastest * (end - self.time) > STIFF
        longest = self.longest_step if stiff or not fastest else min(self.longest_step, INTERPOLATED / fastest)
        with np.errstate(over="ignore", invalid="ignore"):
            solution = solve_ivp(
                system.rates(self.mode, self.lines),
                (self.time, end),
                self.state,
                method="LSODA" if stiff else "DOP853",
                rtol=RTOL,
                atol=RTOL * self.scales(),
                events=functions,
                dense_output=True,
                max_step=longest,
            )
        if solution.status < 0 or not np.all(np.isfinite(solution.y[:, -1])):
            raise SimulationError(
                f"The motion must be finite; it cannot be followed beyond {1e3 * solution.t[-1]:.6g} ms, at "
                f"{1e3 * solution.y[0, -1]:.4g} mm{self._currents_there(solution.y[:, -1])}. Keep it within the "
                "validity domain."
            )
        return solution

    def scales(self) -> FloatArray:
        """What is large for each state: the domain's ranges, and what the largest force does over them."""
        box, system = self.system.domain, self.system
        travel = box.distance_max_m - box.distance_min_m
        currents = np.abs(box.current_limits_A).max(axis=1)[: len(system.feed.windings)]
        work = system.force_scale_N * travel
        speed = np.sqrt(work / system.mechanics.mass_kg)
        result = np.ones(system.size + len(ENERGIES))
        end = 2 + len(currents)
        result[0], result[1], result[2:end] = travel, speed, currents
        result[end : end + len(system.eddies_A)] = system.eddies_A
        result[system.size :] = work
        return result

    def _fastest_rate(self) -> float:
        system, windings = self.system, self.system.feed.model.windings
        rate = system.feed.bandwidth
        if windings.count:
            magnetic = windings.magnetics.state(self.state[0], self.state[2 : windings.end])
            decay = np.linalg.solve(magnetic.inductance + windings.series_H, np.diag(windings.resistances_ohm))
            rate = max(rate, float(np.abs(decay).sum(axis=1).max()))
        stop = None if self.mode.touching is None else system.stop(self.mode.touching)
        if stop is not None and stop.stiffness_N_per_m is not None:
            rate = max(rate, float(np.sqrt(stop.stiffness_N_per_m / system.mechanics.mass_kg)))
        return rate

    def _command(self) -> None:
        """The line from now on, and the feed's mode that it asks for."""
        self.lines = tuple(Line(self.time, *profile.line(self.time)) for profile in self.profiles)
        self._settle()

    def _settle(self) -> None:
        feed, state = self.system.feed, self.state[: self.system.size]
        self.mode = replace(self.mode, feed=feed.settled(self.mode.feed, self.lines, self.time, state))

    def _net(self) -> float:
        return self.system.net_force(self.mode, self.lines, self.time, self.state)

    def _tell(self, name: str, circuit: int | None = None) -> None:
        d, v, *i = (float(value) for value in self.state[: 2 + len(self.lines)])
        windings = self.system.feed.windings
        named = windings[circuit].circuit.name if circuit is not None and len(windings) > 1 else ""
        self.events.append(Event(self.time, name, d, v, i[0] if len(i) == 1 else tuple(i), named))

    def _currents_there(self, state: FloatArray) -> str:
        return "".join(f" and {current:.4g} A" for current in state[2 : 2 + len(self.lines)])

    def _answer(self, watch: Watch) -> None:
        if watch.name in self.answers:
            self.answers[watch.name]()
        elif watch.circuit is not None:
            self._answer_circuit(watch.name, watch.circuit)
        else:
            self._tell(f"{watch.name}_leaves_domain")
            self.left_domain[watch.name] = self.time
            self.ended = not self.extrapolate

    def _answer_circuit(self, name: str, k: int) -> None:
        if name in {"blocks", "conducts"}:
            self._tell("current_stops" if name == "blocks" else "current_flows", k)
            feed = list(self.mode.feed)
            feed[k] = BLOCKED if name == "blocks" else CONDUCTING
            if name == "blocks":
                self.state[2 + k] = 0.0
            self.mode = replace(self.mode, feed=tuple(feed))
            return
        if name == "reaches":  # an amplifier its command; else its voltage's end
            self.state[2 + k] = self.lines[k].at(self.time)
        self._settle()

    def _start(self, direction: int) -> None:
        self._tell("starts")
        self.mode = replace(self.mode, held=False, support=None, sliding=self.system.slides(direction))

    def _still(self) -> None:
        self.state[1] = 0.0
        self.mode = self.system.from_rest(self.mode, None, self._net())
        if self.mode.held:
            self._tell("sticks")

    def _touch(self, side: Side, touching: bool) -> None:
        stop = self.system.stop(side)
        assert stop is not None  # noqa: S101  only such a stop is watched
        self._tell(f"{'hits' if touching else 'leaves'}_{side}")
        if touching:
            self.state[0] = stop.distance_m
        self.mode = replace(self.mode, touching=side if touching else None)

    def _hit(self, side: Side) -> None:
        """The speed is turned round and cut by the restitution; one that ends the rebounds is taken whole."""
        system, stop = self.system, self.system.stop(side)
        assert stop is not None  # noqa: S101  only such a stop is watched
        self._tell(f"hits_{side}")
        away = 1 if side == "near" else -1
        before, self.state[0] = float(self.state[1]), stop.distance_m
        net = self._net()
        pressing = (-away * net + system.mechanics.coulomb_N) / system.mechanics.mass_kg
        after = -stop.restitution * before
        if pressing > 0.0 and after**2 < 2.0 * pressing * system.least_rebound_m:
            after = 0.0
        self.state[1] = after
        self.state[system.size + ENERGIES.index("impact")] += 0.5 * system.mechanics.mass_kg * (before**2 - after**2)
        if after == 0.0:
            self.mode = system.from_rest(self.mode, side, net)
            if self.mode.held:
                self._tell(f"rests_{side}")
            return
        self.mode = replace(self.mode, sliding=system.slides(away))
        if pressing > 0.0:  # so that the rebound is not stepped over
            self.longest_step = 0.5 * abs(after) / pressing
