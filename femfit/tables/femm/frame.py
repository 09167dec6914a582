"""From the file's coordinates and signs to femfit's: face at z = 0, moving part above it, positive current attracts.

Mirroring z leaves A_phi, the current and B_z as they are and turns B_r and F_z round, so that a drawing whose moving
part hangs below is mirrored without a change of magnets or current. Reversing every magnet and current reverses B
and leaves the force; it is done where the moving magnet points along -z, so that a positive current attracts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon, box

from femfit.tables.femm.faces import GRID, MIN_AREA
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.parse import DIGITS
from femfit.tables.femm.parts import FemBodies, FemPart
from femfit.tables.femm.winding import FemWinding

MOST_LISTED = 6
"""Heights that a message names; a drawing with arcs has hundreds of corners."""


@dataclass(frozen=True)
class FemFrame:
    """How the file's drawing is placed in an actuator file.

    The face's height is in the file's z, and ``up`` is +1 where the moving part stands above it there. The field's sign
    is -1 where every magnet and current is reversed, the current's also for turns counted the other way.
    """

    face_mm: float
    up: float
    distance_mm: float
    field_sign: float
    current_sign: float

    def placed(self, polygon: Polygon, *, moving: bool) -> Polygon:
        """A polygon of the file where the actuator file draws it; the moving part at distance 0."""
        base = np.array([0.0, self.face_mm + (self.up * self.distance_mm if moving else 0.0)])
        placed: Polygon = shapely.transform(
            polygon, lambda points: np.round((points - base) * np.array([1.0, self.up]), DIGITS) + 0.0
        )
        return placed


def find_frame(bodies: FemBodies, winding: FemWinding, options: FemOptions, notes: Notes) -> FemFrame | None:
    """The face, the side of the moving part and the file's distance; None if it is not clear where that is counted."""
    fixed = shapely.union_all([*(part.polygon for part in bodies.fixed), winding.polygon])
    moving = shapely.union_all([part.polygon for part in bodies.moving])
    up = _side(fixed, moving, options, notes)
    if up == 0.0:
        return None
    fixed, moving = _upwards(fixed, up), _upwards(moving, up)
    face = _face(fixed, moving, notes) if options.face_mm is None else round(up * options.face_mm, DIGITS)
    # Heights in the file's z from which a distance > 0 can be counted: corners of fixed parts, the nearest first.
    bottom = round(moving.bounds[1], DIGITS)
    corners = {round(float(z), DIGITS) + 0.0 for z in shapely.get_coordinates(fixed)[:, 1]}
    usable = [up * z + 0.0 for z in sorted(corners, reverse=True) if z < bottom]
    if face is None:
        side = "above" if up > 0 else "below"
        notes.problem(
            f"it is not clear from where the distance is counted: no fixed part lies before a moving part that stands "
            f"{side}. Give the other side with --mover-side{_or_a_face(usable)}."
        )
        return None
    distance = round(moving.bounds[1] - face, DIGITS)
    if distance <= 0 and moving.distance(fixed) <= GRID:
        notes.problem("the moving part touches the electromagnet; femfit needs a gap. Move it away in the drawing.")
        return None
    if distance <= 0:
        notes.problem(
            f"the moving part stands at a distance of {distance:g} mm from the face at z = {up * face:g} mm; femfit "
            f"needs a gap. Move it away, or give its side with --mover-side{_or_a_face(usable)}."
        )
        return None
    if options.face_mm is not None and up * face not in usable:
        notes.problem(
            f"--face-mm must be the height of a corner of the electromagnet that the moving part has before it, "
            f"{_listed(usable)} mm in the file's z; instead received {options.face_mm:g}."
        )
        return None
    field = _polarity(bodies)
    current = field * (1.0 if winding.turns > 0 else -1.0)
    frame = FemFrame(up * face + 0.0, up, distance, field, current)
    _say(frame, winding, [] if options.face_mm is not None else [z for z in usable if z != frame.face_mm], notes)
    return frame


