"""What is commanded: one profile for each circuit of a model, from whatever was given."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from femfit.core.amount import amount_range
from femfit.core.errors import DomainError, UsageError
from femfit.device.circuit import Circuit
from femfit.model.actuator_model import ActuatorModel
from femfit.open_loop.feed import Winding
from femfit.open_loop.profile import Interpolation, Profile, read_profiles

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
    return tuple(_checked(model, circuit, named.get(circuit.name)) for circuit in circuits)


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


def _checked(model: ActuatorModel, circuit: Circuit, profile: Profile | None) -> Profile:
    if profile is None:
        kind: Literal["voltage", "current"] = "current" if circuit.drive.kind == "current" else "voltage"
        return Profile(kind, np.zeros(1), np.zeros(1))
    if circuit.drive.kind == "current" and profile.kind == "voltage":
        which = f"Circuit {circuit.name!r} of model" if len(model.circuits) > 1 else "Model"
        raise DomainError(
            f"{which} {model.name!r} is driven by a current amplifier; its command must be a current. Give current_A "
            "(--current), or a table with the column current_A."
        )
    return profile


def beyond_limits(winding: Winding, profile: Profile, named: bool) -> tuple[str, ...]:
    """A note where a driver cannot give what is commanded."""
    low, high = winding.limits
    smallest, largest = float(profile.value.min()), float(profile.value.max())
    if low <= smallest and largest <= high:
        return ()
    unit = "A" if winding.commands_current else "V"
    asked = amount_range(smallest, largest, unit, 3)
    limits = amount_range(low, high, unit, 3) if np.isfinite(low + high) else f"{low:g} to {high:g} {unit}"
    of = f" of {winding.circuit.name}" if named else ""
    note = f"The command{of} of {asked} exceeds what the driver gives, {limits}; it is cut there. Change the supply in "
    return (note + "the drawing to simulate a stronger one.",)
