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
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from femfit.core.errors import SimulationError
from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Mechanics, Stop
from femfit.model.dynamics import state_scale
from femfit.simulation.feed import Feed, Line, Modes

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

    def contact(self, mode: Mode, state: FloatArray) -> float:
        """Force of a stop that gives way, along growing distance, in N."""
        if mode.touching is None:
            return 0.0
        away, stop = (1.0 if mode.touching == "near" else -1.0), self.stops[mode.touching]
        pushed = (stop.stiffness_N_per_m or 0.0) * self.depth(mode.touching, state)
        return away * max(0.0, pushed + damping(stop, self.mechanics.mass_kg) * (-away * float(state[1])))

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
    functions = []
    for of, direction in events:

        def value(time: float, state: FloatArray, of: Reading = of) -> float:
            return of(time, state)

        value.terminal, value.direction = True, direction  # type: ignore[attr-defined]
        functions.append(value)
    fastest = _fastest_rate(system, mode, state)
    stiff = fastest * (span[1] - span[0]) > STIFF
    with np.errstate(over="ignore", invalid="ignore"):
        solution = solve_ivp(
            system.rates(mode, lines),
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
