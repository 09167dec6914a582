"""Outlines as polygons, and checks of the parts against each other: overlap, collision, the sensor's place, a force."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from shapely import LineString, MultiPoint, Point, Polygon, unary_union
from shapely.affinity import translate
from shapely.geometry.polygon import orient
from shapely.validation import explain_validity

from femfit.device.complaints import joined
from femfit.device.parts import Material
from femfit.device.schema import HallPlace, OutlineEntry

MIN_AREA = 1e-6
"""In mm^2: far below any part, far above the rounding of areas."""


def outline(entry: OutlineEntry, path: str, problems: list[str]) -> Polygon | None:
    """The polygon of a region or winding, in mm.

    Returns
    -------
    Polygon or None
        Counter-clockwise; None if it is unusable.
    """
    corners = _corners(entry, path, problems)
    if corners is None:
        return None
    key = joined(path, "r_mm" if entry.polygon_mm is None else "polygon_mm")
    inner = min(r for r, _ in corners)
    if inner < 0:
        problems.append(f"{key} must have r >= 0, the axis being r = 0; it goes down to {inner:g}. Draw one half only.")
        return None
    polygon = Polygon(corners)
    # A figure of eight has no net area but spans one, a line does not.
    if not polygon.is_valid and polygon.convex_hull.area >= MIN_AREA:
        problems.append(
            f"{key} must not cross or touch itself; {explain_validity(polygon)} (r, z in mm). "
            "List the corners in their order around the outline."
        )
        return None
    if polygon.area < MIN_AREA:
        problems.append(f"{key} must enclose an area; its corners lie on a line. Give corners that span a surface.")
        return None
    if _touches_axis_in_a_point(polygon):
        problems.append(
            f"{key} must meet the axis in a whole edge or not at all; it touches r = 0 in a single point. "
            "Add a second corner at r = 0, or keep away from the axis."
        )
        return None
    return orient(polygon)


def swept(polygon: Polygon, start: float, stop: float) -> Polygon:
    """Everything that a polygon passes while it is shifted along z from start to stop.

    Parameters
    ----------
    start, stop : float
        Shifts in mm.
    """
    corners = list(polygon.exterior.coords)
    tracks = [
        MultiPoint([(r, z + shift) for r, z in (one, other) for shift in (start, stop)]).convex_hull
        for one, other in pairwise(corners)
    ]
    return unary_union([translate(polygon, yoff=start), translate(polygon, yoff=stop), *tracks])


def _corners(entry: OutlineEntry, path: str, problems: list[str]) -> list[tuple[float, float]] | None:
    if entry.polygon_mm is not None and (entry.r_mm is not None or entry.z_mm is not None):
        problems.append(f"{path} must have either polygon_mm or r_mm and z_mm; it has both. Remove one.")
        return None
    if entry.polygon_mm is not None:
        return _polygon_corners(entry.polygon_mm, joined(path, "polygon_mm"), problems)
    if entry.r_mm is not None and entry.z_mm is not None:
        return _box_corners(entry.r_mm, entry.z_mm, path, problems)
    needed = " and ".join(key for key in ("r_mm", "z_mm") if getattr(entry, key) is None)
    problems.append(
        f"{path} must have an outline; {needed} missing. Give r_mm = [inner, outer] and z_mm = [lower, upper], "
        "or polygon_mm = [[r, z], ...]."
    )
    return None


def _polygon_corners(polygon: list[list[float]], path: str, problems: list[str]) -> list[tuple[float, float]] | None:
    corners = [(r, z) for r, z in polygon]
    if corners[0] == corners[-1]:
        corners.pop()
    repeated = [n for n in range(1, len(corners)) if corners[n] == corners[n - 1]]
    if repeated:
        where = joined(path, repeated[0])
        problems.append(f"{where} must differ from the corner before it; both are {corners[repeated[0]]}. Remove one.")
        return None
    if len(corners) < 3:
        problems.append(f"{path} must have three corners; it has {len(corners)} and closes on itself. Add corners.")
        return None
    return corners


def _box_corners(r: list[float], z: list[float], path: str, problems: list[str]) -> list[tuple[float, float]] | None:
    descending = [(key, low, high) for key, (low, high) in (("r_mm", r), ("z_mm", z)) if low >= high]
    problems += [
        f"{joined(path, key)} must ascend; it is [{low:g}, {high:g}]. Exchange or change the values."
        for key, low, high in descending
    ]
    return None if descending else [(r[0], z[0]), (r[1], z[0]), (r[1], z[1]), (r[0], z[1])]


def _touches_axis_in_a_point(polygon: Polygon) -> bool:
    _, lower, _, upper = polygon.bounds
    contact = polygon.intersection(LineString([(0.0, lower - 1.0), (0.0, upper + 1.0)]))
    return any(part.geom_type == "Point" for part in getattr(contact, "geoms", [contact]) if not part.is_empty)


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
    polygon: Polygon
    material: Material | None = None  # None for the winding and where the file's material is wrong


def check_overlaps(parts: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report each pair of parts, which stand still relative to each other, that share an area."""
    for one, other in combinations(parts, 2):
        shared = one.polygon.intersection(other.polygon)
        if shared.area > MIN_AREA:
            problems.append(
                f"{one.path} and {other.path} must not overlap; they share {_place(shared)}. Change one outline."
            )


