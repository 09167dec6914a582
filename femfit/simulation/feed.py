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
voltages follow from :meth:`femfit.model.equations.Equations.flow`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

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
class Flow:
    """What circuits, eddy currents and the body's net force are at one moment."""

    net_N: float  # On the body along growing distance, without stops and dry friction
    voltage_V: list[float]  # That the circuits' drivers give
    rates: FloatArray  # Of the state, without stops and dry friction
    diode_V: list[float]  # Of the diodes that currents go on through, else 0; the source of such a one gives nothing


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

    def within(self, voltage: float) -> float:
        """The voltage, as far as the driver gives it."""
        return min(max(voltage, self.circuit.voltage_min_V), self.circuit.voltage_max_V)

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

    def flow(self, modes: Modes, lines: Sequence[Line], time: float, state: FloatArray) -> Flow:
        """Currents and net force in a mode; ``state`` is (distance, velocity, currents, states of effects)."""
        given = [
            winding.given(mode, line, time, current)
            for winding, mode, line, current in zip(self.windings, modes, lines, state[2:].tolist(), strict=False)
        ]
        values, driven = [value for value, _, _ in given], [k for k, (_, is_rate, _) in enumerate(given) if is_rate]
        drops = [drop for _, _, drop in given]
        flow = self._solved(state, values, driven, drops)
        limited = [k for k in driven if self.windings[k].bandwidth]
        for _ in limited:  # an amplifier gives no more than its voltage, which the others then feel
            volts = {k: self.windings[k].within(flow.voltage_V[k]) for k in limited if k in driven}
            if not (over := {k: volt for k, volt in volts.items() if volt != flow.voltage_V[k]}):
                break
            values = [over.get(k, value) for k, value in enumerate(values)]
            driven = [k for k in driven if k not in over]
            flow = self._solved(state, values, driven, drops)
        return flow

    def _solved(self, state: FloatArray, values: list[float], driven: list[int], drops: list[float]) -> Flow:
        """The flow where the circuits' voltages are given, and the currents' rates of those that are driven."""
        found = self.model.equations.flow(tuple(driven)).point(state, values, (0.0, 0.0, 1.0))
        rates, volts = found[: self.model.order], found[self.model.order :].tolist()
        return Flow(float(self.model.require_motion().mass_kg * rates[1]), volts, rates, drops)

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
                    needed = self.flow(tuple(settled), lines, time, state).voltage_V[k]
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
        needed = self.flow(modes, lines, time, state).voltage_V[k]
        return source - needed - _TINY * winding.voltage_scale_V
