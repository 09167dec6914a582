"""What feeds the circuits from moment to moment: which voltage each sees, and whether something else sets its current.

===========  ==========================================================================================
conducting   the source's voltage, the diode's while the current goes on through it, or what a current
             amplifier of some bandwidth w gives: i' = w (command - i) as far as its voltage allows
blocked      i = 0: neither source nor diode drives a positive current
following    a current amplifier without a bandwidth: i is the command
at_max       it is behind the command, at its largest voltage
at_min       it is ahead of the command, at its smallest voltage
===========  ==========================================================================================

Each circuit has a mode of its own: of some the voltages are given, of the others the rates of their currents, and their
voltages follow from :meth:`femfit.model.equations.Equations.flow_at`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import casadi as ca
from casadi import SX

from femfit.core.graph import GraphFunction, once
from femfit.core.numerics import FloatArray
from femfit.device.electrics import Circuit
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import command_limits

CONDUCTING, BLOCKED, FOLLOWING, AT_MAX, AT_MIN = "conducting", "blocked", "following", "at_max", "at_min"

Modes = tuple[str, ...]

_TINY = 1e-9
"""Derived: part of a rate, voltage or current's scale that the integration's own error may make."""


@dataclass(frozen=True)
class Line:
    """The command between two of its turns: a straight line."""

    start_s: float
    value: float
    slope: float

    def at(self, time: float) -> float:
        """In V or A."""
        return self.value + self.slope * (time - self.start_s)


@dataclass(frozen=True)
class Winding:
    """One circuit with its drive."""

    circuit: Circuit
    commands_current: bool  # Whether the profile is one of current

    @property
    def diode_V(self) -> float | None:  # noqa: N802  the unit
        """Of a freewheel diode; None where there is none."""
        return None if self.commands_current else self.circuit.drive.diode_V

    @property
    def bandwidth(self) -> float:
        """In rad/s of a current amplifier; 0 where there is none, or none that matters."""
        return 2.0 * pi * (self.circuit.drive.bandwidth_Hz or 0.0) if self.commands_current else 0.0

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest command that the driver gives, in V or A."""
        return command_limits(self.circuit, current=self.commands_current)

    @property
    def voltage_scale_V(self) -> float:  # noqa: N802  the unit
        """Larger of its two ends."""
        return max(abs(self.circuit.voltage_max_V), abs(self.circuit.voltage_min_V))

    def given(self, mode: str, line: Line, time: float, current: float) -> tuple[float, bool, float]:
        """Its voltage or its current's rate, whether it is the rate, and the drop of its diode where that conducts."""
        if mode == BLOCKED:
            return 0.0, True, 0.0
        if mode == FOLLOWING:
            return line.slope, True, 0.0
        if mode in {AT_MAX, AT_MIN}:
            return (self.circuit.voltage_max_V if mode == AT_MAX else self.circuit.voltage_min_V), False, 0.0
        command = line.at(time)
        if self.commands_current:
            return self.bandwidth * (command - current), True, 0.0
        if self.diode_V is not None and command <= 0.0:
            return -self.diode_V, False, self.diode_V
        return command, False, 0.0


