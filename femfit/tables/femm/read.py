"""A FEMM model as an actuator file: read, divide into parts, place, write, and read back.

An imported FEMM model as the text of an actuator file, with a comment for everything that it did not hold.

``actuator.toml.j2`` is that file; here are its numbers, names and lists.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import StrictUndefined, Template

from femfit.core.errors import FemFileError
from femfit.core.results import Finding, Result
from femfit.device.keys import scaled
from femfit.device.load import actuator_from_toml
from femfit.device.parts import Actuator
from femfit.tables.femm.faces import Edge, FemPiece, find_faces, with_arcs, without_holes
from femfit.tables.femm.frame import COPPER_FILL, FemFrame, FemWire, find_frame, find_wire
from femfit.tables.femm.model import FemMaterial, FemModel, FemOptions, Notes, with_limits
from femfit.tables.femm.parse import parse_fem
from femfit.tables.femm.parts import (
    FemBodies,
    FemWinding,
    divide,
    drop_surroundings,
    find_windings,
    merge_parts,
    volume_mm3,
)


@dataclass(frozen=True, repr=False)
class ImportedFem(Result):
    """A FEMM model, imported; its own point has femfit's signs, with one current a circuit."""

    source: str
    toml: str
    actuator: Actuator
    currents_A: tuple[float, ...]
    current_signs: tuple[float, ...]
    distance_m: float
    frame: FemFrame
    findings: tuple[Finding, ...]

    @property
    def current_A(self) -> float:  # noqa: N802  the unit, as in actuator files
        """Of the first circuit; zero where there is none."""
        return self.currents_A[0] if self.currents_A else 0.0

    def __str__(self) -> str:
        currents = ", ".join(f"{current:g} A" for current in self.currents_A) or "no current"
        lines = [f"{self.source}: {currents} at {1e3 * self.distance_m:g} mm"]
        ordered = sorted(self.findings, key=lambda finding: finding.severity == "info")
        return "\n".join([*lines, *(f"- {finding.marked}" for finding in ordered)])

    @property
    def data(self) -> dict[str, Any]:
        """What programs read."""
        return {
            "kind": "import-fem",
            "name": self.actuator.name,
            "current_A": self.current_A,
            "currents_A": dict(zip((circuit.name for circuit in self.actuator.circuits), self.currents_A, strict=True)),
            "distance_m": self.distance_m,
            "file_face_mm": self.frame.face_mm,
            "mirrored": self.frame.up < 0,
            "current_sign": self.current_signs[0] if self.current_signs else 1.0,
            "field_sign": self.frame.field_sign,
            "findings": self.findings,
        }


def import_fem_file(path: Path, options: FemOptions | None = None) -> ImportedFem:
    """Read a FEMM ``.fem`` file as an actuator file."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FemFileError(
            str(path), [f"it cannot be read: {error.strerror}. Give the path of a .fem file."]
        ) from error
    return import_fem(content, path.name, options)


def import_fem(content: bytes, source: str, options: FemOptions | None = None) -> ImportedFem:
    """Read a FEMM model as an actuator file."""
    options, notes = options or FemOptions(), Notes(source)
    model = with_limits(parse_fem(content, source), notes)
    before = len(notes.problems)  # of what the drawing holds, in whatever pieces it is
    faces = find_faces(model, notes)
    notes.settle(before)  # what missing faces touch is not known
    inside = drop_surroundings(model, faces, notes)
    windings = find_windings(inside, notes)
    notes.settle(before)
    coils = [coil for winding in windings for coil in winding.coils]
    parts = merge_parts([face for face in inside if face.material.magnetic])
    bodies = divide([*parts, *coils], [face for face in faces if face not in inside], options, notes)
    notes.settle()
    frame = find_frame(bodies, windings, options, notes)
    wires = [[find_wire(coil, notes) for coil in winding.coils] for winding in windings]
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(source).stem).strip("-_")[:60]
    name = stem if re.match(r"[A-Za-z]", stem) else f"fem-{stem}".rstrip("-")
    text = actuator_toml(name, model, bodies, windings, wires, frame)
    notes.say("one-point")
    notes.say("assumed-mass")
    return ImportedFem(
        source=source,
        toml=text,
        actuator=actuator_from_toml(text, f"the actuator file of {source}"),
        currents_A=tuple(frame.current(winding) for winding in windings),
        current_signs=tuple(frame.current_sign(winding) for winding in windings),
        distance_m=scaled(frame.distance_mm),
        frame=frame,
        findings=tuple(notes.findings),
    )


EXACT = 17
"""Digits that print a double without loss: the sweep must hold the file's own point."""

