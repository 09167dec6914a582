"""Closed outlines of straight edges and arcs, in the unit that they are given in.

An edge's bulge is tan(angle / 4) of its arc's angle, positive where the arc turns counter-clockwise from its corner to
the next, and zero for a straight edge.

References
----------
AutoCAD DXF reference, group code 42 of LWPOLYLINE, for the bulge.
"""

import math
from collections.abc import Sequence

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


def arc_points(start: Corner, stop: Corner, bulge: float) -> list[Corner]:
    """Points of an arc between its ends, the same ones from either end."""
    centre, _ = arc_circle(start, stop, bulge)
    angle = 4.0 * math.atan(bulge)
    pieces = max(2, math.ceil(abs(angle) / LARGEST_STEP))
    r, z = start[0] - centre[0], start[1] - centre[1]
    turns = (angle * k / pieces for k in range(1, pieces))
    return [
        (centre[0] + r * math.cos(a) - z * math.sin(a), centre[1] + r * math.sin(a) + z * math.cos(a)) for a in turns
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
