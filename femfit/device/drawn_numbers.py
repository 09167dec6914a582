"""The numbers of a drawing that a workshop may miss: faces of parts, materials, the place of the Hall element.

A number is a face's coordinate, whether a box gives it once or a polygon at several corners. Where parts touch along a
face it belongs to both of them: a drawing in which one of them alone changed would have a slit or an overlap there. A
face that moves with the slanted edges beside it stands for the same face without them wherever causes are looked for. A
coordinate that the drawing counts from, as the moving part's nearest face, is none; nor is what an effect of the
catalogue scales exactly (turns and resistance of a circuit's only coil, the remanence of the only magnet material).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import ActuatorFileError
from femfit.core.files import path_of
from femfit.device.complaints import in_file, joined
from femfit.device.drawing import hall_places
from femfit.device.drawn_faces import CONTOUR, drawn_faces
from femfit.device.keys import Place, converted, decimal_sum, keys_of
from femfit.device.load import actuator_from_tables, parse, read_text
from femfit.device.parts import Actuator, Coil, Region
from femfit.device.tolerances import KINDS, length_tolerance, read_tolerances, value_at, with_value

STEP = {"mm": 1e-3}
"""Numerical: by how much a number is changed either way, in its unit; outlines are linear in their coordinates."""

SHARE_STEP = 1e-4  # numerical: the same of a share


@dataclass(frozen=True)
class NumberFacts:
    """What is said of a number; changes of one without a unit are shares of it."""

    key: str  # Key path in the file
    also: tuple[str, ...]  # Key paths of what moves with it
    kind: str  # Of :data:`femfit.device.tolerances.KINDS`
    value: float  # As the file has it
    unit: str  # As the file has it: mm, T, or empty
    tolerance: float  # Standard deviation, in the unit or as a share
    effect: str = ""  # Of the catalogue, where that stands for this number in a diagnosis
    label: str = ""  # What a machinist calls it; sweeps of before have none
    stands_for: str = ""  # Key of the number that is no suspect beside this one
    declared: bool = False  # Whether the drawing gives the tolerance
    at: tuple[float, float] | None = None  # Of a length: a place in the drawing that it moves, r and z in mm

    @property
    def name(self) -> str:
        """What a diagnosis calls it."""
        return self.effect or self.key

    @property
    def deviation(self) -> float:
        """Standard deviation in the unit of the value."""
        return self.tolerance * self.per(self.value)

    def per(self, value: float) -> float:
        """What one unit of a change is where the number has a value, in the unit of that."""
        return 1.0 if self.unit else abs(value)

    @property
    def subject(self) -> str:
        """The number as the subject of a sentence."""
        body, colon, face = self.label.partition(": ")
        words = f"the {body}'s {face}" if colon else f"the {body}"
        name = self.key.split(".")[1] if "." in self.key else ""
        return KINDS[self.kind].words.format(key=words if self.label else self.key, name=name)

    @property
    def title(self) -> str:
        """The number at the head of a line."""
        return self.label or self.subject

    @property
    def paths(self) -> tuple[str, ...]:
        """Key paths of all that moves."""
        return self.also if self.is_contour else (self.key, *self.also)

    @property
    def is_contour(self) -> bool:
        """Whether it moves several numbers of the drawing, each of which is one by itself."""
        return CONTOUR in self.key

    @property
    def solved(self) -> dict[str, Any]:
        """What its slopes depend on, as JSON-ready data: what it is called changes none."""
        return {
            key: value for key, value in asdict(self).items() if key not in {"label", "stands_for", "declared", "at"}
        }

    def overlaps(self, number: "NumberFacts") -> bool:
        """Whether the two move the same place of the drawing."""
        return bool({*self.paths} & {*number.paths})


@dataclass(frozen=True)
class DrawnNumber:
    """A number of the drawing with the actuators that a little more and a little less of it make."""

    facts: NumberFacts
    step: float  # In the unit or as a share
    larger: Actuator
    smaller: Actuator


def in_picture(numbers: Iterable[NumberFacts]) -> tuple[NumberFacts, ...]:
    """The lengths that a picture of the drawing marks, in its order; a face with its cone for the one without."""
    numbers = tuple(numbers)
    replaced = {number.stands_for for number in numbers}
    return tuple(number for number in numbers if number.at is not None and number.key not in replaced)


def read_numbers(path: str | Path, *, harmonic: bool = False) -> tuple[DrawnNumber, ...]:
    """The numbers of an actuator file, in its order.

    Parameters
    ----------
    harmonic : bool
        Whether to have those, too, that change nothing in a field at rest: conductivities and thicknesses of sheets.

    Raises
    ------
    ActuatorFileError
        If the file has any problem, or sweeps parameters: its numbers are then not one.
    """
    path = path_of(path, "An actuator file")
    return numbers_from_toml(read_text(path), str(path), path.parent, harmonic=harmonic)


def numbers_from_toml(
    text: str, source: str = "actuator file", directory: Path | None = None, *, harmonic: bool = False
) -> tuple[DrawnNumber, ...]:
    """The numbers of an actuator file's text; arguments and errors as of :func:`read_numbers`."""
    data = parse(text, source)
    actuator = actuator_from_tables(data, source, directory)
    if "parameters" in data["sweep"]:
        raise ActuatorFileError(
            source, ["sweep.parameters must be absent where signatures are asked for. Take one variant's drawing."]
        )

    def moved(locations: Sequence[Place], change: float) -> Actuator:
        tables = deepcopy(data)
        for location in locations:
            with_value(tables, location, decimal_sum(float(value_at(tables, location)), change, 1.0))
        return actuator_from_tables(tables, source, directory)

    tolerances, general = read_tolerances(data, [])
    numbers = []
    suspects = _faces(data, moved), _materials(actuator), _hall_place(data, moved), _turns(actuator)
    for today, changed in chain(*suspects):
        key, *also = (in_file(data, path) for path in (today.key, *today.also))
        facts = replace(today, key=key, also=tuple(also), stands_for=in_file(data, today.stands_for))
        declared = [tolerances[key] for key in (facts.key, *facts.also) if key in tolerances]
        if declared:
            facts = replace(facts, tolerance=declared[0] / facts.per(facts.value), declared=True)
        elif facts.unit == "mm" and general is not None:
            facts = replace(facts, tolerance=general, declared=True)
        step = STEP.get(facts.unit, SHARE_STEP)
        if harmonic or KINDS[facts.kind].at_rest:
            with suppress(ActuatorFileError):  # of a length from which the drawing counts
                numbers.append(DrawnNumber(facts, step, changed(step), changed(-step)))
    return tuple(numbers)


