"""From the parts of a ``.fem`` file to its model: numbers, units, references from one list to another."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from femfit.core.errors import FemFileError
from femfit.tables.femm.model import (
    FemBoundary,
    FemCircuit,
    FemLabel,
    FemLine,
    FemMaterial,
    FemModel,
    FemPoint,
    FemPointProperty,
)
from femfit.tables.femm.text import FemText, split_fem, unquoted

UNITS_MM = {
    "inches": 25.4,
    "millimeters": 1.0,
    "centimeters": 10.0,
    "mils": 0.0254,
    "microns": 1e-3,
    "micrometers": 1e-3,
    "meters": 1e3,
}
"""FEMM's length units in mm (the inch is exact)."""

DIGITS = 6
"""Decimals of a millimetre that coordinates are kept with: a nanometre, beyond any drawing."""

LARGEST_MM = 1e5
"""As in actuator files."""

MATERIAL = {
    "mu_x": "mu_x",
    "mu_y": "mu_y",
    "coercivity": "h_c",
    "coercivity_angle": "h_cangle",
    "current_density": "j_re",
    "conductivity": "sigma",
    "lamination_type": "lamtype",
    "lamination_fill": "lamfill",
    "strands": "nstrands",
    "wire_diameter_mm": "wired",
    "curve": "curve",
}
BOUNDARY = {"kind": "bdrytype", "a0": "a_0", "a1": "a_1", "a2": "a_2", "c0": "c0", "c1": "c1"}
CIRCUIT = {"current_A": "totalamps_re", "kind": "circuittype"}
POINT = {"potential": "a_re", "current_A": "i_re"}
WHOLE = {"kind", "lamination_type", "strands"}
"""The model's names of the keys of a property's block, and those that are whole numbers."""

Item = TypeVar("Item")


def parse_fem(content: bytes, source: str) -> FemModel:
    """Read a FEMM magnetics file."""
    text = split_fem(content, source)
    unit = text.header.get("lengthunits", "inches").lower()
    if unit not in UNITS_MM:
        text.problems.append(f"[LengthUnits] must be one of {', '.join(UNITS_MM)}; instead received {unit[:40]!r}.")
    scale = UNITS_MM.get(unit, 1.0)

    def properties(
        section: str, build: Callable[..., Item], what: str, name: str, keys: Mapping[str, str]
    ) -> list[Item]:
        return [_property(text, block, build, what, name, keys) for block in text.properties.get(section, ())]

    point_properties = properties("pointprops", FemPointProperty, "point property", "pointname", POINT)
    boundaries = properties("bdryprops", FemBoundary, "boundary", "bdryname", BOUNDARY)
    materials = properties("blockprops", FemMaterial, "block property", "blockname", MATERIAL)
    circuits = properties("circuitprops", FemCircuit, "circuit", "circuitname", CIRCUIT)
    points = [_point(text, row, n, scale, point_properties) for n, row in enumerate(text.rows["numpoints"])]
    lines = [
        line
        for key, angled in (("numsegments", False), ("numarcsegments", True))
        for n, row in enumerate(text.rows.get(key, ()))
        if (line := _line(text, row, n, angled, points, boundaries)) is not None
    ]
    labels = [_label(text, row, n + 1, scale, materials, circuits) for n, row in enumerate(text.rows["numblocklabels"])]
    labels += [_hole(text, row, len(labels) + n + 1, scale) for n, row in enumerate(text.rows.get("numholes", ()))]
    model = FemModel(
        source=source,
        version=text.number(text.header["format"], "[Format]"),
        problem_type=text.header.get("problemtype", "planar").lower(),
        frequency=text.number(text.header.get("frequency", "0"), "[Frequency]"),
        unit=unit,
        previous_solution=text.header.get("prevsoln", ""),
        previous_type=text.integer(text.header.get("prevtype", "0"), "[PrevType]"),
        comment=unquoted(text.header.get("comment", "")),
        points=tuple(points),
        lines=tuple(lines),
        labels=tuple(labels),
    )
    if text.problems:
        raise FemFileError(source, list(dict.fromkeys(text.problems)))
    return model


def _property(
    text: FemText,
    block: Mapping[str, str],
    build: Callable[..., Item],
    what: str,
    name_key: str,
    keys: Mapping[str, str],
) -> Item:
    name = unquoted(block.get(name_key, ""))
    values: dict[str, Any] = {}
    for own, key in keys.items():
        if key == "curve" and key in block:
            values[own] = _curve(text, block[key], f"{what} {name!r}")
        elif key in block:
            read = text.integer if own in WHOLE else text.number
            values[own] = read(block[key], f"{what} {name!r}: {key}")
    return build(name, **values)


