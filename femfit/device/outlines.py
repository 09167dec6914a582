"""Closed outlines of straight edges and arcs, which a file draws as a box, a polygon with arcs or a circle.

An edge's bulge is tan(angle / 4) of its arc's angle, positive where the arc turns counter-clockwise from its corner to
the next, and zero for a straight edge. Lengths stay in the unit that they are given in.

References
----------
AutoCAD DXF reference, group code 42 of LWPOLYLINE, for the bulge.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from shapely import LineString, Polygon
from shapely.validation import explain_validity

from femfit.device.complaints import MistakeError, joined

LARGEST_STEP = math.radians(2.0)
"""Angle of a chord that stands for a piece of an arc in checks: 0.015 % of the radius away from it."""

Corner = tuple[float, float]


def flattened(corners: Sequence[Corner], bulges: Sequence[float]) -> list[Corner]:
    """The outline's corners with chords for its arcs; no bulges at all for straight edges alone."""
    if not any(bulges):
        return list(corners)
    points: list[Corner] = []
    for k, (corner, bulge) in enumerate(zip(corners, bulges, strict=True)):
        points.append(corner)
        if bulge:
            points += arc_points(corner, corners[(k + 1) % len(corners)], bulge)
    return points


def arc_points(start: Corner, stop: Corner, bulge: float, step: float = LARGEST_STEP) -> list[Corner]:
    """Points of an arc between its ends, the same ones from either end, at most a step (in radians) apart."""
    angle = 4.0 * math.atan(bulge)
    pieces = max(2, math.ceil(abs(angle) / step - 1e-9))
    return turned(start, arc_circle(start, stop, bulge)[0], (angle * k / pieces for k in range(1, pieces)))


def turned(corner: Corner, centre: Corner, angles: Iterable[float]) -> list[Corner]:
    """A corner turned counter-clockwise about a centre by angles in rad."""
    r, z = corner[0] - centre[0], corner[1] - centre[1]
    return [
        (centre[0] + r * math.cos(a) - z * math.sin(a), centre[1] + r * math.sin(a) + z * math.cos(a)) for a in angles
    ]


def arc_circle(start: Corner, stop: Corner, bulge: float) -> tuple[Corner, float]:
    """Centre and radius of an arc's circle."""
    along, across = stop[0] - start[0], stop[1] - start[1]
    height = (1.0 - bulge**2) / (4.0 * bulge)  # of the centre over the chord, to its left, as a part of its length
    centre = (0.5 * (start[0] + stop[0]) - height * across, 0.5 * (start[1] + stop[1]) + height * along)
    return centre, math.hypot(along, across) * (1.0 + bulge**2) / (4.0 * abs(bulge))


def reversed_outline(corners: Sequence[Corner], bulges: Sequence[float]) -> tuple[list[Corner], list[float]]:
    """The same outline in the other sense."""
    back = list(corners)[::-1]
    if not bulges:
        return back, []
    ends = list(bulges)[::-1]
    return back, [-bulge for bulge in (*ends[1:], ends[0])]


def circle(centre: Corner, radius: float) -> tuple[list[Corner], list[float]]:
    """A circle, counter-clockwise; the half beside the axis where its centre lies on the axis."""
    r, z = centre
    if r == 0.0:
        return [(0.0, z - radius), (radius, z), (0.0, z + radius)], [_QUARTER, _QUARTER, 0.0]
    return [(r + radius, z), (r - radius, z)], [1.0, 1.0]


_QUARTER = math.tan(math.pi / 8.0)


MIN_AREA = 1e-6
"""In mm^2: far below any part, far above the rounding of areas."""

LARGEST_ARC = 359.0
"""In degrees: the ends of a larger arc nearly meet."""


@dataclass(frozen=True)
class DrawnOutline:
    """An outline in mm, counter-clockwise."""

    corners: tuple[Corner, ...]
    bulges: tuple[float, ...]  # As in femfit.device.outlines; empty where all edges are straight
    polygon: Polygon  # With chords for arcs


