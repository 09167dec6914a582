"""Body, stops, friction and circuits between two events: smooth equations in one mode.

State: distance, velocity, currents of circuits and eddies, states of effects; after them the energies in J of
:data:`ENERGIES` that have gone so far, which the integrator sums up with the same care as the motion.

A stop that gives way: a spring with a damper that can push and not pull.

With w^2 = k/m and the damping ratio z = c/(2 m w), a body without other forces leaves again when the stop's force is
zero, and its speed is then e times that of its arrival:

    z = sin a < 1:   ln e = -(pi - 2 a) tan a,        z = cosh b >= 1:   ln e = -2 b / tanh b.

References
----------
T. Schwager and T. Poeschel, Granular Matter 9 (2007) 465: coefficient of restitution of the damped spring that does not
pull.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import circuit_currents
from femfit.device.mechanics import Mechanics, Stop
from femfit.model.validity import ValidityBox
from femfit.simulation.feed import AT_MAX, AT_MIN, BLOCKED, FOLLOWING, Feed, Line, Modes

LEAST_RESTITUTION = 0.01
"""Conventional: a stop that gives way and returns nothing would need infinite damping; it returns a ten thousandth of
the energy."""


@cache
def damping(stop: Stop, mass: float) -> float:
    """Damping in N s/m that gives a stop with a stiffness its restitution."""
    if stop.stiffness_N_per_m is None:
        return 0.0
    wanted = math.log(min(max(stop.restitution, LEAST_RESTITUTION), 1.0))
    low, high = -0.5 * math.pi, 10.0  # a - pi/2 below zero, b above
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _log_restitution(middle) > wanted else (low, middle)
    ratio = math.cos(low) if low < 0.0 else math.cosh(low)
    return 2.0 * ratio * math.sqrt(stop.stiffness_N_per_m * mass)


def _log_restitution(angle: float) -> float:
    """Of a - pi/2 < 0, or of b >= 0; falling throughout."""
    if abs(angle) < 1e-8:
        return -2.0
    return 2.0 * angle / math.tan(-angle) if angle < 0.0 else -2.0 * angle / math.tanh(angle)


def push(stop: Stop, damper: float, depth: float, speed: float) -> float:
    """Force in N away from the stop, at a depth in m and a speed in m/s into it."""
    return max(0.0, (stop.stiffness_N_per_m or 0.0) * depth + damper * speed)


Side = Literal["near", "far"]

SIDES: tuple[Side, ...] = ("near", "far")

Lines = tuple[Line, ...]
"""The command of each circuit."""

Reading = Callable[[float, FloatArray], float]
"""A number at a time and a state."""

ENERGIES = ("source", "copper", "eddy", "diode", "friction", "impact")

LEAST_REBOUND = 1e-7
"""Conventional: height of a rebound over the travel below which a body stays on its stop."""

SLACK = 1e-6
"""Conventional: part of the validity domain's width by which a point may lie outside of it, as one at its edge does."""


@dataclass(frozen=True)
class Mode:
    """Which of the smooth equations hold."""

    feed: Modes  # One a circuit
    sliding: int = 0  # Direction of the motion that dry friction brakes; 0 where there is none
    held: bool = False  # At rest, on a stop or by dry friction
    support: Side | None = None  # The rigid stop that it rests on
    touching: Side | None = None  # The stop that gives way and is pressed


@dataclass(frozen=True)
class Watch:
    """An event: its name, a function of time and state whose zero it is, and the direction that counts."""

    name: str
    value: Reading
    direction: float
    circuit: int | None = None  # Which circuit it happens to


