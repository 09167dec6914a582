"""What feeds the winding from moment to moment: which voltage it sees, and whether something else sets its current.

===========  ==========================================================================================
conducting   the source's voltage, the diode's while the current goes on through it, or what a current
             amplifier of some bandwidth w gives: i' = w (command - i) as far as its voltage allows
blocked      i = 0: neither source nor diode drives a positive current
following    a current amplifier without a bandwidth: i is the command
at_max       it is behind the command, at its largest voltage
at_min       it is ahead of the command, at its smallest voltage
===========  ==========================================================================================
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.circuit import Circuit
from femfit.open_loop.equations import Equations, Point

CONDUCTING, BLOCKED, FOLLOWING, AT_MAX, AT_MIN = "conducting", "blocked", "following", "at_max", "at_min"

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
    """What the circuits and the body's net force are at one moment."""

    net_N: float
    voltage_V: FloatArray
    current_rate_A_s: FloatArray
    effect_rates: FloatArray
    diode_V: float = 0.0  # Of a diode that the current goes on through; the source then gives nothing


@dataclass(frozen=True, eq=False)
class Feed:
    """A winding's drive and its command."""

    equations: Equations
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
        drive, circuit = self.circuit.drive, self.circuit
        low, high = circuit.voltage_min_V, circuit.voltage_max_V
        if self.commands_current:
            low = -np.inf if drive.current_min_A is None else drive.current_min_A
            high = np.inf if drive.current_max_A is None else drive.current_max_A
        elif drive.diode_V is not None:
            low = 0.0
        return low, high

    def flow(self, mode: str, line: Line, time: float, state: FloatArray) -> Flow:
        """Currents and net force in a mode; ``state`` is (distance, velocity, currents, states of effects)."""
        point = self.equations.point(state)
        currents = state[2 : 2 + self.equations.circuits]
        if mode == BLOCKED:
            return self._of_rate(point, state, np.zeros_like(currents))
        if mode == FOLLOWING:
            return self._of_rate(point, state, np.full_like(currents, line.slope))
        if mode in {AT_MAX, AT_MIN}:
            volts = self.circuit.voltage_max_V if mode == AT_MAX else self.circuit.voltage_min_V
            return self._of_voltage(point, state, np.full_like(currents, volts))
        command = line.at(time)
        if self.commands_current:
            wanted = (self.bandwidth or 0.0) * (command - currents)
            needed = self._of_rate(point, state, wanted).voltage_V
            low, high = self.circuit.voltage_min_V, self.circuit.voltage_max_V
            return self._of_voltage(point, state, np.clip(needed, low, high))
        if self.diode_V is not None and command <= 0.0:
            return self._of_voltage(point, state, np.full_like(currents, -self.diode_V), self.diode_V)
        return self._of_voltage(point, state, np.full_like(currents, command))

    def _of_voltage(self, point: Point, state: FloatArray, voltage: FloatArray, diode: float = 0.0) -> Flow:
        if self.equations.effects is not None:
            return Flow(*_net_voltage_rates(self.equations, state, voltage, None), diode)
        currents = state[2 : 2 + self.equations.circuits]
        rate = self.equations.current_rate(point, currents, voltage)
        return Flow(point.net_N, voltage, rate, rate[:0], diode)

    def _of_rate(self, point: Point, state: FloatArray, rate: FloatArray) -> Flow:
        currents = state[2 : 2 + self.equations.circuits]
        voltage = self.equations.voltage(point, currents, rate)
        if self.equations.effects is None:
            return Flow(point.net_N, voltage, rate, rate[:0])
        # Effects change the voltage that the rate needs; one secant finds it, for the rate is linear in it
        ends = [self.equations.with_effects(state, voltage + step, None)[1] for step in (0.0, 1.0)]
        voltage = voltage + (rate - ends[0]) / (ends[1] - ends[0])
        return Flow(*_net_voltage_rates(self.equations, state, voltage, float(rate[0])))

    def settled(self, line: Line, time: float, state: FloatArray) -> str:
        """The mode that holds from now on, where the command may have jumped."""
        current = float(state[2])
        if self.commands_current:
            if self.bandwidth is not None:
                return CONDUCTING
            behind = line.at(time) - current
            if abs(behind) > _TINY * max(abs(line.at(time)), abs(current), 1e-3):
                return AT_MAX if behind > 0.0 else AT_MIN
            needed = float(self.flow(FOLLOWING, line, time, state).voltage_V[0])
            if needed > self.circuit.voltage_max_V:
                return AT_MAX
            return AT_MIN if needed < self.circuit.voltage_min_V else FOLLOWING
        if self.diode_V is None or current > 0.0:
            return CONDUCTING
        return CONDUCTING if self.conducts(line, time, state) > 0.0 else BLOCKED

    def conducts(self, line: Line, time: float, state: FloatArray) -> float:
        """Above zero where source or diode would drive a positive current, in V."""
        flow = self.flow(CONDUCTING, line, time, state)
        point = self.equations.point(state)
        scale = max(abs(self.circuit.voltage_max_V), abs(self.circuit.voltage_min_V))
        return float(flow.current_rate_A_s[0] * point.inductance_H[0, 0]) - _TINY * scale


def _net_voltage_rates(
    equations: Equations, state: FloatArray, voltage: FloatArray, rate: float | None
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    net, current_rate, effect_rates = equations.with_effects(state, voltage, rate)
    return net, voltage, current_rate, effect_rates
