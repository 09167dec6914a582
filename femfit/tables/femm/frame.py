"""From the file's coordinates and signs to femfit's: face at z = 0, moving part above it.

Mirroring z leaves A_phi, the current and B_z as they are and turns B_r and F_z round, so that a drawing whose moving
part hangs below is mirrored without a change of the axial magnets or the current. Reversing every magnet and current
reverses B and leaves the force; it is done where the moving magnet points along -z, so that a positive current
attracts.

A winding that touches what moves against it gives way by a clearance that hardly changes its field.

Everything that was found in a FEMM model, and what the user said beside it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import shapely
from shapely import Polygon, box

from femfit.tables.femm.faces import GRID, MIN_AREA, ArcFinder, Edge, without_holes
from femfit.tables.femm.model import Direction, FemModel
from femfit.tables.femm.movers import Body, FemBodies, outline_of
from femfit.tables.femm.options import FemOptions, Notes
from femfit.tables.femm.parse import DIGITS
from femfit.tables.femm.parts import FemPart, volume_mm3
from femfit.tables.femm.winding import FemCoil, FemWinding, FemWire

MOST_LISTED = 6
"""Heights that a message names; a drawing with arcs has hundreds of corners."""


@dataclass(frozen=True)
class FemFrame:
    """How the file's drawing is placed in an actuator file.

    The face's height is in the file's z, and ``up`` is +1 where growing distances go to growing z there. The field's
    sign is -1 where every magnet and current is reversed.
    """

    face_mm: float
    up: float
    distance_mm: float
    field_sign: float

    def placed(self, outline: Sequence[Edge], *, moving: bool) -> list[Edge]:
        """An outline of the file where the actuator file draws it; the moving part at distance 0."""
        base = self.face_mm + (self.up * self.distance_mm if moving else 0.0)
        return [(r, round((z - base) * self.up, DIGITS) + 0.0, self.up * angle + 0.0) for r, z, angle in outline]

    def direction(self, part: FemPart) -> Direction | None:
        """The part's magnetization in the actuator file."""
        if part.direction is None:
            return None
        r, z = part.direction  # a mirrored axial vector keeps its z and turns its r round
        return self.field_sign * self.up * r + 0.0, self.field_sign * z + 0.0

    def current(self, winding: FemWinding) -> float:
        """The file's own current with femfit's sign."""
        return self.current_sign(winding) * winding.circuit.current_A + 0.0

    def current_sign(self, winding: FemWinding) -> float:
        """The field's sign, the other one for turns counted the other way."""
        return self.field_sign * winding.sign


def find_frame(bodies: FemBodies, windings: Sequence[FemWinding], options: FemOptions, notes: Notes) -> FemFrame:
    """The face, the side of the moving part and the file's distance."""
    up = _side(bodies, options, notes)
    fixed, moving = _upwards(outline_of(bodies.standing), up), _upwards(outline_of(bodies.mover), up)
    face = _face(fixed, moving, notes) if options.face_mm is None else up * options.face_mm
    face = round(face, DIGITS)
    corners = sorted({round(float(z), DIGITS) + 0.0 for z in shapely.get_coordinates(fixed)[:, 1]}, reverse=True)
    distance = round(moving.bounds[1] - face, DIGITS) + 0.0
    frame = FemFrame(up * face + 0.0, up, distance, _polarity(bodies))
    nearest = sorted((z for z in corners if z != face), key=lambda z: abs(moving.bounds[1] - z))
    _say(frame, windings, [] if options.face_mm is not None else [up * z + 0.0 for z in nearest], notes)
    return frame


def _side(bodies: FemBodies, options: FemOptions, notes: Notes) -> float:
    """The side that the user says; else the one with a fixed part before it; else by the middles."""
    if options.mover_side != "auto":
        return 1.0 if options.mover_side == "above" else -1.0
    fixed, moving = outline_of(bodies.standing), outline_of(bodies.mover)
    if options.face_mm is None:
        sides = [up for up in (1.0, -1.0) if _before(_upwards(fixed, up), _upwards(moving, up)) is not None]
        if len(sides) == 1:
            return sides[0]
    middle = [0.5 * (shape.bounds[1] + shape.bounds[3]) for shape in (moving, fixed)]
    if abs(middle[0] - middle[1]) <= GRID:
        notes.say("level")
        return 1.0
    return 1.0 if middle[0] > middle[1] else -1.0


def _upwards(shape: shapely.Geometry, up: float) -> shapely.Geometry:
    """The shape with the moving part above."""
    return shapely.transform(shape, lambda points: points * [1.0, up] + 0.0)


def _face(fixed: shapely.Geometry, moving: shapely.Geometry, notes: Notes) -> float:
    """Height that the distance is counted from."""
    before = _before(fixed, moving)
    if before is not None:
        return before
    corners = shapely.get_coordinates(fixed)[:, 1]
    passed = corners[corners <= moving.bounds[1] + GRID]
    if not len(passed):  # its front has passed all of them, as a long plunger's: distances are negative
        return float(fixed.bounds[3])
    notes.say("open-bore")
    return float(passed.max())


def _before(fixed: shapely.Geometry, moving: shapely.Geometry) -> float | None:
    """Height of the fixed parts' top, or of what lies before a moving part that reaches into them from above."""
    r0, bottom, r1, _ = moving.bounds
    if fixed.bounds[3] <= bottom + GRID:
        return float(fixed.bounds[3])
    met = fixed.intersection(box(r0, bottom - 1e6, r1, bottom))
    return float(met.bounds[3]) if met.area > MIN_AREA else None


