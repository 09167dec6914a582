"""The drawing of an actuator file: materials, regions and windings, each on its own, and against each other.

Checked are overlap and collision, the sensor's place, and whether there is a force.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

from shapely import MultiPoint, Point, Polygon, unary_union
from shapely.affinity import translate

from femfit.device.complaints import Reading, complain, joined, read_part, refuse_name, table_at
from femfit.device.electrics import HallElement, unit_vector
from femfit.device.keys import Entry, Outline
from femfit.device.materials import LIBRARY, Points, check_curve, read_bh_csv, without_flat_end
from femfit.device.outlines import MIN_AREA, DrawnOutline, outline
from femfit.device.parts import REFERENCE_TEMPERATURE, LinearMaterial, Material, NonlinearMaterial

CONTACT = 1e-6
"""Clearance in mm below which parts touch: the field solver needs air around the moving part."""

LARGEST_ASPECT = 1000.0
"""Length of a part over its thickness. Chosen: a plate of 475 makes a mesh of 8400 elements, twice those of a plate of
190, and one of 9500 was not meshed in ten minutes."""

NON_MAGNETIC_LIMIT = 1.001
"""Relative permeability below which a body without remanence feels no force worth modelling."""

RESERVED = ("air", "coil")
"""Region names that the field solver gives to what is not a region."""


@dataclass(frozen=True)
class PartTable:
    """The table of a region or of a winding, whatever is wrong with it."""

    place: tuple[str, ...]
    content: Any
    label: str  # Its name, after "coil" where a region has the same one
    winding: bool = False

    @property
    def path(self) -> str:
        """Key path of the table."""
        return joined("", *self.place)

    @property
    def moves(self) -> bool:
        """Whether it is drawn with the moving part."""
        return self.place[0] == "moving" or (self.winding and self.content.get("moves") is True)

    @property
    def shape(self) -> Entry | None:
        """The keys of its outline; None where one is wrong."""
        return read_part(Outline, self.content)


def part_tables(data: Mapping[str, Any]) -> Iterator[PartTable]:
    """Each region, the fixed ones first, and each winding."""
    regions = {(body, "regions"): table_at(data, body, "regions") for body in ("fixed", "moving")}
    for place, tables in regions.items():
        yield from (PartTable((*place, name), table, name) for name, table in tables.items())
    for name, table in table_at(data, "coils").items():
        shared = any(name in tables for tables in regions.values())
        yield PartTable(("coils", name), table, f"{'coil ' * shared}{name}", winding=True)


def materials_used(data: Mapping[str, Any]) -> set[str]:
    """Names of the materials of the file's regions."""
    return {str(table.content.get("material")) for table in part_tables(data) if isinstance(table.content, dict)}


@dataclass(frozen=True)
class DrawnPart(PartTable):
    """A region or a winding, as drawn."""

    outline: DrawnOutline = field(kw_only=True)
    material: Material | None = None  # None for a winding and where the file's material is wrong

    @property
    def polygon(self) -> Polygon:
        """In mm, with chords for arcs."""
        return self.outline.polygon


def read_parts(file: Reading, directory: Path) -> list[DrawnPart]:
    """Draw what can be drawn of a file: the fixed regions first, then the moving ones, and the windings."""
    # The file's own materials come first; None where one of them is wrong
    materials: dict[str, Material | None] = {name: entry.material for name, entry in LIBRARY.items()}
    for name, table in table_at(file.data, "materials").items():
        entry = file.entries.get(joined("materials", name))
        materials[name] = None if entry is None else _material(entry, table, directory, file.problems)
    parts: list[DrawnPart] = []
    for table in part_tables(file.data):
        path, material, shape = table.path, None, table.shape
        if not table.winding and path in file.entries:
            material = _region_material(file.entries[path], path, materials, file.problems)
        if not table.winding and table.label in RESERVED:
            file.complain("reserved", path, names=" or ".join(RESERVED))
        drawn = None if shape is None else outline(shape, path, file.problems)
        if drawn is None:
            continue
        if table.winding and drawn.polygon.bounds[0] <= 0:
            file.complain("winding_on_axis", path)
        standing = {body.place[-1] for body in parts if not body.moves}
        if not table.winding and table.moves and table.place[-1] in standing:
            file.complain("region_twice", path, body="fixed")
        parts.append(DrawnPart(**vars(table), outline=drawn, material=material))
    return parts


def _material(material: Material, table: Any, directory: Path, problems: list[str]) -> Material | None:
    """A material of the file with its curve, which a file may have, or the library; None if that is wrong."""
    if not isinstance(material, NonlinearMaterial):
        return material
    path, source = joined("materials", material.name), table.get("bh_curve")
    steel = material if source is None else getattr(LIBRARY.get(source), "material", None)
    path, count, remark = f"{path}{'.bh_curve' * (source is not None)}", len(problems), ""
    if isinstance(steel, NonlinearMaterial):
        points: Points | None = (steel.flux_density_T, steel.field_A_per_m)
    else:
        points = read_bh_csv(directory / source, path, problems)
    if points is None:
        return None
    if len(points[0]) == len(points[1]):
        points, remark = without_flat_end(*points)
    check_curve(*points, path, problems)
    if len(problems) > count:
        return None
    return replace(material, flux_density_T=points[0], field_A_per_m=points[1], remark=remark)


