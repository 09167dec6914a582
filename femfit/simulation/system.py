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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any, Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from femfit.core.errors import SimulationError
from femfit.core.numerics import FloatArray
from femfit.core.tape import Caller
from femfit.device.mechanics import Mechanics, Stop
from femfit.model.dynamics import state_scale
from femfit.simulation.feed import MODE_NUMBERS, Feed, Line, Modes, moment_function

LEAST_RESTITUTION = 0.01
"""Conventional: a stop that gives way and returns nothing would need infinite damping; it returns a ten thousandth of
the energy."""


@cache
def damping(stop: Stop, mass: float) -> float:
    """Damping in N s/m that gives a stop with a stiffness its restitution."""
    if stop.stiffness_N_per_m is None or stop.restitution >= 1.0:
        return 0.0
    wanted = math.log(max(stop.restitution, LEAST_RESTITUTION))

    def excess(x: float) -> float:  # x is a - pi/2 below zero, b above; falling throughout
        return (2.0 * x / (math.tan(-x) if x < 0.0 else -math.tanh(x)) if x else -2.0) - wanted

    x = brentq(excess, -0.5 * math.pi, 10.0)
    ratio = math.cos(x) if x < 0.0 else math.cosh(x)
    return 2.0 * ratio * math.sqrt(stop.stiffness_N_per_m * mass)


Side = Literal["near", "far"]

Lines = tuple[Line, ...]
"""The command of each circuit."""

Reading = Callable[[float, FloatArray], float]
"""A number at a time and a state."""

ENERGIES = ("source", "copper", "eddy", "diode", "friction", "impact")

RTOL = 1e-9
"""Derived: a thousand steps may each miss by so much before the energies are off by a millionth."""

STIFF = 3000.0
"""Conventional: fastest rate times duration from which an implicit method costs less than an explicit one's steps."""

INTERPOLATED = 3.0
"""Chosen: longest step times the fastest rate; over longer ones the table between the steps, which is interpolated, is
off by a ten-thousandth of the range although the steps are right."""

LEAST_REBOUND = 1e-7
"""Conventional: height of a rebound over the travel below which a body stays on its stop."""


@dataclass(frozen=True)
class Mode:
    """Which of the smooth equations hold."""

    feed: Modes  # One a circuit
    sliding: int = 0  # Direction of the motion that dry friction brakes; 0 where there is none
    held: bool = False  # At rest, on a stop or by dry friction
    support: Side | None = None  # The rigid stop that it rests on
    touching: Side | None = None  # The stop that gives way and is pressed


