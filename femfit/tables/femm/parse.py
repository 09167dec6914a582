"""From the parts of a ``.fem`` file to its model: numbers, units, references from one list to another."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from femfit.core.errors import FemFileError
from femfit.core.text import counted
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


class _Parser:
    """Turns the text's fields into the model's objects; what cannot be read is a problem of the text."""

    def __init__(self, text: FemText) -> None:
        self.text = text
        self.unit = text.header.get("lengthunits", "inches").lower()
        if self.unit not in UNITS_MM:
            units = ", ".join(UNITS_MM)
            text.problems.append(f"[LengthUnits] must be one of {units}; instead received {self.unit[:40]!r}.")
        self.scale = UNITS_MM.get(self.unit, 1.0)
        self.held = self.properties("pointprops", FemPointProperty, "point property", "pointname", POINT)
        self.boundaries = self.properties("bdryprops", FemBoundary, "boundary", "bdryname", BOUNDARY)
        self.materials = self.properties("blockprops", FemMaterial, "block property", "blockname", MATERIAL)
        self.circuits = self.properties("circuitprops", FemCircuit, "circuit", "circuitname", CIRCUIT)
        self.points = [self.point(row, n) for n, row in enumerate(text.rows["numpoints"])]

    def properties(
        self, section: str, build: Callable[..., Item], what: str, name_key: str, keys: Mapping[str, str]
    ) -> list[Item]:
        """The objects of a section's blocks."""
        items = []
        for block in self.text.properties.get(section, ()):
            name = unquoted(block.get(name_key, ""))
            values: dict[str, Any] = {}
            for field, key in keys.items():
                if key == "curve" and key in block:
                    values[field] = self.curve(block[key], f"{what} {name!r}")
                elif key in block:
                    read = self.text.integer if field in WHOLE else self.text.number
                    values[field] = read(block[key], f"{what} {name!r}: {key}")
            items.append(build(name, **values))
        return items

    def curve(self, rows: str, where: str) -> tuple[tuple[float, float], ...]:
        """Points B and H."""
        points = [row.split() for row in rows.splitlines()]
        if any(len(row) < 2 for row in points):
            self.text.problems.append(f"{where}: each of its BHPoints must be B and H.")
            return ()
        number = self.text.number
        return tuple((number(b, f"{where}: B"), number(h, f"{where}: H")) for b, h, *_ in points)

    def point(self, row: Sequence[str], n: int) -> FemPoint:
        """A node."""
        where = f"point {n}"
        r, z, reference = self.fields(row, where, ("0", "0", "0"), needed=2)
        held = self.referenced(reference, self.held, f"{where}: its point property")
        return FemPoint(self.length(r, where), self.length(z, where), held)

    def line(self, row: Sequence[str], n: int, *, angled: bool) -> FemLine | None:
        """A segment or an arc; None if its points or its angle are none."""
        where, text, angle_text = f"arc {n}" if angled else f"segment {n}", self.text, "0"
        if angled:
            start, end, angle_text, _, reference = self.fields(row, where, ("0", "0", "0", "-1", "0"), needed=3)
        else:
            start, end, _, reference = self.fields(row, where, ("0", "0", "-1", "0"), needed=2)
        ends = [text.integer(index, f"{where}: its point") for index in (start, end)]
        if any(not 0 <= index < len(self.points) for index in ends):
            there = f"there are points 0 to {len(self.points) - 1}"
            text.problems.append(f"{where} runs from point {start} to {end}; {there}.")
            return None
        angle = text.number(angle_text, f"{where}: its angle")
        if angled and not 0 < angle < 360:
            text.problems.append(f"{where} must span an angle between 0 and 360 degrees; it has {angle:g}.")
            return None
        boundary = self.referenced(reference, self.boundaries, f"{where}: its boundary property")
        return FemLine(self.points[ends[0]], self.points[ends[1]], angle, boundary)

    def label(self, row: Sequence[str], number: int) -> FemLabel:
        """A block label."""
        where, text = f"block label {number}", self.text
        defaults = ("0", "0", "0", "-1", "0", "0", "0", "1", "0", "")
        r, z, material, _, circuit, direction, group, turns, flags, formula = self.fields(row, where, defaults, 3)
        flag = text.integer(flags, f"{where}: its external flag")
        return FemLabel(
            number,
            self.length(r, where),
            self.length(z, where),
            self.referenced(material, self.materials, f"{where}: its block property"),
            self.referenced(circuit, self.circuits, f"{where}: its circuit"),
            text.number(turns, f"{where}: its turns"),
            text.number(direction, f"{where}: its magnetization"),
            unquoted(formula),
            text.integer(group, f"{where}: its group"),
            external=bool(flag & 1),
            default=bool(flag & 2),
        )

    def hole(self, row: Sequence[str], number: int) -> FemLabel:
        """A region without mesh."""
        r, z, group = self.fields(row, "hole", ("0", "0", "0"), needed=2)
        place = self.length(r, "hole"), self.length(z, "hole")
        return FemLabel(number, *place, None, group=self.text.integer(group, "hole: its group"))

    def fields(self, row: Sequence[str], where: str, defaults: Sequence[str], needed: int) -> list[str]:
        """A row's values, with defaults for those that old files leave out."""
        if len(row) < needed:
            self.text.problems.append(f"{where} has {counted(len(row), 'value')}; it needs {needed} at least.")
            return list(defaults)
        return [*row[: len(defaults)], *defaults[len(row) :]]

    def length(self, value: str, where: str) -> float:
        """In mm."""
        length = self.scale * self.text.number(value, f"{where}: its coordinate")
        if abs(length) > LARGEST_MM:
            self.text.problems.append(f"{where} lies {length:g} mm off; lengths must be within {LARGEST_MM:g} mm.")
            return 0.0
        return round(length, DIGITS) + 0.0  # no minus zero

    def referenced(self, index: str, items: Sequence[Item], where: str) -> Item | None:
        """The item that a reference (from 1; 0 or less for none) names."""
        place = self.text.integer(index, where)
        if place > len(items):
            self.text.problems.append(f"{where} is number {place}; the file defines {len(items)}.")
            return None
        return items[place - 1] if place > 0 else None


def parse_fem(content: bytes, source: str) -> FemModel:
    """Read a FEMM magnetics file."""
    text = split_fem(content, source)
    parser, header, rows = _Parser(text), text.header, text.rows
    lines = [parser.line(row, n, angled=False) for n, row in enumerate(rows.get("numsegments", ()))]
    lines += [parser.line(row, n, angled=True) for n, row in enumerate(rows.get("numarcsegments", ()))]
    labels = [parser.label(row, n + 1) for n, row in enumerate(rows["numblocklabels"])]
    labels += [parser.hole(row, len(labels) + n + 1) for n, row in enumerate(rows.get("numholes", ()))]
    model = FemModel(
        source=source,
        version=text.number(header["format"], "[Format]"),
        problem_type=header.get("problemtype", "planar").lower(),
        frequency=text.number(header.get("frequency", "0"), "[Frequency]"),
        unit=parser.unit,
        previous_solution=header.get("prevsoln", ""),
        previous_type=text.integer(header.get("prevtype", "0"), "[PrevType]"),
        comment=unquoted(header.get("comment", "")),
        points=tuple(parser.points),
        lines=tuple(line for line in lines if line is not None),
        labels=tuple(labels),
    )
    if text.problems:
        raise FemFileError(source, list(dict.fromkeys(text.problems)))
    return model