def _side(fixed: Polygon, moving: Polygon, options: FemOptions, notes: Notes) -> float:
    """The side that the user says; else the one with a fixed part before it; else by the middles."""
    if options.mover_side != "auto":
        return 1.0 if options.mover_side == "above" else -1.0
    if options.face_mm is None:
        sides = [up for up in (1.0, -1.0) if _before(_upwards(fixed, up), _upwards(moving, up)) is not None]
        if len(sides) == 1:
            return sides[0]
    middle = [0.5 * (shape.bounds[1] + shape.bounds[3]) for shape in (moving, fixed)]
    if abs(middle[0] - middle[1]) <= GRID:
        notes.problem(
            "the moving part stands level with the electromagnet; it is not clear which way it moves off. "
            "Say --mover-side above or below."
        )
        return 0.0
    return 1.0 if middle[0] > middle[1] else -1.0


def _upwards(shape: Polygon, up: float) -> Polygon:
    """The shape with the moving part above."""
    turned: Polygon = shapely.transform(shape, lambda points: points * np.array([1.0, up]) + 0.0)
    return turned


def _face(fixed: Polygon, moving: Polygon, notes: Notes) -> float | None:
    """Height that the distance is counted from; None if the moving part above has passed no fixed part."""
    before = _before(fixed, moving)
    if before is not None:
        return before
    corners = shapely.get_coordinates(fixed)[:, 1]
    passed = corners[corners <= moving.bounds[1] + GRID]
    if not len(passed):
        return None
    notes.warn(
        "open-bore",
        "No fixed part lies straight before the moving part, as in an open bore; the distance is counted from the "
        "corner of the electromagnet that its front has passed last.",
        "Name another with --face-mm.",
    )
    return float(passed.max())


def _before(fixed: Polygon, moving: Polygon) -> float | None:
    """Height of the fixed parts' top, or of what lies before a moving part that reaches into them from above."""
    r0, bottom, r1, _ = moving.bounds
    if fixed.bounds[3] <= bottom + GRID:
        return float(fixed.bounds[3])
    met = fixed.intersection(box(r0, bottom - 1e6, r1, bottom))
    return float(met.bounds[3]) if met.area > MIN_AREA else None


def _or_a_face(usable: Sequence[float]) -> str:
    return f", or the height of its face with --face-mm: {_listed(usable)}" if usable else ""


def _listed(heights: Sequence[float]) -> str:
    shown = [f"{z:.9g}" for z in heights[:MOST_LISTED]]
    return (
        f"{', '.join(shown)} or one of {len(heights) - MOST_LISTED} more"
        if len(heights) > MOST_LISTED
        else (" or ".join(shown))
    )


def _polarity(bodies: FemBodies) -> float:
    """Sign of the moving part's magnetic moment; of the fixed magnets' where it has none."""
    for parts in (bodies.moving, bodies.fixed):
        moment = _moment(parts)
        if moment:
            return 1.0 if moment > 0 else -1.0
    return 1.0


def _moment(parts: Sequence[FemPart]) -> float:
    return sum(part.sign * part.material.remanence * part.volume_mm3 for part in parts)


def _say(frame: FemFrame, winding: FemWinding, others: Sequence[float], notes: Notes) -> None:
    turned = "which is mirrored, for the moving part lies below" if frame.up < 0 else "as it stands"
    notes.info(
        "frame",
        f"Distances are counted from the electromagnet's face at the file's z = {frame.face_mm:.9g} mm to the "
        f"nearest point of the moving part; in the file it is {frame.distance_mm:.9g} mm. That face is z = 0 of "
        f"the drawing, {turned}.",
        f"Count from another height with --face-mm: {_listed(others)}." if others else "",
    )
    if frame.current_sign < 0:
        notes.info(
            "current-sign",
            f"Current and flux linkage have the opposite sign of circuit {winding.circuit.name!r}, so that a "
            "positive current attracts the magnet and makes a field along +z.",
        )
    if frame.field_sign < 0:
        notes.info("field-sign", "Every field has the opposite sign of the file's: the magnets are reversed.")
