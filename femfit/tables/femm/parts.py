"""From faces to parts: faces of one material, magnetization and group that touch.

What surrounds the parts and is not needed: air, the shells of an open boundary, the boundary itself.

The field solver's domain is open, so whatever a FEMM user drew to end theirs is dropped.

The windings: regions of uniform current density, in series with each other or on their own.

Which parts and windings move: as the user says, or what only can.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from femfit.tables.femm.faces import GRID, FemPiece, connected_faces, without_holes
from femfit.tables.femm.model import FemBoundary, FemCircuit, FemModel, FemOptions, Notes, magnet_direction


def volume_mm3(polygon: Polygon) -> float:
    """Of a body of revolution, 2 pi r A (Pappus)."""
    return float(2.0 * math.pi * polygon.centroid.x * polygon.area)


def merge_parts(faces: Sequence[FemPiece]) -> list[FemPiece]:
    """Join faces that touch and have material, magnetization and group in common."""
    kinds: dict[Any, list[FemPiece]] = {}
    for face in sorted(faces, key=lambda face: face.label.number):
        kinds.setdefault((face.material, magnet_direction(face.label), face.label.group), []).append(face)
    parts = [
        FemPiece(polygon, tuple(face.label for face in joined), direction)
        for (_, direction, _), alike in kinds.items()
        for polygon, joined in connected_faces(alike)
    ]
    return sorted(parts, key=lambda part: part.label.number)


_SHELL_NAME = re.compile(r"u\d+", re.IGNORECASE)
"""How FEMM's open boundary builder names its materials."""

_DUAL_IMAGE = 3
"""FEMM's number of the boundary that averages A = 0 and a natural one, so that images of either sign cancel."""

_PERIODIC = {4, 5}
"""FEMM's numbers of the boundaries that join two lines; the outside of a Kelvin transformation counts by them alone."""


def drop_surroundings(model: FemModel, faces: Sequence[FemPiece], notes: Notes) -> list[FemPiece]:
    """The faces of the actuator, without air, boundary shells and holes."""
    solved = [face for face in faces if face.label.meshed]
    meshed = _interior(solved, notes)
    domain = shapely.unary_union([face.polygon for face in meshed], grid_size=GRID)
    for face in faces:
        if not face.label.meshed and Polygon(domain.exterior).contains(face.polygon.representative_point()):
            notes.say("surroundings wall", place=face.label.place)
    shells = _shells(meshed, domain)
    inside = [face for face in meshed if face not in shells]
    parts = list(filter(_is_part, inside))
    rim = _off_axis(shapely.unary_union([face.polygon for face in inside], grid_size=GRID))
    for face in parts:
        if face.polygon.distance(rim) <= GRID:
            notes.say("surroundings rim", place=face.label.place)
    joined = _check_boundaries(model, domain, notes)
    if outside := len(solved) - len(meshed):
        notes.say("kelvin" if joined else "kelvin apart", blocks=outside)
    return parts


def _interior(meshed: Sequence[FemPiece], notes: Notes) -> list[FemPiece]:
    """The faces of the one piece of the drawing that holds parts, without the outside of a Kelvin transformation."""
    pieces = [joined for _, joined in connected_faces([face for face in meshed if not face.label.external])]
    holding = [piece for piece in pieces if any(map(_is_part, piece))]
    if len(holding) > 1:
        places = "; ".join(next(filter(_is_part, piece)).label.place for piece in holding)
        notes.stop("surroundings pieces", pieces=len(holding), places=places)
    if not holding:
        notes.stop("mover nothing")
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
    while reached := [face for face in remaining if face.polygon.intersection(front).length > GRID]:
        shells += reached
        remaining = [face for face in remaining if face not in reached]
        front = shapely.union_all([face.polygon.exterior for face in reached])
    return shells


def _off_axis(domain: Polygon | MultiPolygon) -> shapely.Geometry:
    """The outer boundary without the axis."""
    _, z0, _, z1 = domain.bounds
    outlines = [part.exterior for part in getattr(domain, "geoms", [domain])]
    return shapely.union_all(outlines).difference(LineString([(0.0, z0 - 1.0), (0.0, z1 + 1.0)]))