MAGNET_DENSITY, STEEL_DENSITY, COPPER_DENSITY = 7.5, 7.85, 8.96
"""Sintered NdFeB, low-carbon steel and copper in g/cm^3: makers' data sheets agree to 1 %."""

_string = partial(json.dumps, ensure_ascii=False)
"""A TOML basic string."""


def actuator_toml(
    name: str,
    model: FemModel,
    bodies: FemBodies,
    windings: Sequence[FemWinding],
    wires: Sequence[Sequence[FemWire]],
    frame: FemFrame,
) -> str:
    """The text of an actuator file, of windings with a wire for each of their coils."""
    taken = {"air"}
    pieces = [(piece, without_holes(piece.polygon)) for piece in (*bodies.fixed, *bodies.moving)]
    drawn = iter(with_arcs([polygon for _, polygons in pieces for polygon in polygons], model.lines))
    outline_of = {
        id(piece): [frame.placed(next(drawn), moving=piece in bodies.moving) for _ in polygons]
        for piece, polygons in pieces
    }
    fixed, moving = ([piece for piece in body if not piece.turns] for body in (bodies.fixed, bodies.moving))
    regions = partial(_regions, frame, outline_of, taken)
    facts: dict[str, Any] = {"fixed": [region for part in fixed for region in regions(part)]}
    coils = [
        {
            "name": _free_name(winding.circuit.name, taken),
            "origin": f"circuit {winding.circuit.name!r}: {'; '.join(label.place for label in coil.labels)}",
            "outline": outline_of[id(coil)][0],
            "turns": abs(coil.turns),
            "sign": "-" if coil.turns * winding.sign < 0 else "",
            "wire": wire,
            "moves": any(coil is piece for piece in bodies.moving),
        }
        for winding, of_winding in zip(windings, wires, strict=True)
        for coil, wire in zip(winding.coils, of_winding, strict=True)
    ]
    names, free = iter(coils), set[str]()
    circuits = {
        _free_name(winding.circuit.name, free): [_string("{sign}{name}".format(**next(names))) for _ in winding.coils]
        for winding in windings
    }
    axes = [f"[{number(frame.current(winding), EXACT)}]" for winding in windings]
    pairs = (f"{name} = {values}" for name, values in zip(circuits, axes, strict=True))
    facts |= {
        "coils": coils,
        "moving": [region for part in moving for region in regions(part)],
        "circuits": circuits if len(coils) > 1 else {},  # else the circuit is the coil
        "currents": axes[0] if len(axes) == 1 else f"{{ {', '.join(pairs)} }}" if axes else "",
        "distances": f"[{number(frame.distance_mm, EXACT)}]",
        "comment": f" ({plain(model.comment)})" if model.comment not in {"", "Add comments here."} else "",
        "materials": dict.fromkeys(part.material for part in (*fixed, *moving)),
        "mass": _mass(bodies.moving),
        "supply": _supply(windings, wires, frame),
        "string": _string,
        **{function.__name__: function for function in (number, plain, rectangle, corners, curve)},
    }
    text = (files("femfit.tables.femm") / "actuator.toml.j2").read_text(encoding="utf-8")
    template = Template(
        text, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined
    )
    return str(template.render(facts, name=name, model=model, frame=frame, windings=windings))


