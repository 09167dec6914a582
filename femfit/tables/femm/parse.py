"""From the parts of a ``.fem`` file to its model: numbers, units, references from one list to another."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TypeVar

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

Item = TypeVar("Item")


def parse_fem(content: bytes, source: str) -> FemModel:
    """Read a FEMM magnetics file.

    Returns
    -------
    FemModel
        Lengths in mm.

    Raises
    ------
    FemFileError
        If it is no such file, or a value in it cannot be read; the error lists all of them.
    """
    text = split_fem(content, source)
    unit = text.header.get("lengthunits", "inches").lower()
    if unit not in UNITS_MM:
        text.problems.append(f"[LengthUnits] must be one of {', '.join(UNITS_MM)}; instead received {unit[:40]!r}.")
    scale = UNITS_MM.get(unit, 1.0)
    properties = text.properties
    point_properties = [_point_property(text, block) for block in properties.get("pointprops", ())]
    boundaries = [_boundary(text, block) for block in properties.get("bdryprops", ())]
    materials = [_material(text, block) for block in properties.get("blockprops", ())]
    circuits = [_circuit(text, block) for block in properties.get("circuitprops", ())]
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
        unit_mm=scale,
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


def _point_property(text: FemText, block: Mapping[str, str]) -> FemPointProperty:
    name = unquoted(block.get("pointname", ""))
    read = partial(_value, text, block, f"point property {name!r}")
    return FemPointProperty(name, potential=read("a_re", 0.0), current_A=read("i_re", 0.0))


def _boundary(text: FemText, block: Mapping[str, str]) -> FemBoundary:
    name = unquoted(block.get("bdryname", ""))
    where = f"boundary {name!r}"
    read = partial(_value, text, block, where)
    return FemBoundary(
        name,
        kind=text.integer(block.get("bdrytype", "0"), f"{where}: BdryType"),
        potentials=(read("a_0", 0.0), read("a_1", 0.0), read("a_2", 0.0)),
        c0=read("c0", 0.0),
        c1=read("c1", 0.0),
    )


def _material(text: FemText, block: Mapping[str, str]) -> FemMaterial:
    name = unquoted(block.get("blockname", ""))
    where = f"block property {name!r}"
    read = partial(_value, text, block, where)
    points = [row.split() for row in block.get("curve", "").splitlines()]
    if any(len(row) < 2 for row in points):
        text.problems.append(f"{where}: each of its BHPoints must be B and H.")
        points = []
    return FemMaterial(
        name,
        mu_x=read("mu_x", 1.0),
        mu_y=read("mu_y", 1.0),
        coercivity=read("h_c", 0.0),
        coercivity_angle=read("h_cangle", 0.0),
        current_density=read("j_re", 0.0),
        conductivity=read("sigma", 0.0),
        lamination_type=text.integer(block.get("lamtype", "0"), f"{where}: LamType"),
        lamination_fill=read("lamfill", 1.0),
        strands=text.integer(block.get("nstrands", "0"), f"{where}: NStrands"),
        wire_diameter_mm=read("wired", 0.0),
        curve=tuple((text.number(b, f"{where}: B"), text.number(h, f"{where}: H")) for b, h, *_ in points),
    )


def _circuit(text: FemText, block: Mapping[str, str]) -> FemCircuit:
    name = unquoted(block.get("circuitname", ""))
    read = partial(_value, text, block, f"circuit {name!r}")
    return FemCircuit(name, current_A=read("totalamps_re", 0.0), series=read("circuittype", 1.0) == 1.0)


def _value(text: FemText, block: Mapping[str, str], where: str, key: str, default: float) -> float:
    return text.number(block[key], f"{where}: {key}") if key in block else default


def _point(text: FemText, row: Sequence[str], n: int, scale: float, properties: Sequence[FemPointProperty]) -> FemPoint:
    where = f"point {n}"
    r, z, reference = _fields(text, row, where, ("0", "0", "0"), needed=2)
    return FemPoint(
        _length(text, r, scale, where),
        _length(text, z, scale, where),
        _referenced(text, reference, properties, f"{where}: its point property"),
    )


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
        number=number,
        r=_length(text, r, scale, where),
        z=_length(text, z, scale, where),
        material=_referenced(text, material, materials, f"{where}: its block property"),
        circuit=_referenced(text, circuit, circuits, f"{where}: its circuit"),
        turns=text.number(turns, f"{where}: its turns"),
        magnetization=text.number(direction, f"{where}: its magnetization"),
        direction_formula=unquoted(formula),
        group=text.integer(group, f"{where}: its group"),
        external=bool(flag & 1),
        default=bool(flag & 2),
    )


def _hole(text: FemText, row: Sequence[str], number: int, scale: float) -> FemLabel:
    r, z, group = _fields(text, row, "hole", ("0", "0", "0"), needed=2)
    return FemLabel(
        number,
        _length(text, r, scale, "hole"),
        _length(text, z, scale, "hole"),
        None,
        group=text.integer(group, "hole: its group"),
    )


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
