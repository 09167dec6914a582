"""A drawing with its numbers: which can be calibrated, what users call them, and the drawing with other values."""

import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

from femfit.core.arrays import FloatArray
from femfit.core.errors import UsageError
from femfit.core.finding import listing
from femfit.device.complaints import joined
from femfit.device.drawing import table_at
from femfit.device.drawn_numbers import DrawnNumber, NumberFacts, numbers_from_toml
from femfit.device.file_numbers import BODIES, numbers_of
from femfit.device.load import parse
from femfit.device.read_tolerances import read_tolerances
from femfit.device.rewrite import rewritten
from femfit.device.schema_materials import ConductorEntry
from femfit.device.tolerance_defaults import KINDS
from femfit.effects.catalogue import known_effect
from femfit.effects.tolerances import RESISTANCE

ALL = "all"


@dataclass(frozen=True, eq=False)
class Drawing:
    """An actuator file's text."""

    text: str
    source: str
    directory: Path  # Further files are named relative to it

    @cached_property
    def numbers(self) -> tuple[DrawnNumber, ...]:
        """Those with signatures; ActuatorFileError if the file has any problem, or sweeps parameters."""
        harmonic = "frequency_Hz" in table_at(parse(self.text, self.source), "solver")
        return numbers_from_toml(self.text, self.source, self.directory, harmonic=harmonic)

    @cached_property
    def suspects(self) -> tuple[NumberFacts, ...]:
        """What can be calibrated: these, and the resistance of the only coil, on which no field depends."""
        return (*(one.facts for one in self.numbers), *_resistance(parse(self.text, self.source)))

    @cached_property
    def each(self) -> tuple[NumberFacts, ...]:
        """These without faces that move numbers which stand there by themselves."""
        return tuple(one for one in self.suspects if not one.is_contour)

    def with_values(self, numbers: Sequence[NumberFacts], values: FloatArray) -> "Drawing":
        """The drawing with other values of some numbers."""
        pairs = zip(numbers, map(float, values), strict=True)
        return replace(self, text=rewritten(self.text, pairs, self.source, self.directory))

    def wanted(self, keys: str | Sequence[str]) -> tuple[NumberFacts, ...]:
        """The numbers of these key paths, of their ends, or of the names that a diagnosis has for them; or all."""
        keys = [keys] if isinstance(keys, str) else list(keys) if isinstance(keys, Iterable) else []
        if not keys:
            raise UsageError(
                "No number is given. Give key paths of the drawing, or leave them out to ask the diagnosis."
            )
        if keys == [ALL]:
            return self.each
        wanted = tuple(dict.fromkeys(self._called(key) for key in map(str, keys)))
        for one, other in combinations(wanted, 2):
            if one.overlaps(other):
                raise UsageError(f"{shown(one)} and {shown(other)} move the same corner. Give one of them.")
        return wanted

    def _called(self, key: str) -> NumberFacts:
        paths = [((one.key, *(() if one.is_contour else one.also)), one) for one in self.suspects]
        tests: tuple[Callable[[str], bool], ...] = (
            lambda path: path == key,
            lambda path: path.endswith(f".{key}"),
            lambda path: path.partition("[")[0].endswith(f".{key}"),  # of a list, where one place alone is a number
        )
        found = [one for one in self.suspects if key in {one.name, one.label, one.subject}]
        found = found or [one for one in self.suspects if " " in key and key in one.label]
        for test in tests:
            found = found or [one for known, one in paths if any(map(test, known))]
        if len(found) == 1:
            return found[0]
        if found:
            raise UsageError(f"{key!r} may be each of {listing(map(shown, found))}. Give one of these.")
        if known_effect(key):
            raise UsageError(f"{key!r} is an effect and no number of this drawing. Fit it beside numbers: --with {key}")
        none = f"{key!r} is no number of this drawing that can be calibrated"
        for path, location in numbers_of(parse(self.text, self.source)).items():
            if path == key or path.endswith(f".{key}"):
                why = "its field does not depend on it. An effect of the catalogue (--with) may stand for it"
                if location[0] in {*BODIES, "coil", "coils"} and "mm" in path:
                    why = "it counts from there, or cannot be built with another one"
                elif location[0] == "materials" and location[-1] not in ConductorEntry.model_fields:
                    why = "as drawn there is none of it"
                raise UsageError(f"{none}: {why}.")
        near = difflib.get_close_matches(key[:200], [path for known, _ in paths for path in known], n=4, cutoff=0.3)
        listed = listing(near or map(shown, self.suspects), 4)
        raise UsageError(f"{none}. Near it: {listed}. femfit sweep --signatures lists those that matter.")


def shown(number: NumberFacts) -> str:
    """What a machinist calls a number, with the key path that is typed."""
    return f"{number.label} [{number.key}]" if number.label else number.key


def _resistance(data: Mapping[str, Any]) -> Iterator[NumberFacts]:
    """Of the only coil, where the file gives it."""
    paths = [("coil",), *(("coils", name) for name in table_at(data, "coils"))]
    coils = [(joined("", *path), table_at(data, *path)) for path in paths if table_at(data, *path)]
    if len(coils) == 1 and coils[0][1].get("resistance_ohm"):
        key, value = f"{coils[0][0]}.resistance_ohm", float(coils[0][1]["resistance_ohm"])
        given = read_tolerances(data, [])[0].get(key)
        tolerance = KINDS["resistance"].tolerance if given is None else given / value
        yield NumberFacts(key, (), "resistance", value, "", tolerance, RESISTANCE.name, declared=given is not None)