def _listed(heights: Sequence[float]) -> str:
    shown = [f"{z:.9g}" for z in heights[:MOST_LISTED]]
    return (
        f"{', '.join(shown)} or one of {len(heights) - MOST_LISTED} more"
        if len(heights) > MOST_LISTED
        else (" or ".join(shown))
    )


def _polarity(bodies: FemBodies) -> float:
    """Sign of the moving part's axial magnetic moment; of the fixed magnets' where it has none."""
    for parts in (bodies.moving, bodies.fixed):
        moment = sum(
            part.direction[1] * part.material.remanence * volume_mm3(part.polygon) for part in parts if part.direction
        )
        if moment:
            return 1.0 if moment > 0 else -1.0
    return 1.0


def _say(frame: FemFrame, windings: Sequence[FemWinding], heights: Sequence[float], notes: Notes) -> None:
    turned = "which is mirrored, for the moving part lies below" if frame.up < 0 else "as it stands"
    remedy = f"Count from another height with --face-mm: {_listed(heights)}." if heights else ""
    notes.say("frame", face=frame.face_mm, distance=frame.distance_mm, turned=turned, heights=remedy)
    turned_round = [repr(winding.circuit.name) for winding in windings if frame.current_sign(winding) < 0]
    if turned_round:
        notes.say("current-sign", circuits=", ".join(turned_round))
    if frame.field_sign < 0:
        notes.say("field-sign")


CLEARANCE = 0.02
"""Of the winding's smaller side: the field changes less than by the tolerance of a winding's mean radius."""


def trim_windings(
    windings: Sequence[FemWinding], bodies: FemBodies, notes: Notes
) -> tuple[tuple[FemWinding, ...], FemBodies]:
    """Windings that touch the other body keep clear of it, in the windings and in the bodies alike."""
    trimmed = {id(coil): _trimmed(coil, bodies.mover, notes) for coil in bodies.fixed_coils}
    standing: Body = [*bodies.fixed, *(trimmed[id(coil)] for coil in bodies.fixed_coils)]
    trimmed |= {id(coil): _trimmed(coil, standing, notes) for coil in bodies.moving_coils}
    return (
        tuple(replace(winding, coils=tuple(trimmed[id(coil)] for coil in winding.coils)) for winding in windings),
        replace(
            bodies,
            fixed_coils=tuple(trimmed[id(coil)] for coil in bodies.fixed_coils),
            moving_coils=tuple(trimmed[id(coil)] for coil in bodies.moving_coils),
        ),
    )


def _trimmed(coil: FemCoil, obstacles: Body, notes: Notes) -> FemCoil:
    """The winding with all its turns on a section that keeps clear of the others, if it touches one of them."""
    contacts = [obstacle.polygon.intersection(coil.polygon) for obstacle in obstacles]
    touching = shapely.union_all([contact for contact in contacts if not contact.is_empty])
    if touching.is_empty:
        return coil
    r0, z0, r1, z1 = coil.polygon.bounds
    clearance = round(CLEARANCE * min(r1 - r0, z1 - z0), DIGITS)
    section = coil.polygon.difference(_around(touching, coil.polygon, clearance), grid_size=GRID)
    if not isinstance(section, Polygon) or section.interiors or section.is_empty:
        notes.say("circuit contact", place=coil.labels[0].place)
        return coil
    notes.say("trimmed-winding", place=coil.labels[0].place, clearance=clearance)
    return replace(coil, polygon=section)


def _around(touching: shapely.Geometry, winding: Polygon, clearance: float) -> shapely.Geometry:
    """What a winding gives up: along straight sides its whole length, for the other body slides along them."""
    r0, z0, r1, z1 = winding.bounds
    strips = []
    for line in shapely.get_parts(shapely.get_parts(touching)):
        ends = shapely.get_coordinates(line)
        for (r, z), (r_next, z_next) in pairwise(ends.tolist()):
            if abs(r_next - r) <= GRID:
                strips.append(box(r - clearance, z0, r + clearance, z1))
            elif abs(z_next - z) <= GRID:
                strips.append(box(r0, z - clearance, r1, z + clearance))
        strips.append(line.buffer(clearance))
    return shapely.union_all(strips)


@dataclass(frozen=True)
class FemDevice:
    """A model's parts and windings, placed; wires are by the id of their coil."""

    name: str
    model: FemModel
    bodies: FemBodies
    windings: tuple[FemWinding, ...]
    wires: Mapping[int, FemWire]
    frame: FemFrame
    options: FemOptions

    @property
    def distances_mm(self) -> list[float]:
        """Of the sweep."""
        return own_point_added(self.options.distances_mm, self.frame.distance_mm)

    def currents(self, winding: FemWinding) -> list[float]:
        """Of the sweep in A, in one circuit."""
        return own_point_added(self.options.currents_A, self.frame.current(winding))

    def outlines(self) -> dict[int, list[list[Edge]]]:
        """Outlines in the actuator file of each part and coil, by its id."""
        fixed, moving = self.bodies.standing, self.bodies.mover
        simple = {id(piece): without_holes(piece.polygon) for piece in [*fixed, *moving]}
        every = [polygon for pieces in simple.values() for polygon in pieces]
        finder = ArcFinder(self.model.lines, every, self.options.arc_degrees)
        return {
            id(piece): [self.frame.placed(finder.outline(polygon), moving=moves) for polygon in simple[id(piece)]]
            for moves, pieces in ((False, fixed), (True, moving))
            for piece in pieces
        }


def own_point_added(values: Sequence[float], drawn: float) -> list[float]:
    """An axis with the file's own value in its place."""
    return sorted([*(value for value in values if not math.isclose(value, drawn, rel_tol=1e-9, abs_tol=1e-9)), drawn])
