"""From faces to parts: faces of one material, magnetization and group that touch.

What surrounds the parts and is not needed: air, the shells of an open boundary, the boundary itself.

The field solver's domain is open, so whatever a FEMM user drew to end theirs is dropped.

The windings: regions of uniform current density, in series with each other or on their own.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from femfit.tables.femm.faces import GRID, FemPiece, connected_faces, without_holes
from femfit.tables.femm.model import Direction, FemBoundary, FemCircuit, FemMaterial, FemModel, Notes, magnet_direction


def volume_mm3(polygon: Polygon) -> float:
    """Of a body of revolution, 2 pi r A (Pappus)."""
    return float(2.0 * math.pi * polygon.centroid.x * polygon.area)


def merge_parts(faces: Sequence[FemPiece]) -> tuple[FemPiece, ...]:
    """Join faces that touch and have material, magnetization and group in common."""
    kinds: dict[tuple[FemMaterial, Direction | None, int], list[FemPiece]] = {}
    for face in sorted(faces, key=lambda face: face.label.number):
        kinds.setdefault((face.material, magnet_direction(face.label), face.label.group), []).append(face)
    parts = []
    for (_, direction, _), alike in kinds.items():
        for polygon, joined in connected_faces(alike):
            parts.append(FemPiece(polygon, tuple(face.label for face in joined), direction))
    return tuple(sorted(parts, key=lambda part: part.label.number))


_SHELL_NAME = re.compile(r"u\d+", re.IGNORECASE)
"""How FEMM's open boundary builder names its materials."""

_DUAL_IMAGE = 3
"""FEMM's number of the boundary that averages A = 0 and a natural one, so that images of either sign cancel."""


_PERIODIC = {4, 5}
"""FEMM's numbers of the boundaries that join two lines; the outside of a Kelvin transformation counts by them alone."""


def drop_surroundings(model: FemModel, faces: Sequence[FemPiece], notes: Notes) -> tuple[FemPiece, ...] | None:
    """The faces of the actuator, without air, boundary shells and holes; None where the drawing is in pieces."""
    meshed = _interior([face for face in faces if face.label.meshed], notes)
    if not meshed:
        return None
    domain = shapely.unary_union([face.polygon for face in meshed], grid_size=GRID)
    for face in faces:
        if not face.label.meshed and Polygon(domain.exterior).contains(face.polygon.representative_point()):
            notes.say("surroundings wall", place=face.label.place)
    shells = _shells(meshed, domain)
    inside = [face for face in meshed if face not in shells]
    parts = tuple(face for face in inside if _is_part(face))
    rim = _off_axis(shapely.unary_union([face.polygon for face in inside], grid_size=GRID))
    for face in parts:
        if face.polygon.distance(rim) <= GRID:
            notes.say("surroundings rim", place=face.label.place)
    _check_boundaries(model, domain, notes)
    return parts


def _interior(meshed: Sequence[FemPiece], notes: Notes) -> list[FemPiece]:
    """The faces of the one piece of the drawing that holds parts, without the outside of a Kelvin transformation."""
    pieces = [joined for _, joined in connected_faces([face for face in meshed if not face.label.external])]
    holding = [piece for piece in pieces if any(_is_part(face) for face in piece)]
    if len(holding) > 1:
        places = "; ".join(next(face for face in piece if _is_part(face)).label.place for piece in holding)
        notes.say("surroundings pieces", pieces=len(holding), places=places)
        return []
    if not holding:
        notes.say("mover nothing")
        return []
    if outside := len(meshed) - len(holding[0]):
        notes.say("kelvin", blocks=outside)
    return holding[0]


def _is_part(face: FemPiece) -> bool:
    material = face.material
    driven = bool(material.current_density) or face.label.circuit is not None
    return face.label.meshed and not face.label.external and (material.magnetic or driven)


def _shells(faces: Sequence[FemPiece], domain: Polygon) -> list[FemPiece]:
    """Shells of made-up permeability, from the rim inwards."""
    remaining = [
        face
        for face in faces
        if _SHELL_NAME.fullmatch(face.material.name)
        and not (face.material.coercivity or face.material.curve or face.label.circuit)
    ]
    shells: list[FemPiece] = []
    front = _off_axis(domain)
    while True:
        reached = [face for face in remaining if face.polygon.intersection(front).length > GRID]
        if not reached:
            return shells
        shells += reached
        remaining = [face for face in remaining if face not in reached]
        front = shapely.union_all([face.polygon.exterior for face in reached])