@dataclass(frozen=True, eq=False)
class System:
    """An actuator in open loop."""

    feed: Feed

    @cached_property
    def mechanics(self) -> Mechanics:
        """The body's."""
        return self.feed.model.require_motion()

    @cached_property
    def stops(self) -> dict[Side, Stop]:
        """Those that there are."""
        sides: dict[Side, Stop | None] = {"near": self.mechanics.near_stop, "far": self.mechanics.far_stop}
        return {side: stop for side, stop in sides.items() if stop is not None}

    @cached_property
    def size(self) -> int:
        """Number of states without the energies."""
        return self.feed.model.order

    @cached_property
    def travel_m(self) -> float:
        """Width of the validity domain's distances."""
        box = self.feed.model.validity
        return box.distance_max_m - box.distance_min_m

    @cached_property
    def least_rebound_m(self) -> float:
        """Height of a rebound that counts."""
        return LEAST_REBOUND * self.travel_m

    @cached_property
    def largest_force_N(self) -> float:  # noqa: N802  the unit
        """Of field and mechanics over the validity domain."""
        d, i = self.feed.model.validity.grid(15, 15, several=5)
        magnetic, static = self.feed.model.magnetics.force(d, i), self.mechanics.static_force(d)
        return float(np.abs(magnetic).max() + np.abs(static).max()) or 1.0

    @cached_property
    def scales(self) -> FloatArray:
        """What is large for each state: the domain's ranges, and what the largest force does over them."""
        model, circuits = self.feed.model, 2 + len(self.feed.windings)
        work = self.largest_force_N * self.travel_m
        result = np.ones(self.size + len(ENERGIES))
        result[0], result[1] = self.travel_m, np.sqrt(work / self.mechanics.mass_kg)
        result[2:circuits] = np.abs(model.validity.current_limits_A).max(axis=1)[: circuits - 2]
        result[circuits : model.windings.end] = state_scale(model)[circuits : model.windings.end]
        result[self.size :] = work
        return result

    @property
    def breakaway_N(self) -> float:  # noqa: N802  the unit
        """The least net force that moves a body at rest; above the dry friction by what rounding may make."""
        return self.mechanics.coulomb_N + 1e-9 * self.largest_force_N

    def depth(self, side: Side, state: FloatArray) -> float:
        """How far in m a body is beyond a stop."""
        beyond = float(state[0]) - self.stops[side].distance_m
        return -beyond if side == "near" else beyond

    def moment(self, mode: Mode, lines: Lines) -> Callable[[float, FloatArray], FloatArray]:
        """In a mode the derivative of the state, and after it the net force without dry friction and rigid stops."""
        feed, size, stop = self.feed, self.size, self.stops.get(mode.touching) if mode.touching else None
        numbers = [float(mode.held), mode.sliding * self.mechanics.coulomb_N, *[0.0] * (MODE_NUMBERS - 2)]
        if stop is not None:
            away, mass = (1.0 if mode.touching == "near" else -1.0), self.mechanics.mass_kg
            numbers[2:] = away, stop.distance_m, stop.stiffness_N_per_m or 0.0, damping(stop, mass)

        def asked(time: float, state: FloatArray) -> tuple[Caller, list[float], list[float]]:
            values, driven, drops = feed.given(mode.feed, lines, time, state[:size])
            return moment_function(feed.model, driven).point, values, drops

        # What stays as it is need not be asked for again
        steady = not any(line.slope or w.bandwidth for line, w in zip(lines, feed.windings, strict=True))
        always = asked(0.0, np.zeros(size)) if steady else None

        def at(time: float, state: FloatArray) -> FloatArray:
            function, values, drops = always or asked(time, state)
            return function(state[:size], values, drops, numbers)[: size + len(ENERGIES) + 1]

        return at


def integrated(
    system: System,
    mode: Mode,
    lines: Lines,
    state: FloatArray,
    span: tuple[float, float],
    events: Sequence[tuple[Reading, float]],
    longest_step: float,
) -> Any:
    """SciPy's solution up to the first event, which is a function whose zero counts in a direction, or the end.

    Raises
    ------
    SimulationError
        If the motion cannot be followed.
    """
    moment = system.moment(mode, lines)
    functions = []
    for of, direction in events:
        value: Any = partial(of)
        value.terminal, value.direction = True, direction
        functions.append(value)
    fastest = _fastest_rate(system, mode, state)
    stiff = fastest * (span[1] - span[0]) > STIFF
    with np.errstate(over="ignore", invalid="ignore"):
        solution = solve_ivp(
            lambda time, state: moment(time, state)[:-1],
            span,
            state,
            method="LSODA" if stiff else "DOP853",
            rtol=RTOL,
            atol=RTOL * system.scales,
            events=functions,
            dense_output=True,
            max_step=longest_step if stiff or not fastest else min(longest_step, INTERPOLATED / fastest),
        )
    if solution.status < 0 or not np.all(np.isfinite(solution.y[:, -1])):
        there = "".join(f" and {current:.4g} A" for current in solution.y[2 : 2 + len(lines), -1])
        raise SimulationError(
            f"The motion must be finite; it cannot be followed beyond {1e3 * solution.t[-1]:.6g} ms, at "
            f"{1e3 * solution.y[0, -1]:.4g} mm{there}. Keep it within the validity domain."
        )
    return solution


def _fastest_rate(system: System, mode: Mode, state: FloatArray) -> float:
    """Of windings, amplifiers and a stop that gives way, in rad/s."""
    windings = system.feed.model.windings
    rate = max((winding.bandwidth for winding in system.feed.windings), default=0.0)
    if windings.count:
        magnetic = windings.magnetics.state(state[0], state[2 : windings.end])
        decay = np.linalg.solve(magnetic.inductance + windings.series_H, np.diag(windings.resistances_ohm))
        rate = max(rate, float(np.abs(decay).sum(axis=1).max()))
    if mode.touching is not None:
        stiffness = system.stops[mode.touching].stiffness_N_per_m or 0.0
        rate = max(rate, float(np.sqrt(stiffness / system.mechanics.mass_kg)))
    return rate
