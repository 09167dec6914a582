"""Checks of the parts against each other: overlap, collision, the sensor's place, a force."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from shapely import MultiPoint, Point, Polygon, unary_union
from shapely.affinity import translate

from femfit.device.complaints import complain
from femfit.device.keys import Given
from femfit.device.outlines import MIN_AREA, DrawnOutline
from femfit.device.parts import Material


def swept(polygon: Polygon, start: float, stop: float) -> Polygon:
    """Everything that a polygon passes while it is shifted along z from start to stop.

    Parameters
    ----------
    start, stop : float
        Shifts in mm.
    """
    corners = list(polygon.exterior.coords)
    tracks = [
        MultiPoint([(r, z + shift) for r, z in (corner, end) for shift in (start, stop)]).convex_hull
        for corner, end in pairwise(corners)
    ]
    return unary_union([translate(polygon, yoff=start), translate(polygon, yoff=stop), *tracks])


CONTACT = 1e-6
"""Clearance in mm below which parts touch: the field solver needs air around the moving part."""

LARGEST_ASPECT = 1000.0
"""Length of a part over its thickness. Chosen: a plate of 475 makes a mesh of 8400 elements, twice those of a plate of
190, and one of 9500 was not meshed in ten minutes."""

NON_MAGNETIC_LIMIT = 1.001
"""Relative permeability below which a body without remanence feels no force worth modelling."""


@dataclass(frozen=True)
class DrawnPart:
    """A region or the winding, as drawn."""

    path: str
    name: str
    outline: DrawnOutline
    material: Material | None = None  # None for a winding and where the file's material is wrong
    moves: bool = False  # Of a winding

    @property
    def polygon(self) -> Polygon:
        """In mm, with chords for arcs."""
        return self.outline.polygon


def check_overlaps(parts: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report each pair of parts, which stand still relative to each other, that share an area."""
    for first, second in combinations(parts, 2):
        shared = first.polygon.intersection(second.polygon)
        if shared.area > MIN_AREA:
            inner, lower, outer, upper = shared.bounds
            box = {"inner": inner, "outer": outer, "lower": lower, "upper": upper}
            complain(problems, "overlap", first.path, second=second.path, area=shared.area, **box)


def check_thickness(parts: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report parts that are too thin for their length to be meshed: their elements are as large as they are thick."""
    for body in parts:
        inner, lower, outer, upper = body.polygon.bounds
        thin, long = sorted((outer - inner, upper - lower))
        if long > LARGEST_ASPECT * thin:
            facts = {"most": LARGEST_ASPECT, "aspect": long / thin, "least": long / LARGEST_ASPECT}
            complain(problems, "thin", body.path, thin=thin, long=long, **facts)


def check_zero_heights(
    fixed: Sequence[DrawnPart], moving: Sequence[DrawnPart], problems: list[str], *, reference_face: bool
) -> None:
    """Report faces that are not where distances are counted from.

    ``reference_face`` says whether the fixed part must have a face there, as in schema 1.
    """
    heights = [z for body in fixed for _, z in body.polygon.exterior.coords]
    if reference_face and heights and all(abs(z) > CONTACT for z in heights):
        complain(problems, "no_face", lowest=min(heights), highest=max(heights))
    if not moving:
        return
    nearest = min(moving, key=lambda part: float(part.polygon.bounds[1]))
    height = nearest.polygon.bounds[1]
    if abs(height) > CONTACT:
        complain(problems, "moving_face", nearest.path, height=height)


def check_collisions(
    fixed: Sequence[DrawnPart], moving: Sequence[DrawnPart], distances: Sequence[float], problems: list[str]
) -> None:
    """Report each fixed part that the moving part touches within the swept distances (mm), with the first such one."""
    if not distances:
        return
    for mover in moving:
        way = swept(mover.polygon, distances[0], distances[-1])
        for body in fixed:
            if way.distance(body.polygon) > CONTACT:
                continue
            hits = (d for d in distances if translate(mover.polygon, yoff=d).distance(body.polygon) <= CONTACT)
            first = next(hits, None)
            when = "between two swept distances" if first is None else f"first at {first:g} mm"
            complain(problems, "collision", mover.path, body=body.path, when=when)


def check_moving_body(moving: Sequence[DrawnPart], coils: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report a moving part in pieces, and one on which no magnetic force can act; ``coils`` are those that move."""
    pieces = unary_union([body.polygon for body in (*moving, *coils)])
    if pieces.geom_type == "MultiPolygon":
        complain(problems, "pieces", count=len(pieces.geoms))
    materials = [body.material for body in moving if body.material is not None]
    if len(materials) < len(moving) or not moving or coils:
        return
    if all(m.remanence_T == 0 and m.relative_permeability <= NON_MAGNETIC_LIMIT for m in materials):
        complain(problems, "no_force", names=", ".join(sorted({material.name for material in materials})))


def check_hall_place(
    path: str,
    hall: Given,
    fixed: Sequence[DrawnPart],
    moving: Sequence[DrawnPart],
    distances: Sequence[float],
    problems: list[str],
) -> None:
    """Report a Hall element inside of a solid part or in the moving part's way."""
    # On the axis a solid part is an edge of the half drawn, not its surface: look just beside.
    element = Point(max(hall.r_mm, CONTACT), hall.z_mm)
    for part in (part for part in fixed if part.polygon.contains(element)):
        complain(problems, "hall_inside", path, r=hall.r_mm, z=hall.z_mm, part=part.path)
    for part in moving if distances else ():
        if swept(part.polygon, distances[0], distances[-1]).distance(element) <= CONTACT:
            complain(problems, "hall_passed", path, r=hall.r_mm, z=hall.z_mm, part=part.path)
