"""The drawing's faces: lines split where they meet, closed loops found, each block label in its face.

Arcs become chords here, whose ends lie on the arc; :func:`with_arcs` finds the
arcs again. The spacing that the file asks of FEMM's own mesh is not used. Lines are split on a
grid of a nanometre, which joins a corner to the line that it was drawn on.

Outlines of faces: without holes, without needless corners, and with the file's arcs where chords stood for them.
"""

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, MultiLineString, Point, Polygon, STRtree, box

from femfit.device.outlines import arc_circle, arc_points
from femfit.tables.femm.model import Direction, FemLabel, FemLine, FemMaterial, FemModel, Notes
from femfit.tables.femm.parse import DIGITS

GRID = 10.0**-DIGITS
"""In mm; everything is snapped to it."""

MIN_AREA = 1e-6
"""In mm^2, as in actuator files: smaller faces are rounding."""

LARGEST_CHORD_DEG = 3.0
"""Angle of the chords that stand for arcs where other lines cross them: 0.03 % of the radius away from it."""

MAX_LINES = 20_000
"""Lines after arcs are split; more is no drawing of an actuator."""


@dataclass(frozen=True)
class FemPiece:
    """A closed region of the drawing in mm, perhaps with holes, or what touching ones of one material are together."""

    polygon: Polygon
    labels: tuple[FemLabel, ...]
    direction: Direction | None = None  # Of a magnet
    turns: float = 0.0  # Of a winding by its section; negative where it is wound the other way

    @property
    def label(self) -> FemLabel:
        """The only one, or that of the first region."""
        return self.labels[0]

    @property
    def material(self) -> FemMaterial:
        """Material of its blocks."""
        return self.label.material

    @property
    def place(self) -> str:
        """How messages name it."""
        return f"{self.label.place}, group {self.label.group}"


def connected_faces(faces: Sequence[FemPiece]) -> Iterator[tuple[Polygon, list[FemPiece]]]:
    """What faces that touch are together, and which they are."""
    union = shapely.unary_union([face.polygon for face in faces], grid_size=GRID)
    for piece in getattr(union, "geoms", [union]):
        yield piece, [face for face in faces if piece.contains(face.polygon.representative_point())]


def chords(line: FemLine) -> list[tuple[float, float]]:
    """The corners of a segment or arc in mm, both ends included."""
    start, end = (line.start.r, line.start.z), (line.end.r, line.end.z)
    if is_straight(line):
        return [start, end]
    inner = arc_points(start, end, _bulge(line), math.radians(LARGEST_CHORD_DEG))
    return [start, *((round(r, DIGITS), round(z, DIGITS)) for r, z in inner), end]


def is_straight(line: FemLine) -> bool:
    """Whether a segment, or an arc that is as straight as one."""
    length = math.hypot(line.end.r - line.start.r, line.end.z - line.start.z)
    return length * math.radians(line.angle) / 8.0 < GRID


def _bulge(line: FemLine) -> float:
    return math.tan(math.radians(line.angle) / 4.0)


def find_faces(model: FemModel, notes: Notes) -> tuple[FemPiece, ...]:
    """Split the drawing into its faces and give each its label."""
    strings = [LineString(points) for points in map(chords, model.lines) if len(set(points)) > 1]
    if sum(len(string.coords) for string in strings) > MAX_LINES:
        notes.stop("drawing lines", most=MAX_LINES)
    noded = shapely.unary_union(MultiLineString(strings), grid_size=GRID)
    rings, cuts, dangles, _ = shapely.polygonize_full([noded])
    polygons = [shapely.transform(polygon, lambda points: np.round(points, DIGITS) + 0.0) for polygon in rings.geoms]
    polygons = [polygon for polygon in polygons if polygon.area >= MIN_AREA and polygon.is_valid]
    if not polygons:
        notes.stop("drawing open")
    if (inner := min(polygon.bounds[0] for polygon in polygons)) < 0:
        notes.say("drawing mirrored", radius=inner)
    if loose := len(getattr(cuts, "geoms", ())) + len(getattr(dangles, "geoms", ())):
        notes.say("loose-lines", lines=loose)
    tree = STRtree(polygons)
    owners: dict[int, list[FemLabel]] = {}
    for label in model.labels:
        inside = tree.query(Point(label.r, label.z), predicate="within").tolist()
        if len(inside) == 1:
            owners.setdefault(inside[0], []).append(label)
        elif label.meshed:
            notes.say("label outside", place=label.place)
    default = [label for label in model.labels if label.default][:1]
    faces = []
    for n, polygon in enumerate(polygons):
        owner = owners.get(n, default)
        if len(owner) == 1:
            faces.append(FemPiece(polygon, (owner[0],)))
        elif owner:
            notes.say("label twice", places=" and ".join(label.place for label in owner))
        else:
            point, (r0, z0, r1, z1) = polygon.representative_point(), polygon.bounds
            place = f"around (r, z) = ({point.x:.6g}, {point.y:.6g}) mm, r [{r0:g}, {r1:g}], z [{z0:g}, {z1:g}],"
            notes.say("label missing", place=place)
    return tuple(faces)


