"""From the file's coordinates and signs to femfit's: face at z = 0, moving part above it.

Mirroring z leaves A_phi, the current and B_z as they are and turns B_r and F_z round, so that a drawing whose moving
part hangs below is mirrored without a change of the axial magnets or the current. Reversing every magnet and current
reverses B and leaves the force; it is done where the moving magnet points along -z, so that a positive current
attracts.

The wire of the windings: the file's, or an assumption that is called one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import box

from femfit.device.parts import smallest_winding_area, wire_resistance
from femfit.tables.femm.faces import GRID, MIN_AREA, Edge, FemPiece
from femfit.tables.femm.model import Direction, FemOptions, Notes
from femfit.tables.femm.parse import DIGITS
from femfit.tables.femm.parts import Body, FemBodies, FemWinding, volume_mm3


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

    def direction(self, part: FemPiece) -> Direction | None:
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
    fixed, moving = _upwards(bodies.fixed, up), _upwards(bodies.moving, up)
    face = _face(fixed, moving, notes) if options.face_mm is None else up * options.face_mm
    face = round(face, DIGITS)
    distance = round(moving.bounds[1] - face, DIGITS) + 0.0
    frame = FemFrame(up * face + 0.0, up, distance, _polarity(bodies))
    turned = "which is mirrored, for the moving part lies below" if up < 0 else "as it stands"
    notes.say("frame", face=frame.face_mm, distance=distance, turned=turned)
    if reversed_ones := [repr(winding.circuit.name) for winding in windings if frame.current_sign(winding) < 0]:
        notes.say("current-sign", circuits=", ".join(reversed_ones))
    if frame.field_sign < 0:
        notes.say("field-sign")
    return frame


def _side(bodies: FemBodies, options: FemOptions, notes: Notes) -> float:
    """The side that the user says; else the one with a fixed part before it; else by the middles."""
    if options.mover_side != "auto":
        return 1.0 if options.mover_side == "above" else -1.0
    sides = [up for up in (1.0, -1.0) if _before(_upwards(bodies.fixed, up), _upwards(bodies.moving, up)) is not None]
    if options.face_mm is None and len(sides) == 1:
        return sides[0]
    fixed, moving = (0.5 * sum(_upwards(body, 1.0).bounds[1::2]) for body in (bodies.fixed, bodies.moving))
    if abs(moving - fixed) <= GRID:
        notes.say("level")
        return 1.0
    return 1.0 if moving > fixed else -1.0


def _upwards(body: Body, up: float) -> shapely.Geometry:
    """A body's pieces together, with the moving part above."""
    together = shapely.union_all([piece.polygon for piece in body])
    return shapely.transform(together, lambda points: points * [1.0, up] + 0.0)


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


def _polarity(bodies: FemBodies) -> float:
    """Sign of the moving part's axial magnetic moment; of the fixed magnets' where it has none."""
    moments = [
        sum(part.direction[1] * part.material.remanence * volume_mm3(part.polygon) for part in parts if part.direction)
        for parts in (bodies.moving, bodies.fixed)
    ]
    return math.copysign(1.0, next(filter(None, moments), 1.0))


PLAIN_WIRE = 3
"""``LamType`` of round magnet wire; it and above are wound, below are solid."""

COPPER_FILL = 0.5
"""Copper in a winding's section, usual for round wire (geometry/plunger-solenoid.toml has 0.53)."""


@dataclass(frozen=True)
class FemWire:
    """What an actuator file says of the wire; its resistance at 20 degC follows from the diameter."""

    diameter_mm: float
    origin: str
    resistance_ohm: float


def find_wire(coil: FemPiece, notes: Notes) -> FemWire:
    """A winding's wire and resistance."""
    material = coil.material
    diameter, origin = material.wire_diameter_mm, f"WireD of {material.name!r}"
    wire = material.lamination_type == PLAIN_WIRE and diameter > 1e-3  # the finest that is drawn has 0.01 mm
    if not wire or smallest_winding_area(abs(coil.turns), diameter) > coil.polygon.area:
        section = COPPER_FILL * coil.polygon.area / abs(coil.turns)
        diameter = float(f"{2.0 * math.sqrt(section / math.pi):.3g}")
        origin = f"ASSUMED: the file has no wire that fits; {100 * COPPER_FILL:g} % of the winding is copper"
        notes.say("assumed-wire", place=coil.label.place, diameter=diameter, copper=100 * COPPER_FILL)
    resistance = wire_resistance(abs(coil.turns), coil.polygon.centroid.x * 1e-3, diameter * 1e-3)
    return FemWire(diameter, origin, resistance)