def outline(entry: Any, path: str, problems: list[str]) -> DrawnOutline | None:
    """The outline that the keys of an OutlineEntry give a region or winding; None if it is unusable."""
    try:
        return _closed(*_drawn(entry, path))
    except MistakeError as mistake:
        problems.append(str(mistake))
        return None


def _drawn(entry: Any, path: str) -> tuple[str, list[Corner], list[float]]:
    """Key path, corners and bulges."""
    box = [key for key in ("r_mm", "z_mm") if getattr(entry, key) is not None]
    ways = [key for key in ("polygon_mm", "circle_mm") if getattr(entry, key) is not None]
    ways += ["r_mm and z_mm"] if box else []
    if len(ways) > 1:
        raise MistakeError("outlines", path, ways=" or ".join(ways))
    if entry.polygon_mm is not None:
        return _polygon(entry.polygon_mm, joined(path, "polygon_mm"))
    if entry.circle_mm is not None:
        return _circle(entry.circle_mm, joined(path, "circle_mm"))
    if len(box) < 2:
        raise MistakeError("no_outline", path, needed=" and ".join(key for key in ("r_mm", "z_mm") if key not in box))
    (inner, outer), (lower, upper) = entry.r_mm, entry.z_mm
    return joined(path, "r_mm"), [(inner, lower), (outer, lower), (outer, upper), (inner, upper)], []


def _polygon(polygon: Sequence[Sequence[float]], key: str) -> tuple[str, list[Corner], list[float]]:
    corners = [(corner[0], corner[1]) for corner in polygon]
    angles = [corner[2] if len(corner) == 3 else 0.0 for corner in polygon]
    if corners[0] == corners[-1]:
        corners.pop()
        angles.pop()
    for n, (before, corner) in enumerate(pairwise(corners), 1):
        if corner == before:
            raise MistakeError("corner_twice", joined(key, n), corner=corner)
    if len(corners) < (2 if any(angles) else 3):
        raise MistakeError("few_corners", key, count=len(corners))
    for n, angle in enumerate(angles):
        if abs(angle) > LARGEST_ARC:
            raise MistakeError("wide_arc", joined(key, n), most=LARGEST_ARC, angle=angle)
    return key, corners, [math.tan(math.radians(angle) / 4.0) for angle in angles] if any(angles) else []


def _circle(values: Sequence[float], key: str) -> tuple[str, list[Corner], list[float]]:
    r, z, radius = values
    if radius <= 0.0:
        raise MistakeError("no_radius", key, radius=radius)
    if 0.0 < r <= radius:
        raise MistakeError("circle_on_axis", key, r=r, radius=radius)
    return key, *circle((r, z), radius)


def _closed(key: str, corners: list[Corner], bulges: list[float]) -> DrawnOutline:
    """The outline, counter-clockwise, of one area beside the axis."""
    points = flattened(corners, bulges)
    inner = min(r for r, _ in points)
    if inner < -(1e-12 * max(max(abs(r), abs(z)) for r, z in points)):
        raise MistakeError("negative_r", key, inner=inner)
    polygon = Polygon([(max(r, 0.0), z) for r, z in points])
    # A figure of eight has no net area but spans one, a line does not.
    if not polygon.is_valid and polygon.convex_hull.area >= MIN_AREA:
        raise MistakeError("crossing", key, where=explain_validity(polygon))
    if polygon.area < MIN_AREA:
        raise MistakeError("no_area", key)
    _, lower, _, upper = polygon.bounds
    contact = polygon.intersection(LineString([(0.0, lower - 1.0), (0.0, upper + 1.0)]))  # with the axis
    if any(piece.geom_type == "Point" for piece in getattr(contact, "geoms", [contact]) if not piece.is_empty):
        raise MistakeError("axis_point", key)
    if not polygon.exterior.is_ccw:
        corners, bulges = reversed_outline(corners, bulges)
        polygon = polygon.reverse()
    return DrawnOutline(tuple(corners), tuple(bulges), polygon)
