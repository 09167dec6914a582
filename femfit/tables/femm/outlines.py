"""Outlines of faces: without holes, without needless corners, and with the file's arcs where chords stood for them."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely import Polygon, box

from femfit.tables.femm.faces import GRID, MIN_AREA, is_straight
from femfit.tables.femm.model import FemLine
from femfit.tables.femm.parse import DIGITS

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


@dataclass(frozen=True)
class _Run:
    """Edges of an outline that are chords of one arc, from one angle along it to another."""

    arc: int
    start: float
    stop: float


class ArcFinder:
    """Finds the file's arcs in outlines whose arcs are chords of at most ``arc_degrees``.

    Parts that share an arc get the same corners on it, so that they neither overlap nor leave a gap.
    """

    def __init__(self, lines: Sequence[FemLine], polygons: Sequence[Polygon], arc_degrees: float) -> None:
        self.largest = math.radians(arc_degrees)
        self.arcs = [_arc(line) for line in lines if not is_straight(line)]
        self.breaks: dict[int, dict[float, complex]] = {}
        for polygon in polygons:
            for first, last, run in self._runs([complex(*point) for point in corners(polygon)]):
                if run is not None:
                    points = self.breaks.setdefault(run.arc, {})
                    points[run.start], points[run.stop] = first, last

    def outline(self, polygon: Polygon) -> list[Edge]:
        """A polygon's corners, with arcs."""
        edges: list[Edge] = []
        for first, _, run in self._runs([complex(*point) for point in corners(polygon)]):
            if run is None:
                edges.append((first.real, first.imag, 0.0))
                continue
            slack = ON_ARC / self.arcs[run.arc].radius
            low, high = min(run.start, run.stop) + slack, max(run.start, run.stop) - slack
            inner = sorted((angle, point) for angle, point in self.breaks[run.arc].items() if low < angle < high)
            distinct = [station for n, station in enumerate(inner) if n == 0 or station[0] - inner[n - 1][0] > slack]
            ways = distinct if run.stop > run.start else distinct[::-1]
            stations = [(run.start, first), *ways, (run.stop, 0j)]
            edges += [
                (point.real, point.imag, math.degrees(after - angle))
                for (angle, point), (after, _) in pairwise(stations)
            ]
        return edges

    def _runs(self, ring: list[complex]) -> list[tuple[complex, complex, _Run | None]]:
        """A ring's edges from corner to corner, those of one arc together."""
        count = len(ring)
        chords = [self._chord(ring[k], ring[(k + 1) % count]) for k in range(count)]
        first = next((k for k in range(count) if not _continues(chords[k - 1], chords[k])), 0)
        runs: list[tuple[complex, complex, _Run | None]] = []
        for step in range(count):
            k = (first + step) % count
            chord, end = chords[k], ring[(k + 1) % count]
            if runs and step and chord is not None and _continues(chords[k - 1], chord):
                start, _, before = runs[-1]
                runs[-1] = (start, end, _Run(chord.arc, before.start if before else chord.start, chord.stop))
            else:
                runs.append((ring[k], end, chord))
        return runs

    def _chord(self, start: complex, end: complex) -> _Run | None:
        """An edge as a chord of an arc of the file; None for a straight line."""
        for n, arc in enumerate(self.arcs):
            low, high = arc.along(start), arc.along(end)
            slack = ON_ARC / arc.radius
            if low is not None and high is not None and slack < abs(high - low) <= self.largest + slack:
                return _Run(n, low, high)
        return None


def _continues(before: _Run | None, after: _Run | None) -> bool:
    """Whether two chords run on along the same arc in the same sense."""
    if before is None or after is None or before.arc != after.arc:
        return False
    return (before.stop > before.start) == (after.stop > after.start)


def _arc(line: FemLine) -> _Arc:
    start, end = complex(line.start.r, line.start.z), complex(line.end.r, line.end.z)
    half = math.radians(line.angle) / 2.0
    centre = (start + end) / 2.0 + 1j * (end - start) / 2.0 / math.tan(half)
    return _Arc(centre, abs(start - centre), cmath.phase(start - centre), 2.0 * half)
