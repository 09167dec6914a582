"""From the file's coordinates and signs to femfit's: face at z = 0, moving part above it.

Mirroring z leaves A_phi, the current and B_z as they are and turns B_r and F_z round, so that a drawing whose moving
part hangs below is mirrored without a change of the axial magnets or the current. Reversing every magnet and current
reverses B and leaves the force; it is done where the moving magnet points along -z, so that a positive current
attracts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import box

from femfit.tables.femm.faces import GRID, MIN_AREA
from femfit.tables.femm.limits import Direction
from femfit.tables.femm.movers import FemBodies, outline_of
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.outlines import Edge
from femfit.tables.femm.parse import DIGITS
from femfit.tables.femm.parts import FemPart, volume_mm3
from femfit.tables.femm.winding import FemWinding

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
        notes.info(
            "level",
            "The moving part stands level with the fixed parts; distances grow with the file's z.",
            "Let them grow the other way with --mover-side below.",
        )
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
    notes.warn(
        "open-bore",
        "No fixed part lies straight before the moving part, as in an open bore; the distance is counted from the "
        "corner of the fixed parts that its front has passed last.",
        "Name another with --face-mm.",
    )
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
    notes.info(
        "frame",
        f"Distances are counted from the fixed parts' face at the file's z = {frame.face_mm:.9g} mm to the "
        f"nearest point of the moving part; in the file it is {frame.distance_mm:.9g} mm. That face is z = 0 of "
        f"the drawing, {turned}.",
        f"Count from another height with --face-mm: {_listed(heights)}." if heights else "",
    )
    turned_round = [winding.circuit.name for winding in windings if frame.current_sign(winding) < 0]
    if turned_round:
        notes.info(
            "current-sign",
            f"Current and flux linkage have the opposite sign of circuit {', '.join(map(repr, turned_round))}, so that "
            "a positive current attracts the magnet and makes a field along +z.",
        )
    if frame.field_sign < 0:
        notes.info("field-sign", "Every field has the opposite sign of the file's: the magnets are reversed.")
