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

import casadi as ca
import numpy as np
from casadi import SX
from scipy.optimize import brentq

from femfit.core.graph import GraphFunction, once
from femfit.core.numerics import FloatArray
from femfit.core.tape import Caller
from femfit.device.mechanics import Stop
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import state_scale
from femfit.simulation.profile import AT_MAX, AT_MIN, BLOCKED, CONDUCTING, FOLLOWING, Driver, Feed

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

AWAY: dict[Side, int] = {"near": 1, "far": -1}
"""Direction in which a body leaves a stop."""

ENERGIES = ("source", "copper", "eddy", "diode", "friction", "impact")

LEAST_REBOUND = 1e-7
"""Conventional: height of a rebound over the travel below which a body stays on its stop."""

MODE_NUMBERS = 6


def moment_function(model: ActuatorModel, driven: tuple[int, ...]) -> GraphFunction:
    """The derivative of state and energies, the net force, and the drivers' voltages.

    A function of the state, of what :meth:`System.given` says, and of a mode's numbers: whether the body is held, the
    dry friction in N, and of a stop that is pressed the direction away from it, its distance in m, its stiffness in N/m
    and its damping in N s/m.
    """
    motion, windings, n = model.require_motion(), model.windings, len(model.circuits)

    def made() -> GraphFunction:
        inputs = [SX.sym("x", model.order), SX.sym("given", n), SX.sym("drops", n), SX.sym("mode", MODE_NUMBERS)]
        state, feeds, drops, mode = inputs
        held, friction, away, end, stiffness, damper = ca.vertsplit(mode)
        rates, volts = model.equations.flow_at(state, feeds, driven)
        contact = away * ca.fmax(0.0, stiffness * (away * (end - state[0])) - damper * (away * state[1]))
        net = motion.mass_kg * rates[1] + contact
        velocity = ca.if_else(held, 0.0, state[1])
        acceleration = ca.if_else(held, 0.0, (net - friction) / motion.mass_kg)
        currents = state[2 : windings.end]
        lost = SX(windings.resistances_ohm) * currents**2
        energies = [
            ca.dot(currents[:n], ca.if_else(drops, 0.0, volts)),
            ca.sum1(lost[:n]),
            ca.sum1(lost[n:]),
            ca.dot(currents[:n], drops),
            (motion.viscous_N_s_per_m * velocity + friction) * velocity,
            -contact * velocity,
        ]
        return GraphFunction(inputs, ca.vertcat(velocity, acceleration, rates[2:], *energies, net, volts))

    return once(model, ("moment", driven), made)


@dataclass(frozen=True)
class Mode:
    """Which of the smooth equations hold."""

    feeds: tuple[Feed, ...]  # One a circuit
    sliding: int = 0  # Direction of the motion that dry friction brakes; 0 of a body held on a stop or by the friction
    support: Side | None = None  # The rigid stop that it rests on
    touching: Side | None = None  # The stop that gives way and is pressed

    def driven_as(self, k: int, driver_mode: str) -> "Mode":
        """The mode in which another one holds of circuit k."""
        feeds = list(self.feeds)
        feeds[k] = replace(feeds[k], mode=driver_mode)
        return replace(self, feeds=tuple(feeds))