def _curve(text: FemText, rows: str, where: str) -> tuple[tuple[float, float], ...]:
    points = [row.split() for row in rows.splitlines()]
    if any(len(row) < 2 for row in points):
        text.problems.append(f"{where}: each of its BHPoints must be B and H.")
        return ()
    return tuple((text.number(b, f"{where}: B"), text.number(h, f"{where}: H")) for b, h, *_ in points)


def _point(text: FemText, row: Sequence[str], n: int, scale: float, properties: Sequence[FemPointProperty]) -> FemPoint:
    where = f"point {n}"
    r, z, reference = _fields(text, row, where, ("0", "0", "0"), needed=2)
    held = _referenced(text, reference, properties, f"{where}: its point property")
    return FemPoint(_length(text, r, scale, where), _length(text, z, scale, where), held)


def _line(
    text: FemText,
    row: Sequence[str],
    n: int,
    angled: bool,
    points: Sequence[FemPoint],
    boundaries: Sequence[FemBoundary],
) -> FemLine | None:
    where = f"arc {n}" if angled else f"segment {n}"
    if angled:
        start, end, angle_text, _, reference = _fields(text, row, where, ("0", "0", "0", "-1", "0"), needed=3)
    else:
        start, end, _, reference = _fields(text, row, where, ("0", "0", "-1", "0"), needed=2)
        angle_text = "0"
    ends = [text.integer(index, f"{where}: its point") for index in (start, end)]
    if any(not 0 <= index < len(points) for index in ends):
        text.problems.append(f"{where} runs from point {start} to {end}; there are points 0 to {len(points) - 1}.")
        return None
    angle = text.number(angle_text, f"{where}: its angle")
    if angled and not 0 < angle < 360:
        text.problems.append(f"{where} must span an angle between 0 and 360 degrees; it has {angle:g}.")
        return None
    boundary = _referenced(text, reference, boundaries, f"{where}: its boundary property")
    return FemLine(points[ends[0]], points[ends[1]], angle, boundary)


def _label(
    text: FemText,
    row: Sequence[str],
    number: int,
    scale: float,
    materials: Sequence[FemMaterial],
    circuits: Sequence[FemCircuit],
) -> FemLabel:
    where = f"block label {number}"
    defaults = ("0", "0", "0", "-1", "0", "0", "0", "1", "0", "")
    r, z, material, _, circuit, direction, group, turns, flags, formula = _fields(text, row, where, defaults, needed=3)
    flag = text.integer(flags, f"{where}: its external flag")
    return FemLabel(
        number,
        _length(text, r, scale, where),
        _length(text, z, scale, where),
        _referenced(text, material, materials, f"{where}: its block property"),
        _referenced(text, circuit, circuits, f"{where}: its circuit"),
        text.number(turns, f"{where}: its turns"),
        text.number(direction, f"{where}: its magnetization"),
        unquoted(formula),
        text.integer(group, f"{where}: its group"),
        external=bool(flag & 1),
        default=bool(flag & 2),
    )


def _hole(text: FemText, row: Sequence[str], number: int, scale: float) -> FemLabel:
    r, z, group = _fields(text, row, "hole", ("0", "0", "0"), needed=2)
    place = [_length(text, value, scale, "hole") for value in (r, z)]
    return FemLabel(number, place[0], place[1], None, group=text.integer(group, "hole: its group"))


def _fields(text: FemText, row: Sequence[str], where: str, defaults: Sequence[str], needed: int) -> list[str]:
    if len(row) < needed:
        text.problems.append(f"{where} has {len(row)} values; it needs {needed} at least.")
        return list(defaults)
    return [*row[: len(defaults)], *defaults[len(row) :]]


def _length(text: FemText, value: str, scale: float, where: str) -> float:
    length = scale * text.number(value, f"{where}: its coordinate")
    if abs(length) > LARGEST_MM:
        text.problems.append(f"{where} lies {length:g} mm off; lengths must be within {LARGEST_MM:g} mm.")
        return 0.0
    return round(length, DIGITS) + 0.0  # no minus zero


def _referenced(text: FemText, index: str, items: Sequence[Item], where: str) -> Item | None:
    """The item that a reference (from 1; 0 or less for none) names."""
    place = text.integer(index, where)
    if place > len(items):
        text.problems.append(f"{where} is number {place}; the file defines {len(items)}.")
        return None
    return items[place - 1] if place > 0 else None