def _off_axis(domain: Polygon | MultiPolygon) -> shapely.Geometry:
    """The outer boundary without the axis."""
    _, z0, _, z1 = domain.bounds
    outlines = [part.exterior for part in getattr(domain, "geoms", [domain])]
    return shapely.union_all(outlines).difference(LineString([(0.0, z0 - 1.0), (0.0, z1 + 1.0)]))


def _check_boundaries(model: FemModel, domain: Polygon, notes: Notes) -> None:
    """Report what cannot be left out of the boundaries on the domain's lines."""
    rim = _off_axis(domain)
    places: dict[FemBoundary, bool] = {}
    joined = False  # to the outside that a Kelvin transformation draws
    for line in model.lines:
        if line.boundary is not None and not (line.angle == 0 and line.start.r == 0 and line.end.r == 0):
            ends = (Point(line.start.r, line.start.z), Point(line.end.r, line.end.z))
            if any(end.distance(domain) > GRID for end in ends):
                joined |= line.boundary.kind in _PERIODIC
                continue
            outer = all(end.distance(rim) <= GRID for end in ends)
            places[line.boundary] = places.get(line.boundary, True) and outer
    for boundary, outer in places.items():
        faults = {
            "periodic": boundary.kind in _PERIODIC and not (joined and outer),
            "kind": boundary.kind not in {0, 2, _DUAL_IMAGE, *_PERIODIC},
            "drives": boundary.drives,
            "inside": not outer,
        }
        for fault in [name for name, wrong in faults.items() if wrong][:1]:
            notes.say(f"boundary {fault}", name=boundary.name, kind=boundary.kind)


@dataclass(frozen=True)
class FemWinding:
    """Coils in series, with the circuit that carries their current."""

    circuit: FemCircuit
    coils: tuple[FemPiece, ...]

    @property
    def sign(self) -> float:
        """+1 where the first coil is wound as the actuator file's, -1 where a positive current flows the other way."""
        return 1.0 if self.coils[0].turns > 0 else -1.0


def find_windings(faces: Sequence[FemPiece], notes: Notes) -> tuple[FemWinding, ...]:
    """The windings among the faces in the file's order; none for a model without current."""
    before = len(notes.problems)
    chosen = _chosen(faces, notes)
    windings = []
    for circuit in chosen:
        blocks = [face for face in faces if face.label.circuit == circuit]
        _check(blocks, circuit, notes)
        if len(notes.problems) == before:
            windings.append(FemWinding(circuit, _coils(blocks)))
    for face in faces:
        if face.material.current_density:
            notes.say("circuit density", place=face.label.place)
    return () if len(notes.problems) > before else tuple(windings)


def _check(blocks: Sequence[FemPiece], circuit: FemCircuit, notes: Notes) -> None:
    if circuit.kind != 1 and len(blocks) > 1:
        notes.say("circuit parallel", name=circuit.name, blocks=len(blocks))
    for block in blocks:
        material = block.label.material
        facts = {"place": block.label.place, "name": circuit.name}
        if material.magnetic:
            notes.say("circuit magnetic", **facts)
        if block.label.turns == 0:
            notes.say("circuit turns", **facts)


def _chosen(faces: Sequence[FemPiece], notes: Notes) -> list[FemCircuit]:
    """The circuits that are taken: those with current where there are such, all of coils alone."""
    circuits = list(dict.fromkeys(face.label.circuit for face in faces if face.label.circuit is not None))
    coils_alone = not any(face.material.magnetic for face in faces)  # which feel no force but each other's
    live = [circuit for circuit in circuits if circuit.current_A]
    if coils_alone or not live:
        return circuits
    if len(live) < len(circuits):
        notes.say("left-circuits", circuits=", ".join(repr(c.name) for c in circuits if not c.current_A))
    return live


def _coils(blocks: Sequence[FemPiece]) -> tuple[FemPiece, ...]:
    """A coil a block, or several where it is wound around something."""
    return tuple(
        FemPiece(polygon, block.labels, turns=block.label.turns * polygon.area / block.polygon.area)
        for block in sorted(blocks, key=lambda block: block.label.number)
        for polygon in without_holes(block.polygon)
    )
