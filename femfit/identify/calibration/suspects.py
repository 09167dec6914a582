"""The numbers of a drawing that can be calibrated, each with the effect that says what it changes."""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femfit.core.errors import TableError, UsageError
from femfit.core.finding import listing
from femfit.device.complaints import joined
from femfit.device.drawing import table_at
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.file_numbers import unit_of
from femfit.device.load import parse
from femfit.device.read_tolerances import read_tolerances
from femfit.device.rewrite import NewValue
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import Effect
from femfit.effects.tolerances import RESISTANCE, TOLERANCE_SD
from femfit.model.actuator_model import ActuatorModel

ALL = "all"


@dataclass(frozen=True)
class Suspect:
    """A number of the drawing."""

    key: str  # Key path in the file
    also: tuple[str, ...]  # Key paths of what moves with it
    kind: str  # Of a length, a place, a permeability ...
    effect: str  # Name of the effect in the swept model
    drawn: float  # As the file has it; 1 of a curve, which is scaled as a whole
    tolerance: float  # Standard deviation, in the same unit
    share: bool  # Whether the effect counts changes over the present value

    @property
    def unit(self) -> str:
        """As the key has it; empty of a pure number and of a factor."""
        return "" if self.kind.startswith("curve_") else unit_of(self.key.partition("[")[0])

    def per(self, value: float) -> float:
        """What one unit of the effect's amplitude is of the number, where its present value is given."""
        return abs(value) if self.share else 1.0

    def at(self, value: float) -> NewValue:
        """Another value, to be written into the drawing."""
        return NewValue(self.key, self.also, self.kind, self.drawn, value)

    def effect_of(self, model: ActuatorModel) -> Effect:
        """What it changes of a model that was fitted to a sweep with signatures."""
        drawn = next((one.effect for one in model.drawn if one.key == self.effect), None)
        if drawn is None and self.effect == self.key:
            raise TableError(f"{self.key} changes nothing at the points of the sweep, so it cannot be calibrated.")
        return drawn or effect_by_name(self.effect)


def suspects(text: str, source: str, directory: Path | None = None) -> tuple[Suspect, ...]:
    """The numbers of an actuator file's text: those of its signatures, and the resistance of its only coil.

    Raises
    ------
    ActuatorFileError
        If the file has any problem, or sweeps parameters.
    """
    facts = (one.facts for one in numbers_from_toml(text, source, directory))
    of_signatures = [
        Suspect(
            one.key,
            one.also,
            one.kind,
            one.effect or one.key,
            one.value,
            one.tolerance * (1.0 if one.unit else abs(one.value)),
            not one.unit,
        )
        for one in facts
    ]
    return (*of_signatures, *_resistance(parse(text, source)))


def _resistance(data: Mapping[str, Any]) -> Iterator[Suspect]:
    """Of the only coil, where the file gives it: no field depends on it."""
    paths = [("coil",), *(("coils", name) for name in table_at(data, "coils"))]
    coils = [(joined("", *path), table_at(data, *path)) for path in paths if table_at(data, *path)]
    if len(coils) == 1 and coils[0][1].get("resistance_ohm"):
        key, value = f"{coils[0][0]}.resistance_ohm", float(coils[0][1]["resistance_ohm"])
        tolerance = read_tolerances(data, [])[0].get(key, TOLERANCE_SD * value)
        yield Suspect(key, (), "resistance", RESISTANCE.name, value, tolerance, share=True)


def wanted_suspects(keys: str | Sequence[str], known: Sequence[Suspect]) -> tuple[Suspect, ...]:
    """The numbers of these key paths, or all."""
    keys = [keys] if isinstance(keys, str) else list(keys) if isinstance(keys, Iterable) else []
    if not keys:
        raise UsageError("No number is given. Give key paths of the drawing, or leave them out to ask the diagnosis.")
    if keys == [ALL]:
        return tuple(known)
    by_key = {key: one for one in known for key in (one.key, *one.also)}
    for key in keys:
        if key not in by_key:
            near = difflib.get_close_matches(str(key)[:200], by_key, n=4, cutoff=0.3) or list(by_key)
            raise UsageError(
                f"{key!r} is no number of this drawing that can be calibrated. Near it: {listing(near, 4)}. "
                "femfit sweep --signatures lists those that matter."
            )
    return tuple(dict.fromkeys(by_key[key] for key in keys))