class System:
    """An actuator in open loop."""

    def __init__(self, model: ActuatorModel, drivers: tuple[Driver, ...]) -> None:
        self.model, self.drivers, self.mechanics = model, drivers, model.require_motion()
        sides: dict[Side, Stop | None] = {"near": self.mechanics.near_stop, "far": self.mechanics.far_stop}
        self.stops = {side: stop for side, stop in sides.items() if stop is not None}
        d, i = model.validity.grid(15, 15, several=5)
        strongest = np.abs(model.magnetics.force(d, i)).max() + np.abs(self.mechanics.static_force(d)).max()
        largest_N = float(strongest) or 1.0
        # What is large for each state: the domain's ranges, and what the largest force does over them
        scales, limits = state_scale(model), model.validity.current_limits_A[: len(drivers)]
        work = largest_N * scales[0]
        scales[2 : 2 + len(drivers)] = np.abs(limits).max(axis=1)
        scales[1] = np.sqrt(work / self.mechanics.mass_kg)
        self.scales: FloatArray = np.append(scales, np.full(len(ENERGIES), work))
        self.least_rebound_m = float(LEAST_REBOUND * scales[0])
        # The least net force that moves a body at rest; above the dry friction by what rounding may make
        self.breakaway_N = self.mechanics.coulomb_N + 1e-9 * largest_N

    def given(self, mode: Mode, time: float, state: FloatArray) -> tuple[list[float], tuple[int, ...], list[float]]:
        """What the drivers give in a mode.

        Returns
        -------
        values : list of float
            Voltage of each circuit, or the rate of its current.
        driven : tuple of int
            The circuits of which it is the rate.
        drops : list of float
            Of the diodes that currents go on through, else 0; the source of such a one gives nothing.
        """
        feeds = [
            driver.given(feed, time, current)
            for driver, feed, current in zip(self.drivers, mode.feeds, state[2:].tolist(), strict=False)
        ]
        values = [value for value, _, _ in feeds]
        driven = tuple([k for k, (_, is_rate, _) in enumerate(feeds) if is_rate])
        limited = [k for k in driven if self.drivers[k].bandwidth]
        for _ in limited:  # an amplifier gives no more than its voltage, which the others then feel
            volts = self._solved(state, values, driven)
            ends = {k: self.drivers[k].circuit for k in limited if k in driven}
            within = {k: min(max(volts[k], end.voltage_min_V), end.voltage_max_V) for k, end in ends.items()}
            if not (over := {k: volt for k, volt in within.items() if volt != volts[k]}):
                break
            values = [over.get(k, value) for k, value in enumerate(values)]
            driven = tuple([k for k in driven if k not in over])
        return values, driven, [drop for _, _, drop in feeds]

    def voltages(self, mode: Mode, time: float, state: FloatArray) -> list[float]:
        """That the circuits' drivers give in a mode, in V."""
        values, driven, _ = self.given(mode, time, state)
        return self._solved(state, values, driven) if driven else values

    def _solved(self, state: FloatArray, values: list[float], driven: tuple[int, ...]) -> list[float]:
        """The drivers' voltages where those of the circuits are given, and the currents' rates of those driven."""
        point = moment_function(self.model, driven).point
        moment = point(state[: self.model.order], values, [0.0] * len(values), [0.0] * MODE_NUMBERS)
        return moment[len(moment) - len(values) :].tolist()

    def conducts(self, mode: Mode, k: int, time: float, state: FloatArray) -> float:
        """Above zero where source or diode of a blocked circuit would drive a positive current, in V."""
        source, _, _ = self.drivers[k].given(replace(mode.feeds[k], mode=CONDUCTING), time, float(state[2 + k]))
        return source - self.voltages(mode, time, state)[k] - self.drivers[k].slack_V

    def settled(self, mode: Mode, time: float, state: FloatArray) -> Mode:
        """The drivers' modes that hold from now on, where a command may have jumped."""
        for k, (driver, feed) in enumerate(zip(self.drivers, mode.feeds, strict=True)):
            mode = mode.driven_as(k, driver.alone(feed.command(time), float(state[2 + k])))
        for _ in self.drivers:  # what one circuit does may turn another's diode or amplifier
            before = mode
            for k, driver in enumerate(self.drivers):
                if mode.feeds[k].mode == BLOCKED and self.conducts(mode, k, time, state) > 0.0:
                    mode = mode.driven_as(k, CONDUCTING)
                elif mode.feeds[k].mode == FOLLOWING:
                    needed = self.voltages(mode, time, state)[k]
                    above, below = needed > driver.circuit.voltage_max_V, needed < driver.circuit.voltage_min_V
                    mode = mode.driven_as(k, AT_MAX if above else AT_MIN if below else FOLLOWING)
            if mode == before:
                break
        return mode

    def moment(self, mode: Mode) -> Callable[[float, FloatArray], FloatArray]:
        """In a mode the derivative of the state, and after it the net force without dry friction and rigid stops."""
        size, side = self.model.order, mode.touching
        numbers = [float(not mode.sliding), mode.sliding * self.mechanics.coulomb_N, *[0.0] * (MODE_NUMBERS - 2)]
        if side is not None:
            stop = self.stops[side]
            damper = damping(stop, self.mechanics.mass_kg)
            numbers[2:] = float(AWAY[side]), stop.distance_m, stop.stiffness_N_per_m or 0.0, damper

        def asked(time: float, state: FloatArray) -> tuple[Caller, list[float], list[float]]:
            values, driven, drops = self.given(mode, time, state)
            return moment_function(self.model, driven).point, values, drops

        # What stays as it is need not be asked for again
        changing = any(feed.slope or driver.bandwidth for feed, driver in zip(mode.feeds, self.drivers, strict=True))
        always = None if changing else asked(0.0, np.zeros(size))

        def at(time: float, state: FloatArray) -> FloatArray:
            function, values, drops = always or asked(time, state)
            return function(state[:size], values, drops, numbers)[: size + len(ENERGIES) + 1]

        return at

    def fastest_rate(self, mode: Mode, state: FloatArray) -> float:
        """Of windings, amplifiers and a stop that gives way, in rad/s."""
        windings = self.model.windings
        rate = max((driver.bandwidth for driver in self.drivers), default=0.0)
        if windings.count:
            magnetic = windings.magnetics.state(state[0], state[2 : windings.end])
            decay = np.linalg.solve(magnetic.inductance + windings.series_H, np.diag(windings.resistances_ohm))
            rate = max(rate, float(np.abs(decay).sum(axis=1).max()))
        if mode.touching is not None:
            stiffness = self.stops[mode.touching].stiffness_N_per_m or 0.0
            rate = max(rate, float(np.sqrt(stiffness / self.mechanics.mass_kg)))
        return rate
