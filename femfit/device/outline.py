"""One outline of the file as a polygon: closed, without crossings, on the right side of the axis."""

from itertools import pairwise

from shapely import LineString, MultiPoint, Polygon, unary_union
from shapely.affinity import translate
from shapely.geometry.polygon import orient
from shapely.validation import explain_validity

from femfit.device.complaints import joined
from femfit.device.schema import OutlineEntry

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
