"""What feeds the circuits from moment to moment: which voltage each sees, and whether something else sets its current.

===========  ==========================================================================================
conducting   the source's voltage, the diode's while the current goes on through it, or what a current
             amplifier of some bandwidth w gives: i' = w (command - i) as far as its voltage allows
blocked      i = 0: neither source nor diode drives a positive current
following    a current amplifier without a bandwidth: i is the command
at_max       it is behind the command, at its largest voltage
at_min       it is ahead of the command, at its smallest voltage
===========  ==========================================================================================

Each circuit has a mode of its own. With the voltages of some (V) and the rates of the others (I) given,
L_VV i'_V = U_V - R i_V + k_m v - L_VI i'_I, and the voltages of the others follow. Eddy currents stand behind the
circuits with a voltage of 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.device.electrics import Circuit
from femfit.model.drive import command_limits
from femfit.simulation.energy import Equations, Point

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

    net_N: float
    voltage_V: FloatArray
    current_rate_A_s: FloatArray
    effect_rates: FloatArray
    diode_V: (
        FloatArray  # Of the diodes that currents go on through, 0 elsewhere; the source of such a one gives nothing
    )


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
    def bandwidth(self) -> float | None:
        """In rad/s of a current amplifier."""
        hertz = self.circuit.drive.bandwidth_Hz
        return None if hertz is None or not self.commands_current else 2.0 * pi * hertz

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
            return (self.bandwidth or 0.0) * (command - current), True, 0.0
        if self.diode_V is not None and command <= 0.0:
            return -self.diode_V, False, self.diode_V
        return command, False, 0.0


@dataclass(frozen=True, eq=False)
class Feed:
    """All circuits of an actuator and what drives them."""

    equations: Equations
    windings: tuple[Winding, ...]

    @property
    def bandwidth(self) -> float:
        """The largest of the current amplifiers' in rad/s; 0 where there is none."""
        return max((winding.bandwidth or 0.0 for winding in self.windings), default=0.0)

    def flow(self, modes: Modes, lines: Sequence[Line], time: float, state: FloatArray) -> Flow:
        """Currents and net force in a mode; ``state`` is (distance, velocity, currents, states of effects)."""
        point = self.equations.point(state)
        currents = state[2 : 2 + self.equations.windings]
        values, rated, drops = np.zeros(len(currents)), np.zeros(len(currents), dtype=np.bool_), self._no_diode
        for k, (winding, mode, line) in enumerate(zip(self.windings, modes, lines, strict=True)):  # no eddy currents
            values[k], rated[k], drop = winding.given(mode, line, time, float(currents[k]))
            if drop:
                drops = drops.copy()
                drops[k] = drop
        flow = self._solved(point, state, values, rated, drops)
        limited = [
            k for k, winding in enumerate(self.windings) if rated[k] and winding.commands_current and winding.bandwidth
        ]
        for _ in limited:  # an amplifier gives no more than its voltage, which the others then feel
            low, high = self._ends
            over = [k for k in limited if rated[k] and not low[k] <= flow.voltage_V[k] <= high[k]]
            if not over:
                break
            values[over], rated[over] = np.clip(flow.voltage_V, low, high)[over], False
            flow = self._solved(point, state, values, rated, drops)
        return flow

    @cached_property
    def _no_diode(self) -> FloatArray:
        return np.zeros(self.equations.windings)

    @cached_property
    def _ends(self) -> FloatArray:
        """Least and largest voltages, shape (2, n)."""
        return np.array([(winding.circuit.voltage_min_V, winding.circuit.voltage_max_V) for winding in self.windings]).T

    def _solved(self, point: Point, state: FloatArray, values: FloatArray, rated: BoolArray, drops: FloatArray) -> Flow:
        """The flow where each circuit's voltage is given, or its current's rate where ``rated``."""
        equations, currents = self.equations, state[2 : 2 + self.equations.windings]
        if not rated.any():
            if equations.effects is not None:
                return Flow(*_net_voltage_rates(equations, state, values, None), drops)
            rate = equations.current_rate(point, currents, values)
            return Flow(point.net_N, values, rate, rate[:0], drops)
        if rated.all():
            rate = values
        else:
            rate = np.where(rated, values, 0.0)
            free, driven = np.flatnonzero(~rated), np.flatnonzero(rated)
            driving = values - equations.resistance_ohm * currents + point.motional_V
            driving = driving[free] - point.inductance_H[np.ix_(free, driven)] @ rate[driven]
            rate[free] = np.linalg.solve(point.inductance_H[np.ix_(free, free)], driving)
        voltage = np.where(rated, equations.voltage(point, currents, rate), values)
        if equations.effects is None:
            return Flow(point.net_N, voltage, rate, rate[:0], drops)
        # Effects change the voltage that the rate needs; one secant finds it, for the rate is linear in it
        ends = [equations.with_effects(state, voltage + step, None)[1] for step in (0.0, 1.0)]
        voltage[0] += (rate[0] - ends[0][0]) / (ends[1][0] - ends[0][0])
        return Flow(*_net_voltage_rates(equations, state, voltage, float(rate[0])), drops)

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
                    needed = float(self.flow(tuple(settled), lines, time, state).voltage_V[k])
                    above, below = needed > winding.circuit.voltage_max_V, needed < winding.circuit.voltage_min_V
                    settled[k] = AT_MAX if above else AT_MIN if below else FOLLOWING
            if tuple(settled) == before:
                break
        return tuple(settled)

    @staticmethod
    def _alone(winding: Winding, line: Line, time: float, current: float) -> str:
        """The mode by the circuit's own command and current."""
        if winding.commands_current:
            if winding.bandwidth is not None:
                return CONDUCTING
            behind = line.at(time) - current
            if abs(behind) > _TINY * max(abs(line.at(time)), abs(current), 1e-3):
                return AT_MAX if behind > 0.0 else AT_MIN
            return FOLLOWING
        return CONDUCTING if winding.diode_V is None or current > 0.0 else BLOCKED

    def conducts(self, modes: Modes, k: int, lines: Sequence[Line], time: float, state: FloatArray) -> float:
        """Above zero where source or diode of a blocked circuit would drive a positive current, in V."""
        flow = self.flow((*modes[:k], CONDUCTING, *modes[k + 1 :]), lines, time, state)
        inductance = self.equations.point(state).inductance_H[k, k]
        return float(flow.current_rate_A_s[k] * inductance) - _TINY * self.windings[k].voltage_scale_V


def _net_voltage_rates(
    equations: Equations, state: FloatArray, voltage: FloatArray, rate: float | None
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    net, current_rate, effect_rates = equations.with_effects(state, voltage, rate)
    return net, voltage, current_rate, effect_rates