def _region_material(
    entry: Entry, path: str, materials: Mapping[str, Material | None], problems: list[str]
) -> Material | None:
    """The material at the region's temperature, turned as the region says; None if one of them is wrong."""
    if entry.material not in materials:
        refuse_name(problems, "no_material", path, entry.material, materials)
    material, celsius, direction = materials.get(entry.material), entry.temperature_C, entry.magnetization
    if material is None:
        return None
    code = ""
    if bool(material.remanence_T) != bool(direction):
        code = "magnetization" if direction else "no_magnetization"
    elif isinstance(material, LinearMaterial):
        # B_r (1 + alpha (T - 20 degC)) as in IEC 60404-8-1, the reversible part; the permeability is kept
        alpha, warmth = material.remanence_coefficient_per_K, (celsius or 0.0) - REFERENCE_TEMPERATURE
        remanence_T = material.remanence_T * (1.0 if celsius is None else 1.0 + alpha * warmth)
        if celsius is not None and not (alpha and direction):
            code = "temperature"
        elif direction and remanence_T <= 0.0:
            code = "no_remanence"
        elif direction:
            opposed = isinstance(direction, str) and direction.startswith("-")
            signed_T = -remanence_T if opposed else remanence_T
            material = replace(material, direction=unit_vector(direction), remanence_T=signed_T)
            material = material if celsius is None else replace(material, temperature_C=celsius)
    if code:
        complain(problems, code, path, material=material.name, celsius=celsius)
    return None if code else material


def check_parts(file: Reading, parts: Sequence[DrawnPart], distances: Sequence[float]) -> None:
    """Report parts that cannot be meshed, share an area, are nowhere, or do not clear each other within distances.

    These are in mm. No Hall element is inside of a solid part or in the moving part's way.
    """
    for body in parts:  # whose elements are as large as it is thick
        inner, lower, outer, upper = body.polygon.bounds
        thin, long = sorted((outer - inner, upper - lower))
        if long > LARGEST_ASPECT * thin:
            facts = {"aspect": long / thin, "least": long / LARGEST_ASPECT, "most": LARGEST_ASPECT}
            file.complain("thin", body.path, thin=thin, long=long, **facts)
    for first, second in combinations(parts, 2):
        shared = first.polygon.intersection(second.polygon)
        if first.moves == second.moves and shared.area > MIN_AREA:
            file.complain("overlap", first.path, second=second.path, area=shared.area, box=shared.bounds)
    standing, moving = [body for body in parts if not body.moves], [body for body in parts if body.moves]
    if len(parts) == len([*part_tables(file.data)]):
        _check_bodies(file, standing, moving)
    _check_ways(file, standing, moving, distances)


def _check_bodies(file: Reading, standing: Sequence[DrawnPart], moving: Sequence[DrawnPart]) -> None:
    """Report a body that is missing, in pieces, not where distances count from, or on which no force can act."""
    for bodies, code in ((moving, "no_moving"), (standing, "no_fixed")):
        if not bodies:
            file.complain(code)
    heights = [z for body in standing for _, z in body.polygon.exterior.coords]
    # The face from which distances are counted in schema 1
    if file.data.is_schema_1 and heights and all(abs(z) > CONTACT for z in heights):
        file.complain("no_face", lowest=min(heights), highest=max(heights))
    nearest = min(moving, key=lambda body: float(body.polygon.bounds[1]), default=None)
    if nearest is not None and abs(height := nearest.polygon.bounds[1]) > CONTACT:
        file.complain("moving_face", nearest.path, height=height)
    pieces = unary_union([body.polygon for body in moving])
    if pieces.geom_type == "MultiPolygon":
        file.complain("pieces", count=len(pieces.geoms))
    materials = [body.material for body in moving if body.material is not None]
    if len(materials) < len(moving) or not materials:  # a winding has none
        return
    if all(m.remanence_T == 0 and m.relative_permeability <= NON_MAGNETIC_LIMIT for m in materials):
        file.complain("no_force", names=", ".join(sorted({material.name for material in materials})))


def _check_ways(
    file: Reading, standing: Sequence[DrawnPart], moving: Sequence[DrawnPart], distances: Sequence[float]
) -> None:
    """Report what the moving part touches within the distances, with the first such one, and Hall elements."""
    elements = hall_places(file.data)
    # On the axis a solid part is an edge of the half drawn, not its surface: look just beside.
    points = {path: Point(max(hall.r_mm, CONTACT), hall.z_mm) for path, hall in elements.items()}
    for path, hall in elements.items():
        for body in (body for body in standing if body.polygon.contains(points[path])):
            file.complain("hall_inside", path, hall=hall, part=body.path)
    for mover in moving if distances else ():
        way = swept(mover.polygon, distances[0], distances[-1])
        for body in (body for body in standing if way.distance(body.polygon) <= CONTACT):
            hits = (d for d in distances if translate(mover.polygon, yoff=d).distance(body.polygon) <= CONTACT)
            first = next(hits, None)
            when = "between two swept distances" if first is None else f"first at {first:g} mm"
            file.complain("collision", mover.path, body=body.path, when=when)
        for path in (path for path, point in points.items() if way.distance(point) <= CONTACT):
            file.complain("hall_passed", path, hall=elements[path], part=mover.path)


def hall_places(data: Mapping[str, Any]) -> dict[str, Entry]:
    """Place in the drawing of each Hall element whose place is right, by its path, whatever else of it is wrong."""
    tables = {joined("sensors", name): table for name, table in table_at(data, "sensors").items()}
    halls = {path: table for path, table in tables.items() if isinstance(table, dict) and table.get("kind") == "hall"}
    places = ((path, read_part(HallElement, table, "r_mm", "z_mm")) for path, table in halls.items())
    return {path: place for path, place in places if place is not None}


def swept(polygon: Polygon, start: float, stop: float) -> Polygon:
    """Everything that a polygon passes while it is shifted along z from start to stop, in mm."""
    ends = [translate(polygon, yoff=shift) for shift in (start, stop)]
    edges = zip(*(pairwise(end.exterior.coords) for end in ends), strict=True)
    return unary_union([*ends, *(MultiPoint([*before, *after]).convex_hull for before, after in edges)])