def check_thickness(parts: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report parts that are too thin for their length to be meshed: their elements are as large as they are thick."""
    for part in parts:
        inner, lower, outer, upper = part.polygon.bounds
        thin, long = sorted((outer - inner, upper - lower))
        if long > LARGEST_ASPECT * thin:
            problems.append(
                f"{part.path} must be at least 1/{LARGEST_ASPECT:g} as thick as it is long; it is {thin:.3g} mm by "
                f"{long:.3g} mm, and the field solver would need {long / thin:.0f} elements along it. Draw it at least "
                f"{long / LARGEST_ASPECT:.2g} mm thick, or leave it out."
            )


def check_zero_heights(fixed: Sequence[DrawnPart], moving: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report faces that are not where distances are counted from."""
    heights = [z for part in fixed for _, z in part.polygon.exterior.coords]
    if heights and all(abs(z) > CONTACT for z in heights):
        problems.append(
            "electromagnet must have its face at z = 0, from which distances are counted; no corner of it or of the "
            f"coil lies there (they span z_mm {min(heights):g} to {max(heights):g}). Shift the drawing along z."
        )
    if not moving:
        return
    nearest = min(moving, key=lambda part: float(part.polygon.bounds[1]))
    height = nearest.polygon.bounds[1]
    if abs(height) > CONTACT:
        problems.append(
            f"moving must have its nearest face at z = 0; the lowest of {nearest.path} is z_mm {height:g}. "
            "Shift the moving part along z; the sweep adds the distance."
        )


def check_collisions(
    fixed: Sequence[DrawnPart], moving: Sequence[DrawnPart], distances: Sequence[float], problems: list[str]
) -> None:
    """Report each fixed part that the moving part touches within the swept distances (mm), with the first such one."""
    distances = [distance for distance in distances if distance > 0]
    if not distances:
        return
    for mover in moving:
        way = swept(mover.polygon, distances[0], distances[-1])
        for part in fixed:
            if way.distance(part.polygon) > CONTACT:
                continue
            hits = (d for d in distances if translate(mover.polygon, yoff=d).distance(part.polygon) <= CONTACT)
            first = next(hits, None)
            when = "between two swept distances" if first is None else f"first at {first:g} mm"
            problems.append(
                f"sweep.distance_mm must keep parts apart; {mover.path} collides with {part.path} {when}. "
                "Leave a clearance around the moving part, or leave these distances out."
            )


def check_moving_body(moving: Sequence[DrawnPart], problems: list[str]) -> None:
    """Report a moving part in pieces, and one on which no magnetic force can act."""
    pieces = unary_union([part.polygon for part in moving])
    if pieces.geom_type == "MultiPolygon":
        problems.append(
            f"moving.regions must touch each other along an edge; they form {len(pieces.geoms)} separate bodies. "
            "Join them, if need be by a region of air."
        )
    materials = [part.material for part in moving if part.material is not None]
    if len(materials) < len(moving) or not moving:
        return
    if all(m.remanence_T == 0 and m.relative_permeability <= NON_MAGNETIC_LIMIT for m in materials):
        names = ", ".join(sorted({material.name for material in materials}))
        problems.append(
            f"moving.regions must hold a magnet or something permeable; it is all {names}, on which no force acts. "
            "Name a magnet or a steel."
        )


def check_hall_place(
    hall: HallPlace,
    fixed: Sequence[DrawnPart],
    moving: Sequence[DrawnPart],
    distances: Sequence[float],
    problems: list[str],
) -> None:
    """Report a Hall element inside of a solid part or in the moving part's way."""
    # On the axis a solid part is an edge of the half drawn, not its surface: look just beside.
    element = Point(max(hall.r_mm, CONTACT), hall.z_mm)
    place = f"(r, z) = ({hall.r_mm:g}, {hall.z_mm:g}) mm"
    problems += [
        f"hall must lie outside of solid parts; {place} is inside of {part.path}. Move it to a face or into the air."
        for part in fixed
        if part.polygon.contains(element)
    ]
    distances = [distance for distance in distances if distance > 0]
    if not distances:
        return
    problems += [
        f"hall must lie out of the moving part's way; {place} is passed by {part.path} within sweep.distance_mm. "
        "Move it, or start the distances farther away."
        for part in moving
        if swept(part.polygon, distances[0], distances[-1]).distance(element) <= CONTACT
    ]


def _place(shared: Polygon) -> str:
    inner, lower, outer, upper = shared.bounds
    return f"{shared.area:.3g} mm^2 within r_mm [{inner:g}, {outer:g}], z_mm [{lower:g}, {upper:g}]"