@dataclass(frozen=True, eq=False)
class System:
    """An actuator in open loop."""

    feed: Feed
    mechanics: Mechanics
    domain: ValidityBox
    size: int  # Number of states without the energies
    force_scale_N: float
    eddies_A: FloatArray  # What is large for each pattern of the eddy currents

    @property
    def least_rebound_m(self) -> float:
        """Height of a rebound that counts."""
        return LEAST_REBOUND * (self.domain.distance_max_m - self.domain.distance_min_m)

    def stop(self, side: Side) -> Stop | None:
        """The stop at a side."""
        return self.mechanics.near_stop if side == "near" else self.mechanics.far_stop

    def contact(self, mode: Mode, state: FloatArray) -> float:
        """Force of a stop that gives way, along growing distance, in N."""
        stop = None if mode.touching is None else self.stop(mode.touching)
        if stop is None:
            return 0.0
        away = 1.0 if mode.touching == "near" else -1.0
        depth, speed = away * (stop.distance_m - float(state[0])), -away * float(state[1])
        return away * push(stop, damping(stop, self.mechanics.mass_kg), depth, speed)

    def net_force(self, mode: Mode, lines: Lines, time: float, state: FloatArray) -> float:
        """On the body along growing distance, without dry friction and rigid stops."""
        flow = self.feed.flow(mode.feed, lines, time, state[: self.size])
        return flow.net_N + self.contact(mode, state)

    def rates(self, mode: Mode, lines: Lines) -> Callable[[float, FloatArray], FloatArray]:
        """The derivative of the state in a mode."""
        size, mechanics, n = self.size, self.mechanics, len(self.feed.windings)
        resistances, friction = self.feed.model.windings.resistances_ohm.tolist(), mode.sliding * mechanics.coulomb_N

        def derivative(time: float, state: FloatArray) -> FloatArray:
            flow = self.feed.flow(mode.feed, lines, time, state[:size])
            contact = self.contact(mode, state)
            _, speed, *currents = state[: 2 + len(resistances)].tolist()
            velocity = 0.0 if mode.held else speed
            lost = [ohm * i**2 for ohm, i in zip(resistances, currents, strict=True)]
            by_source = [i * u for i, u, drop in zip(currents, flow.voltage_V, flow.diode_V, strict=False) if not drop]
            by_diode = sum(i * drop for i, drop in zip(currents, flow.diode_V, strict=False))
            rubbed, given = (mechanics.viscous_N_s_per_m * velocity + friction) * velocity, -contact * velocity
            result = np.empty(size + len(ENERGIES))
            result[:size] = flow.rates
            result[0] = velocity
            result[1] = 0.0 if mode.held else (flow.net_N + contact - friction) / mechanics.mass_kg
            result[size:] = sum(by_source), sum(lost[:n]), sum(lost[n:]), by_diode, rubbed, given
            return result

        return derivative

    def watches(self, mode: Mode, lines: Lines, ignored: tuple[str, ...]) -> list[Watch]:
        """The events that end a mode, or the simulation."""
        watches = [*self._of_motion(mode, lines), *self._of_domain()]
        for k in range(len(mode.feed)):
            watches += self._of_feed(mode, lines, k)
        return [watch for watch in watches if watch.name not in ignored]

    def _of_motion(self, mode: Mode, lines: Lines) -> list[Watch]:
        if mode.held:
            least = self.breakaway()

            def upwards(time: float, state: FloatArray) -> float:
                return self.net_force(mode, lines, time, state) - least

            def downwards(time: float, state: FloatArray) -> float:
                return -self.net_force(mode, lines, time, state) - least

            watches = [] if mode.support == "far" else [Watch("up", upwards, 1.0)]
            return watches if mode.support == "near" else [*watches, Watch("down", downwards, 1.0)]
        watches = []
        for side in SIDES:
            sign = -1.0 if side == "near" else 1.0
            stop = self.stop(side)
            if stop is None:
                continue

            def depth(_: float, state: FloatArray, stop: Stop = stop, sign: float = sign) -> float:
                return sign * (float(state[0]) - stop.distance_m)

            if stop.stiffness_N_per_m is None:
                watches.append(Watch(f"hits_{side}", depth, 1.0))
            elif mode.touching == side:  # a body that rises by less is not said to leave

                def risen(time: float, state: FloatArray, at: Reading = depth) -> float:
                    return at(time, state) + self.least_rebound_m

                watches.append(Watch(f"leaves_{side}", risen, -1.0))
            else:
                watches.append(Watch(f"touches_{side}", depth, 1.0))
        if mode.sliding:
            watches.append(Watch("still", lambda _, state: float(state[1]), -float(mode.sliding)))
        return watches

    def _of_feed(self, mode: Mode, lines: Lines, k: int) -> list[Watch]:
        """The events of one circuit."""
        feed, size, index, line = self.feed, self.size, 2 + k, lines[k]
        winding, circuit, state_of_drive = feed.windings[k], feed.windings[k].circuit, mode.feed[k]
        if state_of_drive == BLOCKED:
            return [
                Watch("conducts", lambda time, state: feed.conducts(mode.feed, k, lines, time, state[:size]), 1.0, k)
            ]
        if state_of_drive == FOLLOWING:

            def volts(time: float, state: FloatArray) -> float:
                return feed.flow(mode.feed, lines, time, state[:size]).voltage_V[k]

            slack = 1e-9 * winding.voltage_scale_V
            return [
                Watch("lags", lambda time, state: volts(time, state) - circuit.voltage_max_V - slack, 1.0, k),
                Watch("leads", lambda time, state: circuit.voltage_min_V - slack - volts(time, state), 1.0, k),
            ]
        if state_of_drive in {AT_MAX, AT_MIN}:
            sign = 1.0 if state_of_drive == AT_MAX else -1.0
            return [Watch("reaches", lambda time, state: sign * (line.at(time) - float(state[index])), -1.0, k)]
        return [] if winding.diode_V is None else [Watch("blocks", lambda _, state: float(state[index]), -1.0, k)]

    def _of_domain(self) -> list[Watch]:
        box = self.domain
        names = [column.rpartition("_")[0] for column in circuit_currents([w.circuit.name for w in self.feed.windings])]
        ranges = {"distance": (0, box.distance_min_m, box.distance_max_m)}
        limits = box.current_limits_A.tolist()
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

            watches.append(Watch(name, inside, -1.0))
        return watches

    def breakaway(self) -> float:
        """The least net force in N that moves a body at rest; above the dry friction by what rounding may make."""
        return self.mechanics.coulomb_N + 1e-9 * self.force_scale_N

    def from_rest(self, mode: Mode, support: Side | None, net: float) -> Mode:
        """Whether a body at rest stays so or moves, and where to."""
        up = net > self.breakaway() and support != "far"
        down = net < -self.breakaway() and support != "near"
        if not (up or down):
            return replace(mode, held=True, support=support, sliding=0)
        return replace(mode, held=False, support=None, sliding=self.slides(1 if up else -1))

    def slides(self, direction: int) -> int:
        """The direction that dry friction brakes; 0 where there is none."""
        return direction if self.mechanics.coulomb_N else 0
