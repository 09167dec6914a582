"""The numbers of a drawing: which can be calibrated, what users call them, and which are chosen.

The choice follows what a diagnosis names: numbers to be calibrated, and effects to be fitted beside them.
"""

import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, combinations
from pathlib import Path
from typing import Any

from femfit.core.errors import UsageError
from femfit.core.numerics import FloatArray
from femfit.core.results import listing
from femfit.device.complaints import joined, table_at
from femfit.device.drawn_numbers import DrawnNumber, NumberFacts, numbers_from_toml
from femfit.device.load import actuator_from_toml, parse
from femfit.device.parts import Coil
from femfit.device.rewrite import rewritten
from femfit.device.schema import BODIES
from femfit.device.tolerances import KINDS, WITHOUT_FIELD, numbers_of, read_tolerances
from femfit.effects.catalogue import effect_by_name, known_effect
from femfit.effects.circuit import RESISTANCE
from femfit.identify.decision.naming import Decision
from femfit.identify.words import sentence

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
    def uncertain(self) -> tuple[NumberFacts, ...]:
        """These, and the resistance of the only coil, on which no field depends, though it may follow from the wire."""
        coils = actuator_from_toml(self.text, self.source, self.directory).coils
        return (*(number.facts for number in self.numbers), *_resistance(parse(self.text, self.source), coils))

    @cached_property
    def suspects(self) -> tuple[NumberFacts, ...]:
        """What can be calibrated: those that stand in the file."""
        return (*(number.facts for number in self.numbers), *_resistance(parse(self.text, self.source)))

    @cached_property
    def each(self) -> tuple[NumberFacts, ...]:
        """These without faces that move numbers which stand there by themselves."""
        return tuple(number for number in self.suspects if not number.is_contour)

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
        for first, second in combinations(wanted, 2):
            if first.overlaps(second):
                raise UsageError(f"{shown(first)} and {shown(second)} move the same corner. Give one of them.")
        return wanted

    def _called(self, key: str) -> NumberFacts:
        paths = {n: (n.key, *(() if n.is_contour else n.also)) for n in self.suspects}
        tests: tuple[Callable[[NumberFacts], bool], ...] = (
            lambda n: key in {n.name, n.label, n.subject},
            lambda n: " " in key and key in n.label,
            lambda n: key in paths[n],
            lambda n: any(path.endswith(f".{key}") for path in paths[n]),
            # Of a list, where one place alone is a number
            lambda n: any(path.partition("[")[0].endswith(f".{key}") for path in paths[n]),
        )
        matches = next(filter(None, (list(filter(test, paths)) for test in tests)), [])
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise UsageError(f"{key!r} may be each of {listing(map(shown, matches))}. Give one of these.")
        if known_effect(key):
            raise UsageError(f"{key!r} is an effect and no number of this drawing. Fit it beside numbers: --with {key}")
        none = f"{key!r} is no number of this drawing that can be calibrated"
        for path, location in numbers_of(parse(self.text, self.source)).items():
            if path == key or path.endswith(f".{key}"):
                why = "its field does not depend on it. An effect of the catalogue (--with) may stand for it"
                if location[0] in {*BODIES, "coil", "coils"} and "mm" in path:
                    why = "it counts from there, or cannot be built with another one"
                elif location[0] == "materials" and location[-1] not in WITHOUT_FIELD:
                    why = "as drawn there is none of it"
                raise UsageError(f"{none}: {why}.")
        near = difflib.get_close_matches(key[:200], chain.from_iterable(paths.values()), n=4, cutoff=0.3)
        listed = listing(near or map(shown, self.suspects), 4)
        raise UsageError(f"{none}. Near it: {listed}. femfit sweep --signatures lists those that matter.")


def shown(number: NumberFacts) -> str:
    """What a machinist calls a number, with the key path that is typed."""
    return f"{number.label} [{number.key}]" if number.label else number.key


def _resistance(data: Mapping[str, Any], drawn: Sequence[Coil] = ()) -> Iterator[NumberFacts]:
    """Of the only coil, where the file gives it, or else where it is drawn with one that its wire has."""
    paths = [("coil",), *(("coils", name) for name in table_at(data, "coils"))]
    coils = [(joined("", *path), table_at(data, *path)) for path in paths if table_at(data, *path)]
    if len(coils) == 1 and (value := coils[0][1].get("resistance_ohm") or sum(coil.resistance_ohm for coil in drawn)):
        key = f"{coils[0][0]}.resistance_ohm"
        declared_ohm = read_tolerances(data, [])[0].get(key)
        tolerance = KINDS["resistance"].tolerance if declared_ohm is None else declared_ohm / value
        yield NumberFacts(
            key, (), "resistance", float(value), "", tolerance, RESISTANCE.name, declared=declared_ohm is not None
        )


Runs = tuple[int, int] | None
"""First and last run in which an effect acts, counted from 1; None for all."""


@dataclass(frozen=True)
class Choice:
    """What is fitted."""

    numbers: tuple[NumberFacts, ...] = ()
    beside: Mapping[str, Runs] = field(default_factory=dict)  # Effects that are no numbers of the drawing
    # What was decided where the data leave it open, by the key path or the effect that it is about
    remarks: Mapping[str, str] = field(default_factory=dict)


def with_named(choice: Choice, decision: Decision, suspects: Sequence[NumberFacts], *, asked: bool = False) -> Choice:
    """A choice with what a decision names besides.

    The numbers of a class are calibrated, each within its tolerance, though effects would give the same readings; where
    numbers were asked for, effects alone are fitted beside these. What changes between runs is no number of a drawing.
    """
    by_name = {number.name: number for number in suspects}
    fitted_effects = decision.fit.effects if decision.fit else ()
    acts = {added.effect.name: (added.runs[0] + 1, added.runs[1] + 1) for added in fitted_effects if added.runs}
    numbers, beside, fitted = list(choice.numbers), dict(choice.beside), {number.key for number in choice.numbers}
    remarks = {k: text for k, text in choice.remarks.items() if k in fitted | beside.keys()}  # others are named anew
    for members in decision.classes:
        runs, drawn = acts.get(members[0]), _apart(by_name[name] for name in members if name in by_name)
        effects = [name for name in members if name not in by_name]
        if any(number in choice.numbers for number in drawn):
            continue
        if effects and (asked or runs or not drawn):
            name, rivals = effects[0], " or ".join(member for member in members if member != effects[0])
            beside[name] = runs
            if rivals:
                remarks[name] = sentence("calibration_choice", "beside", name, rivals)
        elif asked:
            remarks[drawn[0].key] = sentence("calibration_choice", "not_asked_for", drawn[0].subject)
        elif runs:
            remarks[drawn[0].key] = sentence("calibration_choice", "in_some_runs", drawn[0].subject, *runs)
        else:
            numbers = _apart([*numbers, *drawn])
            if len(members) > 1:
                rivals = " or ".join([*(number.subject for number in drawn[1:]), *effects])
                check = effect_by_name(effects[0]).check if effects else ""
                remarks[drawn[0].key] = sentence("calibration_choice", "taken", drawn[0].subject, rivals, check)
    return Choice(tuple(numbers), beside, remarks)


def _apart(numbers: Iterable[NumberFacts]) -> list[NumberFacts]:
    """Those that move no place that an earlier one moves."""
    result: list[NumberFacts] = []
    for number in numbers:
        if not any(map(number.overlaps, result)):
            result.append(number)
    return result
