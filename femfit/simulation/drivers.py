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

from dataclasses import dataclass
from math import pi

from femfit.device.electrics import Circuit
from femfit.model.drive import command_limits
from femfit.simulation.profile import Profile

CONDUCTING, BLOCKED, FOLLOWING, AT_MAX, AT_MIN = "conducting", "blocked", "following", "at_max", "at_min"

_TINY = 1e-9
"""Derived: part of a rate, voltage or current's scale that the integration's own error may make."""


@dataclass(frozen=True)
class Feed:
    """What one circuit gets between two turns of its command, a straight line, in one mode of its driver."""

    mode: str
    start_s: float
    value: float  # Of the command at the start, in V or A
    slope: float

    def command(self, time: float) -> float:
        """In V or A."""
        return self.value + self.slope * (time - self.start_s)


@dataclass(frozen=True, eq=False)
class Driver:
    """One circuit with what drives it."""

    circuit: Circuit
    commanded: Profile  # Cut where the driver gives no more
    limits: tuple[float, float]  # Least and largest command that the driver gives, in V or A
    commands_current: bool
    diode_V: float | None  # Of a freewheel diode; None where there is none
    bandwidth: float  # In rad/s of a current amplifier; 0 where there is none, or none that matters
    slack_V: float  # That the integration's own error may make

    @classmethod
    def of(cls, circuit: Circuit, commanded: Profile) -> "Driver":
        """The driver of a circuit, and what it is commanded."""
        amplifies, drive = commanded.kind == "current", circuit.drive
        limits = command_limits(circuit, current=amplifies)
        diode_V, bandwidth = (None, drive.bandwidth_Hz or 0.0) if amplifies else (drive.diode_V, 0.0)
        slack_V = _TINY * max(abs(circuit.voltage_max_V), abs(circuit.voltage_min_V))
        return cls(circuit, commanded.within(*limits), limits, amplifies, diode_V, 2.0 * pi * bandwidth, slack_V)

    def given(self, feed: Feed, time: float, current: float) -> tuple[float, bool, float]:
        """Its voltage or its current's rate, whether it is the rate, and the drop of its diode where that conducts."""
        if feed.mode in {BLOCKED, FOLLOWING}:
            return (feed.slope if feed.mode == FOLLOWING else 0.0), True, 0.0
        if feed.mode in {AT_MAX, AT_MIN}:
            return (self.circuit.voltage_max_V if feed.mode == AT_MAX else self.circuit.voltage_min_V), False, 0.0
        command = feed.command(time)
        if self.commands_current:
            return self.bandwidth * (command - current), True, 0.0
        if self.diode_V is not None and command <= 0.0:
            return -self.diode_V, False, self.diode_V
        return command, False, 0.0

    def alone(self, command: float, current: float) -> str:
        """The mode by the circuit's own command and current."""
        if self.commands_current and not self.bandwidth:
            if abs(command - current) > _TINY * max(abs(command), abs(current), 1e-3):
                return AT_MAX if command > current else AT_MIN
            return FOLLOWING
        return CONDUCTING if self.diode_V is None or current > 0.0 else BLOCKED
