"""What is commanded over time: a voltage or a current, held from point to point or interpolated.

What is commanded: one profile for each circuit of a model, from whatever was given.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from femfit.core.errors import DomainError, TableError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.feed import Winding
from femfit.simulation.words import sentence
from femfit.tables.columns import UsedColumn, column_values, match_column
from femfit.tables.reading import read_raw_table

Interpolation = Literal["held", "linear"]


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

    kind: Literal["voltage", "current"]
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
            raise TableError("A profile's times must ascend, and its times and values must be finite. Sort its rows.")
        object.__setattr__(self, "time_s", time)
        object.__setattr__(self, "value", value)

    def __str__(self) -> str:
        return sentence("open_loop", "profile", self)

    @cached_property
    def turns_s(self) -> FloatArray:
        """Times at which the command jumps, or changes its slope: between them it is one straight line."""
        time, value = self.time_s, self.value
        if self.interpolation == "held":
            return np.asarray(time[1:][np.diff(value) != 0.0])
        if len(time) == 1:
            return np.zeros(0)
        slope = np.concatenate([[0.0], np.diff(value) / np.diff(time), [0.0]])
        return np.asarray(time[np.abs(np.diff(slope)) > 1e-12 * np.abs(slope).max()])

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
        if k < 0 or k >= len(self.time_s) - 1 or self.interpolation == "held":
            return float(self.value[max(k, 0)]), 0.0
        slope = (self.value[k + 1] - self.value[k]) / (self.time_s[k + 1] - self.time_s[k])
        return float(self.value[k] + slope * (time - self.time_s[k])), float(slope)

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
    pairs = list(zip(circuits, voltage_columns(circuits), circuit_currents(circuits), strict=True))
    columns = ("time_s", *(column for _, *both in pairs for column in both))
    used: dict[str, UsedColumn] = {}
    for header in raw.headers:
        column = match_column(header, columns)
        if column is not None and column.name not in used:
            used[column.name] = column
    commands = {name: [column for column in both if column in used] for name, *both in pairs}
    if "time_s" not in used or not any(commands.values()) or any(len(both) > 1 for both in commands.values()):
        each = " or ".join(f"one of {voltage} and {current}" for _, voltage, current in pairs)
        raise TableError(
            f"{path} must have a column time_s and {each}; its columns are {', '.join(raw.headers)}. Name them so, and "
            "leave one of two for the same circuit out."
        )
    values, _ = column_values(raw, list(used.values()))
    profiles: dict[str, Profile] = {}
    try:
        for name, commanded in commands.items():
            for command in commanded:
                kind: Literal["voltage", "current"] = "voltage" if command.startswith("voltage") else "current"
                profiles[name] = Profile(kind, values["time_s"].to_numpy(), values[command].to_numpy(), interpolation)
    except TableError as error:
        raise TableError(f"{path}: {error}") from error
    return profiles


Value = TypeVar("Value")

Constant: TypeAlias = float | Mapping[str, float] | None
"""One number, or one by the name of a circuit."""

Command: TypeAlias = Profile | Mapping[str, Profile] | str | Path | None
"""A profile, or one by the name of a circuit, or a table."""


def commanded(
    model: ActuatorModel, drive: Command, voltage: Constant, current: Constant, interpolation: Interpolation
) -> tuple[Profile, ...]:
    """A profile for each circuit, in their order; one that nothing is said of has no voltage, or no current."""
    circuits = model.require_circuits()
    commands = [command for command in (drive, voltage, current) if command is not None]
    if not circuits and commands:
        raise UsageError(
            "A device without a winding takes no command; instead received one. Leave out drive, voltage_V and "
            "current_A (--drive, --voltage, --current)."
        )
    mixed = all(isinstance(command, Mapping) for command in (voltage, current)) and drive is None
    if circuits and len(commands) != 1 and not mixed:
        raise UsageError(
            "A simulation needs one of drive, voltage_V and current_A (--drive, --voltage, --current); "
            f"instead received {len(commands)} of them."
        )
    if isinstance(drive, str | Path):
        named: Mapping[str, Profile] = read_profiles(drive, model.circuit_names, interpolation)
    elif drive is not None:
        named = _by_name(model, drive, "drive")
    else:
        named = _constant(model, "voltage", voltage) | _constant(model, "current", current)
    profiles = []
    for circuit in circuits:
        kind: Literal["voltage", "current"] = "current" if circuit.drive.kind == "current" else "voltage"
        profile = named.get(circuit.name) or Profile(kind, np.zeros(1), np.zeros(1))
        if kind == "current" and profile.kind == "voltage":
            which = f"Circuit {circuit.name!r} of model" if len(circuits) > 1 else "Model"
            raise DomainError(
                f"{which} {model.name!r} is driven by a current amplifier; its command must be a current. Give "
                "current_A (--current), or a table with the column current_A."
            )
        profiles.append(profile)
    return tuple(profiles)


def _constant(model: ActuatorModel, kind: Literal["voltage", "current"], constant: Constant) -> dict[str, Profile]:
    if constant is None:
        return {}
    option = "voltage_V (--voltage)" if kind == "voltage" else "current_A (--current)"
    values = _by_name(model, constant, option)
    return {name: Profile(kind, np.zeros(1), np.array([value])) for name, value in values.items()}


def _by_name(model: ActuatorModel, values: Value | Mapping[str, Value], option: str) -> dict[str, Value]:
    names = model.circuit_names
    if not isinstance(values, Mapping):
        if len(names) == 1:
            return {names[0]: values}
        raise UsageError(
            f"{option} must say for which of the circuits {', '.join(names)} it is; instead received one value. Give "
            f"it by their names, as --voltage {','.join(f'{name}=1' for name in names)}."
        )
    unknown = [name for name in values if name not in names]
    if unknown:
        raise UsageError(
            f"{option} must name circuits of model {model.name!r} ({', '.join(names)}); instead received "
            f"{', '.join(unknown)}. Use these names."
        )
    return dict(values)


def beyond_limits(winding: Winding, profile: Profile, named: bool) -> tuple[str, ...]:
    """A note where a driver cannot give what is commanded."""
    low, high = winding.limits
    if low <= profile.value.min() and profile.value.max() <= high:
        return ()
    return (sentence("open_loop", "beyond_limits", winding, profile, named),)