def _check_boundaries(model: FemModel, domain: Polygon, notes: Notes) -> bool:
    """Report what cannot be left out of the boundaries on the domain's lines; whether any joins it to an outside."""
    rim = _off_axis(domain)
    places: dict[FemBoundary, bool] = {}
    joined = False  # to the outside that a Kelvin transformation draws
    for line in model.lines:
        if line.boundary is None or (line.angle == line.start.r == line.end.r == 0):
            continue
        ends = (Point(line.start.r, line.start.z), Point(line.end.r, line.end.z))
        if any(end.distance(domain) > GRID for end in ends):
            joined |= line.boundary.kind in _PERIODIC
        else:
            outer = all(end.distance(rim) <= GRID for end in ends)
            places[line.boundary] = places.get(line.boundary, True) and outer
    for boundary, outer in places.items():
        sources = {0: (boundary.a0, boundary.a1, boundary.a2), 2: (boundary.c1,)}
        faults = {
            "periodic": boundary.kind in _PERIODIC and not (joined and outer),
            "kind": boundary.kind not in {0, 2, _DUAL_IMAGE, *_PERIODIC},
            "drives": any(sources.get(boundary.kind, ())),
            "inside": not outer,
        }
        for fault in [name for name, wrong in faults.items() if wrong][:1]:
            notes.say(f"boundary {fault}", name=boundary.name, kind=boundary.kind)
    return joined


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
    """The windings in the file's order, a coil a block, or several where it is wound around something.

    Those with current are taken where there are such, and all of coils alone, which feel no force but each other's.
    """
    circuits = list(dict.fromkeys(face.label.circuit for face in faces if face.label.circuit is not None))
    idle = [circuit for circuit in circuits if not circuit.current_A]
    if len(idle) < len(circuits) and any(face.material.magnetic for face in faces):
        circuits = [circuit for circuit in circuits if circuit not in idle]
        if idle:
            notes.say("left-circuits", circuits=", ".join(repr(circuit.name) for circuit in idle))
    windings = []
    for circuit in circuits:
        blocks = [face for face in faces if face.label.circuit == circuit]
        if circuit.kind != 1 and len(blocks) > 1:
            notes.say("circuit parallel", name=circuit.name, blocks=len(blocks))
        for block in blocks:
            faults = {"circuit magnetic": block.material.magnetic, "circuit turns": block.label.turns == 0}
            for fault in [name for name, wrong in faults.items() if wrong]:
                notes.say(fault, place=block.label.place, name=circuit.name)
        coils = [
            FemPiece(polygon, block.labels, turns=block.label.turns * polygon.area / block.polygon.area)
            for block in sorted(blocks, key=lambda block: block.label.number)
            for polygon in without_holes(block.polygon)
        ]
        windings.append(FemWinding(circuit, tuple(coils)))
    for face in faces:
        if face.material.current_density:
            notes.say("circuit density", place=face.label.place)
    return tuple(windings)


Body = Sequence[FemPiece]


@dataclass(frozen=True)
class FemBodies:
    """Parts and windings, divided."""

    fixed: tuple[FemPiece, ...]
    moving: tuple[FemPiece, ...]


def divide(pieces: Body, air: Body, options: FemOptions, notes: Notes) -> FemBodies:
    """Divide parts and windings into fixed and moving ones."""
    bodies = _connected(pieces)
    faults = {
        "mover nothing": not pieces,
        "mover field": not _wound(pieces) and not _magnet(pieces),
        "mover alone": len(pieces) == 1,
        "mover touching": len(bodies) == 1,
    }
    for fault in (name for name, wrong in faults.items() if wrong):
        notes.stop(fault, places=" and ".join(piece.place for piece in pieces))
    moving = _named(bodies, options.moving_labels, notes) if options.moving_labels else _inferred(bodies, notes)
    # Non-magnetic blocks of its group join what moves, where that is in pieces
    groups = {piece.label.group for piece in moving} - {0} if len(_connected(moving)) > 1 else set()
    joining = [face for face in air if face.label.meshed and face.label.group in groups]
    fixed = tuple(piece for piece in pieces if piece not in moving)
    return FemBodies(fixed, (*(piece for piece in pieces if piece in moving), *joining))