Edge = tuple[float, float, float]
"""A corner (r, z) in mm and the angle of the arc to the next in degrees, counter-clockwise positive, 0 for none."""

ON_ARC = 4 * GRID
"""In mm: corners are rounded to the grid, and so are the ends of the arc itself."""


def without_holes(polygon: Polygon) -> list[Polygon]:
    """A polygon's pieces, cut along constant z until none has a hole."""
    pieces = [polygon]
    simple: list[Polygon] = []
    while pieces:
        piece = pieces.pop()
        if not piece.interiors:
            simple.append(piece)
            continue
        r0, z0, r1, z1 = piece.bounds
        _, low, _, high = piece.interiors[0].bounds
        cut = round(0.5 * (low + high), DIGITS)
        for half in (box(r0 - 1, z0 - 1, r1 + 1, cut), box(r0 - 1, cut, r1 + 1, z1 + 1)):
            clipped = shapely.intersection(piece, half, grid_size=GRID)
            pieces += [cutting for cutting in getattr(clipped, "geoms", [clipped]) if cutting.area >= MIN_AREA]
    return sorted(simple, key=lambda piece: (piece.bounds[1], piece.bounds[0]))


def corners(polygon: Polygon) -> list[tuple[float, float]]:
    """The exterior's corners; points on a straight edge are not needed and would refine the mesh there."""
    ring = np.round(np.asarray(shapely.geometry.polygon.orient(polygon).exterior.coords[:-1]), DIGITS) + 0.0
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    chord = after - before
    offset = ring - before
    height = np.abs(chord[:, 0] * offset[:, 1] - chord[:, 1] * offset[:, 0]) / np.hypot(*chord.T)
    return [(float(r), float(z)) for r, z in ring[height > 2 * GRID]]


@dataclass(frozen=True)
class _Arc:
    """An arc of the file, counter-clockwise from ``start`` (radians) over ``span``."""

    centre: complex
    radius: float
    start: float
    span: float

    def along(self, point: complex) -> float | None:
        """Angle from the arc's start to a point on it; None for a point elsewhere."""
        if abs(abs(point - self.centre) - self.radius) > ON_ARC:
            return None
        slack = ON_ARC / self.radius
        angle = (cmath.phase(point - self.centre) - self.start + slack) % (2.0 * math.pi) - slack
        return angle if angle <= self.span + slack else None


def with_arcs(polygons: Sequence[Polygon], lines: Sequence[FemLine]) -> list[list[Edge]]:
    """The corners of polygons whose arcs are chords, with the file's arcs in place of these.

    A corner stays where an edge of any polygon ends that is no chord of one arc: parts that share an arc get the same
    corners on it, so that they neither overlap nor leave a gap.
    """
    arcs = [_arc(line) for line in lines if not is_straight(line)]
    rings = [[complex(*point) for point in corners(polygon)] for polygon in polygons]
    edges = [[_chorded(arcs, *ends) for ends in zip(ring, [*ring[1:], ring[0]], strict=True)] for ring in rings]
    kept = {
        ring[k]
        for ring, arc_of in zip(rings, edges, strict=True)
        for k in range(len(ring))
        if arc_of[k] is None or arc_of[k] is not arc_of[k - 1]
    }
    outlines = []
    for ring, arc_of in zip(rings, edges, strict=True):
        places = [k for k, point in enumerate(ring) if point in kept]
        angles = [
            math.degrees((arc.along(ring[after]) or 0.0) - (arc.along(ring[k]) or 0.0)) if (arc := arc_of[k]) else 0.0
            for k, after in zip(places, [*places[1:], *places[:1]], strict=True)
        ]
        outlines.append([(ring[k].real, ring[k].imag, angle) for k, angle in zip(places, angles, strict=True)])
    return outlines


def _chorded(arcs: Sequence[_Arc], start: complex, end: complex) -> _Arc | None:
    """The arc of the file that an edge is a chord of; None for a straight line."""
    largest = math.radians(LARGEST_CHORD_DEG)
    for arc in arcs:
        low, high, slack = arc.along(start), arc.along(end), ON_ARC / arc.radius
        if low is not None and high is not None and slack < abs(high - low) <= largest + slack:
            return arc
    return None


def _arc(line: FemLine) -> _Arc:
    start = (line.start.r, line.start.z)
    centre, radius = arc_circle(start, (line.end.r, line.end.z), _bulge(line))
    return _Arc(complex(*centre), radius, cmath.phase(complex(*start) - complex(*centre)), math.radians(line.angle))
