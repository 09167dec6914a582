"""What is commanded over time: a voltage or a current, held from point to point or interpolated.

What is commanded: one profile for each circuit of a model, from whatever was given.

What its driver makes of it, in one of these modes: which voltage the circuit sees, or what sets its current.

===========  ==========================================================================================
conducting   the source's voltage, the diode's while the current goes on through it, or what a current
             amplifier of some bandwidth w gives: i' = w (command - i) as far as its voltage allows
blocked      i = 0: neither source nor diode drives a positive current
following    a current amplifier without a bandwidth: i is the command
at_max       it is behind the command, at its largest voltage
at_min       it is ahead of the command, at its smallest voltage
===========  ==========================================================================================

Of some circuits the voltages are given, of the others the rates of their currents, and their voltages follow from
:meth:`femfit.model.equations.Equations.flow_at`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from femfit.core.errors import DomainError, TableError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.public import require_known
from femfit.core.results import Printed
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.device.electrics import Circuit
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import command_limits
from femfit.simulation.words import sentence
from femfit.tables.columns import column_values, match_column
from femfit.tables.reading import read_raw_table

Interpolation = Literal["held", "linear"]

Kind = Literal["voltage", "current"]


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Printed):
    """A command over time.

    Parameters
    ----------
    kind : str
        What is commanded: ``voltage`` in V or ``current`` in A.
    time_s, value : array, shape (n,)
        Points with ascending times; before the first and after the last their values hold.
    interpolation : str
        ``held``: each value holds until the next point. ``linear``: straight lines between the points.

    Examples
    --------
    >>> import femfit as ff
    >>> pulse = ff.Profile("voltage", [0.0, 0.02], [12.0, 0.0])
    >>> pulse.at(0.01), pulse.at(0.03)
    (12.0, 0.0)
    """

    kind: Kind
    time_s: FloatArray
    value: FloatArray
    interpolation: Interpolation = "held"

    def __post_init__(self) -> None:
        """Refuse what is no function of time."""
        time, value = (np.asarray(column, dtype=np.float64) for column in (self.time_s, self.value))
        if self.kind not in {"voltage", "current"} or self.interpolation not in {"held", "linear"}:
            raise TableError(
                "A profile must be of kind voltage or current, and held or linear; instead received "
                f"{self.kind!r} and {self.interpolation!r}."
            )
        if time.ndim != 1 or time.shape != value.shape or not len(time):
            raise TableError(
                f"A profile needs as many values as times, at least one; instead received {time.shape} times and "
                f"{value.shape} values."
            )
        if not (np.all(np.isfinite(time)) and np.all(np.isfinite(value)) and np.all(np.diff(time) > 0.0)):
            raise TableError(
                "A profile's times must ascend, and its times and values must be finite. Sort and complete it."
            )
        object.__setattr__(self, "time_s", time)
        object.__setattr__(self, "value", value)

    def __str__(self) -> str:
        return sentence("open_loop", "profile", self)

    @cached_property
    def slopes(self) -> FloatArray:
        """Of the straight lines that begin at the points, shape (n,)."""
        slopes = np.zeros(len(self.value))
        if self.interpolation == "linear":
            slopes[:-1] = np.diff(self.value) / np.diff(self.time_s)
        return slopes

    @property
    def turns_s(self) -> FloatArray:
        """Times at which the command jumps, or changes its slope: between them it is one straight line."""
        held = self.interpolation == "held"
        change = np.abs(np.diff(self.value, prepend=self.value[0]) if held else np.diff(self.slopes, prepend=0.0))
        return np.asarray(self.time_s[change > 1e-12 * change.max()])

    def within(self, low: float, high: float) -> "Profile":
        """The profile as a driver with these limits gives it, turning where it meets them."""
        time, value = self.time_s, self.value
        if self.interpolation == "linear":
            for limit in (low, high):
                over = (value[:-1] - limit) * (value[1:] - limit) < 0.0
                met = time[:-1][over] + np.diff(time)[over] * ((limit - value[:-1]) / np.diff(value))[over]
                value = np.insert(value, np.flatnonzero(over) + 1, limit)
                time = np.insert(time, np.flatnonzero(over) + 1, met)
        return Profile(self.kind, time, np.clip(value, low, high), self.interpolation)

    def line(self, time: float) -> tuple[float, float]:
        """The straight line that begins at a time: (value there, slope)."""
        k = int(np.searchsorted(self.time_s, time, side="right")) - 1
        if k < 0:
            return float(self.value[0]), 0.0
        slope = float(self.slopes[k])
        return float(self.value[k]) + slope * (time - float(self.time_s[k])), slope

    def at(self, time: float) -> float:
        """The command at a time in s; at a jump, the value after it."""
        return self.line(time)[0]


def read_profiles(
    path: str | Path, circuits: Sequence[str] = ("coil",), interpolation: Interpolation = "held"
) -> dict[str, Profile]:
    """Read a profile for each circuit: ``time_s``, and ``voltage_V`` or ``current_A``.

    Parameters
    ----------
    path : str or Path
        A table in any form that measured tables may have. Of several circuits its columns are ``voltage_NAME_V`` or
        ``current_NAME_A``; a circuit without a column is not in the result.
    interpolation : str
        ``held`` or ``linear``.

    Raises
    ------
    TableError
        If there is no such table, or it has not these columns.
    """
    path = Path(path)
    raw = read_raw_table(path)
    pairs = dict(zip(circuits, zip(voltage_columns(circuits), circuit_currents(circuits), strict=True), strict=True))
    columns = ("time_s", *(column for pair in pairs.values() for column in pair))
    matched = [match for header in raw.headers if (match := match_column(header, columns)) is not None]
    used = {match.name: match for match in reversed(matched)}  # the first of several for the same
    commands = {name: [column for column in pair if column in used] for name, pair in pairs.items()}
    if "time_s" not in used or not any(commands.values()) or any(len(both) > 1 for both in commands.values()):
        each = " or ".join(f"one of {voltage} and {current}" for voltage, current in pairs.values())
        raise TableError(
            f"{path} must have a column time_s and {each}; its columns are {', '.join(raw.headers)}. Name them so, and "
            "leave one of two for the same circuit out."
        )
    values, _ = column_values(raw, list(used.values()))
    profiles: dict[str, Profile] = {}
    try:
        for name, both in commands.items():
            for column in both:
                kind: Kind = "current" if column == pairs[name][1] else "voltage"
                profiles[name] = Profile(kind, values["time_s"].to_numpy(), values[column].to_numpy(), interpolation)
    except TableError as error:
        raise TableError(f"{path}: {error}") from error
    return profiles


Constant: TypeAlias = float | Mapping[str, float] | None
"""One number, or one by the name of a circuit."""

Command: TypeAlias = Profile | Mapping[str, Profile] | str | Path | None
"""A profile, or one by the name of a circuit, or a table."""


def commanded(
    model: ActuatorModel, drive: Command, voltage: Constant, current: Constant, interpolation: Interpolation
) -> tuple[Profile, ...]:
    """A profile for each circuit, in their order; one that nothing is said of has no voltage, or no current."""
    circuits = model.require_circuits()
    count = sum(command is not None for command in (drive, voltage, current))
    if not circuits and count:
        raise UsageError(
            "A device without a winding takes no command; instead received one. Leave out drive, voltage_V and "
            "current_A (--drive, --voltage, --current)."
        )
    mixed = isinstance(voltage, Mapping) and isinstance(current, Mapping) and drive is None
    if circuits and count != 1 and not mixed:
        raise UsageError(
            "A simulation needs one of drive, voltage_V and current_A (--drive, --voltage, --current); "
            f"instead received {count} of them."
        )
    if isinstance(drive, str | Path):
        drive = read_profiles(drive, model.circuit_names, interpolation)
    named: dict[str, Profile] = {}
    given_by: dict[str, tuple[Any, Kind]] = {
        "drive": (drive, "voltage"),
        "voltage_V (--voltage)": (voltage, "voltage"),
        "current_A (--current)": (current, "current"),
    }
    for option, (commands, kind) in given_by.items():
        for name, value in _by_name(model, commands, option).items():
            named[name] = value if isinstance(value, Profile) else Profile(kind, np.zeros(1), np.array([value]))
    profiles = [named.get(each.name) or Profile(each.drive.kind, np.zeros(1), np.zeros(1)) for each in circuits]
    for circuit, profile in zip(circuits, profiles, strict=True):
        if circuit.drive.kind == "current" and profile.kind == "voltage":
            which = f"Circuit {circuit.name!r} of model" if len(circuits) > 1 else "Model"
            raise DomainError(
                f"{which} {model.name!r} is driven by a current amplifier; its command must be a current. Give "
                "current_A (--current), or a table with the column current_A."
            )
    return tuple(profiles)


def _by_name(model: ActuatorModel, commands: Any, option: str) -> Mapping[str, Any]:
    """What is given for each circuit, by their names; one value is the only circuit's."""
    names = model.circuit_names
    if commands is None:
        return {}
    if not isinstance(commands, Mapping):
        if len(names) == 1:
            return {names[0]: commands}
        raise UsageError(
            f"{option} must say for which of the circuits {', '.join(names)} it is; instead received one value. Give "
            f"it by their names, as --voltage {','.join(f'{name}=1' for name in names)}."
        )
    require_known(f"The circuit of {option}", commands, names)
    return commands


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