def _named(bodies: Sequence[Body], labels: Sequence[int], notes: Notes) -> Body:
    chosen = [body for body in bodies if _numbers(body) & set(labels)]
    unknown = [str(number) for number in labels if not any(number in _numbers(body) for body in bodies)]
    if unknown:
        notes.stop("mover unknown", names=" or ".join(unknown), candidates=_candidates(bodies))
    if len(chosen) == len(bodies):
        notes.stop("mover everything", candidates=_candidates(bodies))
    return [piece for body in chosen for piece in body]


def _inferred(bodies: Sequence[Body], notes: Notes) -> Body:
    """The body that alone can be the moving one; of two, the one that is usually moved.

    A warning says where another body could move as well.
    """
    grouped = [body for body in bodies if any(piece.label.group for piece in body)]
    rules: tuple[tuple[Callable[[Body], bool], str], ...] = (
        (lambda body: grouped == [body] and all(piece.label.group for piece in body), "with a group above 0"),
        (_magnet, "with a magnet"),
        (lambda body: _clear(body, bodies), "clear above or below the windings"),
        (lambda body: any(piece.polygon.bounds[0] <= GRID for piece in body), "on the axis"),
        (lambda _: True, "that does not touch a winding"),
    )
    bare = [body for body in bodies if not _wound(body)]
    matches = ((list(filter(rule, bare)), f"the only body {reason}") for rule, reason in rules)
    only = next(((bodies, reason) for bodies, reason in matches if len(bodies) == 1), ([], ""))
    matching, reason = _of_two(bodies) if len(bodies) == 2 else only
    if not matching:
        notes.stop("mover unclear", candidates=_candidates(bodies))
    moving = matching[0]
    alternatives = [body for body in bodies if body is not moving]
    key = "mover chosen" if any(not _wound(body) or _wound(moving) for body in alternatives) else "mover"
    names, options = " and ".join(piece.place for piece in moving), " or ".join(map(_option, alternatives))
    notes.say(key, names=names, reason=reason, options=options)
    return moving


def _of_two(bodies: Sequence[Body]) -> tuple[list[Body], str]:
    """One of two bodies: only their motion against each other counts, and the other one may be named instead."""
    wound, bare = ([body for body in bodies if _wound(body) == turns] for turns in (True, False))
    if len(bare) != len(wound):
        smaller = min(bodies, key=lambda body: sum(volume_mm3(piece.polygon) for piece in body))
        return [smaller], "the smaller one of two bodies"
    iron = any(piece.material.curve or not _magnet([piece]) for piece in bare[0])
    if iron and _magnet(bare[0]) and all(piece.turns for piece in wound[0]):
        return wound, "a winding before a magnet with its iron, as in a voice coil"
    return bare, "the only body that does not touch a winding"


def _numbers(body: Body) -> set[int]:
    return {label.number for piece in body for label in piece.labels}


def _option(body: Body) -> str:
    """The option that names a body and no other."""
    return f"--moving-label {min(_numbers(body))}"


def _candidates(bodies: Sequence[Body]) -> str:
    return "".join(f"\n    {_option(body)} for {' with '.join(piece.place for piece in body)}" for body in bodies)


def _wound(body: Body) -> bool:
    return any(piece.turns for piece in body)


def _magnet(body: Body) -> bool:
    return any(piece.direction is not None for piece in body)


def _clear(body: Body, bodies: Sequence[Body]) -> bool:
    """Whether a body stands above or below all windings."""
    _, low, _, high = shapely.total_bounds([piece.polygon for rival in bodies for piece in rival if piece.turns])
    _, bottom, _, top = shapely.total_bounds([piece.polygon for piece in body])
    return bool(bottom >= high or top <= low)


def _connected(pieces: Body) -> list[Body]:
    """Pieces that touch each other, together."""
    bodies: list[Body] = []
    for piece in pieces:
        joined = [
            body for body in bodies if any(piece.polygon.distance(neighbour.polygon) <= GRID for neighbour in body)
        ]
        bodies = [body for body in bodies if body not in joined]
        bodies.append([*(neighbour for body in joined for neighbour in body), piece])
    return bodies