_Suspects = Iterator[tuple[NumberFacts, Callable[[float], Actuator]]]
"""Numbers, each with the actuator that a change of it makes, which is in its unit or a share."""


def _faces(data: Mapping[str, Any], moved: Callable[..., Actuator]) -> _Suspects:
    for face in drawn_faces(data):
        paths = [joined("", *location) for location in face.locations]
        first, *also = dict.fromkeys([face.key, *paths] if face.key else paths)
        facts = NumberFacts(first, tuple(also), "length", face.value, "mm", length_tolerance(face.value))
        named = replace(facts, label=face.label, stands_for=joined("", *face.flat), at=face.at)
        yield named, partial(moved, face.locations)


def _hall_place(data: Mapping[str, Any], moved: Callable[..., Actuator]) -> _Suspects:
    """Of the first Hall element, whose field the sweep solves."""
    for path, element in islice(hall_places(data).items(), 1):
        point = element.r_mm, element.z_mm
        for axis, value in zip("rz", point, strict=True):
            if axis == "z" or value > 0.0:
                key, label = f"{axis}_mm", f"Hall element at {axis} = {value:g} mm"
                tolerance = length_tolerance(value)
                facts = NumberFacts(f"{path}.{key}", (), "hall_place", value, "mm", tolerance, label=label, at=point)
                yield facts, partial(moved, [(*path.split("."), key)])


def _turns(actuator: Actuator) -> _Suspects:
    for coil in actuator.coils:
        alone = sum(winding.circuit == coil.circuit for winding in actuator.coils) == 1
        key = joined("coils", coil.name, "turns")
        effect = "turns" if len(actuator.circuits) == 1 else f"turns:{coil.circuit}"
        facts = NumberFacts(key, (), "turns", coil.turns, "", KINDS["turns"].tolerance, effect * alone)
        yield facts, partial(_with_turns, actuator, coil)


def _with_turns(actuator: Actuator, coil: Coil, share: float) -> Actuator:
    wound = (replace(each, turns=each.turns * (1.0 + share)) if each is coil else each for each in actuator.coils)
    return replace(actuator, coils=tuple(wound))


def _materials(actuator: Actuator) -> _Suspects:
    """Permeability and remanence of linear materials, the scales of B and of H of curves, and how each conducts."""
    used = {region.material.name: region.material for region in actuator.regions}
    magnets = [name for name, material in used.items() if material.remanence_T]
    for name, material in used.items():
        for path, key in keys_of(type(material)).items():
            drawn = getattr(material, key.field) if key.kind else 0.0
            value = 1.0 if isinstance(drawn, tuple) else converted(abs(drawn), -key.power)
            if value == (1.0 if key.kind == "permeability" else 0.0) or not value:
                continue
            kind = f"{'recoil_' * bool(key.kind == 'permeability' and material.remanence_T)}{key.kind}"
            effect = "remanence" if kind == "remanence" and len(magnets) == 1 else ""
            facts = NumberFacts(joined("materials", name, path), (), kind, value, "", KINDS[kind].tolerance, effect)
            yield facts, partial(_with_material, actuator, name, key.field)


def _with_material(actuator: Actuator, name: str, field: str, share: float) -> Actuator:
    """The actuator with a number, or with all numbers of a list, of a material more by a share."""

    def changed(region: Region) -> Region:
        if region.material.name != name:
            return region
        drawn: Any = np.asarray(getattr(region.material, field)) * (1.0 + share)
        value: Any = tuple(drawn.tolist()) if drawn.ndim else float(drawn)
        return replace(region, material=replace(region.material, **{field: value}))

    moving = replace(actuator.moving, regions=tuple(map(changed, actuator.moving.regions)))
    return replace(actuator, fixed=tuple(map(changed, actuator.fixed)), moving=moving)