def number(value: float, digits: int = 12) -> str:
    """The shortest text of a number with so many significant digits; whole numbers without a point."""
    rounded = float(f"{value:.{digits}g}") + 0.0
    return str(int(rounded)) if rounded.is_integer() and abs(rounded) < 1e15 else repr(rounded)


def plain(text: str) -> str:
    """On one line of a comment."""
    return "".join(character if character.isprintable() else " " for character in text)


def rectangle(outline: Sequence[Edge]) -> tuple[float, ...]:
    """Both radii and both heights of an outline that is a box; nothing of another one."""
    radii, heights = ({point[k] for point in outline} for k in (0, 1))
    box = len(outline) == 4 and len(radii) == 2 and len(heights) == 2 and not any(angle for _, _, angle in outline)
    return (*sorted(radii), *sorted(heights)) if box else ()


def corners(outline: Sequence[Edge]) -> list[str]:
    """The corners of an outline, each with the angle of its arc where it has one."""
    return [f"[{', '.join(map(number, edge if edge[2] else edge[:2]))}]" for edge in outline]


def curve(material: FemMaterial) -> list[tuple[str, list[str]]]:
    """The keys of a magnetisation curve with their numbers."""
    columns = zip(*material.curve, strict=True)
    return [
        (key, [number(value, EXACT) for value in values])
        for key, values in zip(("B_T", "H_A_per_m"), columns, strict=True)
    ]


def _free_name(name: str, taken: set[str]) -> str:
    """A region's name from a block's: letters, digits, - and _, beginning with a letter, not yet taken."""
    stem = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:50]
    stem = stem if re.match(r"[a-z]", stem) else f"part_{stem}".rstrip("_")
    numbered = (f"{stem}_{n}" if n > 1 else stem for n in range(1, len(taken) + 2))
    free = next(candidate for candidate in numbered if candidate not in taken)
    taken.add(free)
    return free


def _regions(
    frame: FemFrame, outline_of: dict[int, list[list[Edge]]], taken: set[str], part: FemPiece
) -> Iterator[dict[str, Any]]:
    """The tables of the actuator file for a part."""
    outlines = outline_of[id(part)]
    origin = "; ".join(f"{label.place}, group {label.group}" for label in part.labels)
    origin += f"; a closed ring, cut into {len(outlines)} pieces" if len(outlines) > 1 else ""
    r, z = frame.direction(part) or (0.0, 0.0)
    direction = f"[{number(r)}, {number(z)}]"
    if r == 0.0 or z == 0.0:
        direction = f'"{"-" if r + z < 0 else "+"}{"z" if r == 0.0 else "r"}"' if part.direction else ""
    for outline in outlines:
        name = _free_name(part.material.name, taken)
        yield {"name": name, "origin": origin, "outline": outline, "material": part.material, "direction": direction}


def _mass(moving: Sequence[FemPiece]) -> str:
    """The moving part's mass in g, and where it is from."""
    densities = [
        *((MAGNET_DENSITY if piece.direction else STEEL_DENSITY, piece) for piece in moving if piece.material.magnetic),
        *((COPPER_FILL * COPPER_DENSITY, coil) for coil in moving if coil.turns),
    ]
    weights = [(density, volume_mm3(piece.polygon) * 1e-3) for density, piece in densities]
    mass = sum(density * volume for density, volume in weights)
    shown = " + ".join(f"{volume:.5g} cm^3 x {density:g} g/cm^3" for density, volume in weights if volume)
    return f"{number(mass, 5)} # ASSUMED density: {shown}; weigh the body and correct it"


def _supply(
    windings: Sequence[FemWinding], wires: Sequence[Sequence[FemWire]], frame: FemFrame
) -> tuple[float, float] | None:
    """Voltages of the resistances that the sweep's currents need; None without a winding."""
    if not windings:
        return None
    resistances = [sum(wire.resistance_ohm for wire in of_winding) for of_winding in wires]
    needed = [r * frame.current(winding) for r, winding in zip(resistances, windings, strict=True)]
    low, high = min(0.0, *needed), max(0.0, *needed)
    return low, high if high > low else max(resistances)