@dataclass(frozen=True, eq=False)
class Feed:
    """All circuits of an actuator and what drives them."""

    model: ActuatorModel
    windings: tuple[Winding, ...]

    def given(
        self, modes: Modes, lines: Sequence[Line], time: float, state: FloatArray
    ) -> tuple[list[float], tuple[int, ...], list[float]]:
        """What the drivers give in a mode; ``state`` is (distance, velocity, currents, states of effects).

        Returns
        -------
        values : list of float
            Voltage of each circuit, or the rate of its current.
        driven : tuple of int
            The circuits of which it is the rate.
        drops : list of float
            Of the diodes that currents go on through, else 0; the source of such a one gives nothing.
        """
        given = [
            winding.given(mode, line, time, current)
            for winding, mode, line, current in zip(self.windings, modes, lines, state[2:].tolist(), strict=False)
        ]
        values = [value for value, _, _ in given]
        driven = tuple([k for k, (_, is_rate, _) in enumerate(given) if is_rate])
        limited = [k for k in driven if self.windings[k].bandwidth]
        for _ in limited:  # an amplifier gives no more than its voltage, which the others then feel
            volts = self._solved(state, values, driven)
            ends = {k: self.windings[k].circuit for k in limited if k in driven}
            within = {k: min(max(volts[k], end.voltage_min_V), end.voltage_max_V) for k, end in ends.items()}
            if not (over := {k: volt for k, volt in within.items() if volt != volts[k]}):
                break
            values = [over.get(k, value) for k, value in enumerate(values)]
            driven = tuple([k for k in driven if k not in over])
        return values, driven, [drop for _, _, drop in given]

    def voltages(self, modes: Modes, lines: Sequence[Line], time: float, state: FloatArray) -> list[float]:
        """That the circuits' drivers give in a mode, in V."""
        values, driven, _ = self.given(modes, lines, time, state)
        return self._solved(state, values, driven)

    def _solved(self, state: FloatArray, values: list[float], driven: tuple[int, ...]) -> list[float]:
        """The drivers' voltages where those of the circuits are given, and the currents' rates of those driven."""
        found = moment_function(self.model, driven).point(state, values, [0.0] * len(values), [0.0] * MODE_NUMBERS)
        return found[len(found) - len(values) :].tolist()

    def settled(self, modes: Modes, lines: Sequence[Line], time: float, state: FloatArray) -> Modes:
        """The modes that hold from now on, where a command may have jumped."""
        settled = [
            self._alone(winding, line, time, float(state[2 + k]))
            for k, (winding, line) in enumerate(zip(self.windings, lines, strict=True))
        ]
        for _ in modes:  # what one circuit does may turn another's diode or amplifier
            before = tuple(settled)
            for k, winding in enumerate(self.windings):
                if settled[k] == BLOCKED and self.conducts(tuple(settled), k, lines, time, state) > 0.0:
                    settled[k] = CONDUCTING
                elif settled[k] == FOLLOWING:
                    needed = self.voltages(tuple(settled), lines, time, state)[k]
                    above, below = needed > winding.circuit.voltage_max_V, needed < winding.circuit.voltage_min_V
                    settled[k] = AT_MAX if above else AT_MIN if below else FOLLOWING
            if tuple(settled) == before:
                break
        return tuple(settled)

    @staticmethod
    def _alone(winding: Winding, line: Line, time: float, current: float) -> str:
        """The mode by the circuit's own command and current."""
        if winding.commands_current:
            if winding.bandwidth:
                return CONDUCTING
            behind = line.at(time) - current
            if abs(behind) > _TINY * max(abs(line.at(time)), abs(current), 1e-3):
                return AT_MAX if behind > 0.0 else AT_MIN
            return FOLLOWING
        return CONDUCTING if winding.diode_V is None or current > 0.0 else BLOCKED

    def conducts(self, modes: Modes, k: int, lines: Sequence[Line], time: float, state: FloatArray) -> float:
        """Above zero where source or diode of a blocked circuit would drive a positive current, in V."""
        winding = self.windings[k]
        source, _, _ = winding.given(CONDUCTING, lines[k], time, float(state[2 + k]))
        needed = self.voltages(modes, lines, time, state)[k]
        return source - needed - _TINY * winding.voltage_scale_V


MODE_NUMBERS = 6


def moment_function(model: ActuatorModel, driven: tuple[int, ...]) -> GraphFunction:
    """The derivative of state and energies, the net force, and the drivers' voltages.

    A function of the state, of what :meth:`Feed.given` says, and of a mode's numbers: whether the body is held, the dry
    friction in N, and of a stop that is pressed the direction away from it, its distance in m, its stiffness in N/m and
    its damping in N s/m.
    """
    motion, windings, n = model.require_motion(), model.windings, len(model.circuits)

    def made() -> GraphFunction:
        inputs = [SX.sym("x", model.order), SX.sym("given", n), SX.sym("drops", n), SX.sym("mode", MODE_NUMBERS)]
        state, given, drops, mode = inputs
        held, friction, away, end, stiffness, damper = ca.vertsplit(mode)
        rates, volts = model.equations.flow_at(state, given, driven)
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
