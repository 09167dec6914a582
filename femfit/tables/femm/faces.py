"""The drawing's faces: lines split where they meet, closed loops found, each block label in its face.

Arcs become chords of at most ``arc_degrees`` here, whose ends lie on the arc; :mod:`femfit.tables.femm.outlines` finds
the arcs again. The spacing that the file asks of FEMM's own mesh is not used. Lines are split on a
grid of a nanometre, which joins a corner to the line that it was drawn on.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, MultiLineString, Point, Polygon, STRtree

from femfit.core.amount import counted
from femfit.tables.femm.model import FemLabel, FemLine, FemMaterial, FemModel
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.parse import DIGITS

GRID = 10.0**-DIGITS
"""In mm; everything is snapped to it."""

MIN_AREA = 1e-6
"""In mm^2, as in actuator files: smaller faces are rounding."""

MAX_LINES = 20_000
"""Lines after arcs are split; more is no drawing of an actuator."""


@dataclass(frozen=True)
class FemFace:
    """A closed region of the drawing in mm, with holes where other faces lie inside."""

    polygon: Polygon
    label: FemLabel


@dataclass(frozen=True)
class FemPiece:
    """A connected piece of one material, in the file's coordinates in mm."""

    polygon: Polygon
    material: FemMaterial
    labels: tuple[FemLabel, ...]

    @property
    def group(self) -> int:
        """Group of its blocks."""
        return self.labels[0].group

    @property
    def place(self) -> str:
        """How messages name it."""
        return f"{self.labels[0].place}, group {self.group}"


def connected_faces(faces: Sequence[FemFace]) -> Iterator[tuple[Polygon, list[FemFace]]]:
    """What faces that touch are together, and which they are."""
    union = shapely.unary_union([face.polygon for face in faces], grid_size=GRID)
    for piece in getattr(union, "geoms", [union]):
        yield piece, [face for face in faces if piece.contains(face.polygon.representative_point())]


def is_straight(line: FemLine) -> bool:
    """Whether a segment, or an arc that is as straight as one."""
    length = math.hypot(line.end.r - line.start.r, line.end.z - line.start.z)
    return length * math.radians(line.angle) / 8.0 < GRID


def chords(line: FemLine, arc_degrees: float) -> list[tuple[float, float]]:
    """The corners of a segment or arc in mm, both ends included."""
    start, end = complex(line.start.r, line.start.z), complex(line.end.r, line.end.z)
    half = math.radians(line.angle) / 2.0
    if is_straight(line):
        return [(start.real, start.imag), (end.real, end.imag)]
    centre = (start + end) / 2.0 + 1j * (end - start) / 2.0 / math.tan(half)
    count = math.ceil(line.angle / arc_degrees - 1e-9)
    turned = centre + (start - centre) * np.exp(2j * half * np.arange(1, count) / count)
    inner = [(round(point.real, DIGITS), round(point.imag, DIGITS)) for point in turned.tolist()]
    return [(start.real, start.imag), *inner, (end.real, end.imag)]


def find_faces(model: FemModel, arc_degrees: float, notes: Notes) -> tuple[FemFace, ...]:
    """Split the drawing into its faces and give each its label."""
    strings = [
        LineString(corners) for corners in (chords(line, arc_degrees) for line in model.lines) if _spans(corners)
    ]
    if sum(len(string.coords) for string in strings) > MAX_LINES:
        notes.problem(f"the drawing has more than {MAX_LINES} lines. Take coarser arcs with --arc-degrees.")
        return ()
    noded = shapely.unary_union(MultiLineString(strings), grid_size=GRID)
    rings, cuts, dangles, _ = shapely.polygonize_full([noded])
    polygons = [shapely.transform(polygon, _rounded) for polygon in rings.geoms]
    polygons = [polygon for polygon in polygons if polygon.area >= MIN_AREA and polygon.is_valid]
    if not polygons:
        notes.problem("its lines enclose no face. Draw closed outlines, along the axis r = 0 too.")
        return ()
    if any(polygon.bounds[0] < 0 for polygon in polygons):
        inner = min(polygon.bounds[0] for polygon in polygons)
        notes.problem(f"the drawing must lie at r >= 0; it goes down to {inner:g} mm. Draw one half only.")
    loose = len(getattr(cuts, "geoms", ())) + len(getattr(dangles, "geoms", ()))
    if loose:
        notes.info(
            "loose-lines",
            f"{counted(loose, 'line that encloses nothing is', 'lines that enclose nothing are')} left out.",
        )
    return _labelled(polygons, model.labels, notes)


def _labelled(polygons: Sequence[Polygon], labels: Sequence[FemLabel], notes: Notes) -> tuple[FemFace, ...]:
    tree = STRtree(polygons)
    owners: dict[int, list[FemLabel]] = {}
    for label in labels:
        inside = tree.query(Point(label.r, label.z), predicate="within").tolist()
        if len(inside) == 1:
            owners.setdefault(inside[0], []).append(label)
        elif label.material is not None:
            notes.problem(f"{label.place} lies in no closed face, or on a line. Move the label, or close its outline.")
    default = next((label for label in labels if label.default), None)
    faces = []
    for n, polygon in enumerate(polygons):
        owner = owners.get(n, [default] if default else [])
        if not owner:
            notes.problem(f"the face {_where(polygon)} has no block label. Add one, air if it is that.")
        elif len(owner) > 1:
            names = " and ".join(label.place for label in owner)
            notes.problem(f"{names} lie in one face; their border is not closed. Close it, or delete one of them.")
        else:
            faces.append(FemFace(polygon, owner[0]))
    return tuple(faces)


def _spans(corners: Sequence[tuple[float, float]]) -> bool:
    return len(set(corners)) > 1


def _rounded(points: np.ndarray) -> np.ndarray:
    return np.round(points, DIGITS) + 0.0


def _where(polygon: Polygon) -> str:
    point = polygon.representative_point()
    r0, z0, r1, z1 = polygon.bounds
    return f"around (r, z) = ({point.x:.6g}, {point.y:.6g}) mm, r [{r0:g}, {r1:g}], z [{z0:g}, {z1:g}],"
