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

from femfit.device.complaints import complain, joined, read_part, refuse_name, table_at
from femfit.device.electrics import unit_vector
from femfit.device.keys import Given, OutlineEntry
from femfit.device.materials import LIBRARY, Points, check_curve, read_bh_csv, without_flat_end
from femfit.device.outlines import MIN_AREA, DrawnOutline, outline
from femfit.device.parts import REFERENCE_TEMPERATURE, LinearMaterial, Material, NonlinearMaterial
from femfit.device.schema import RegionEntry

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
    def shape(self) -> Given | None:
        """The keys of its outline; None where one is wrong."""
        return read_part(OutlineEntry, self.content)


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
    return {str(part.content.get("material")) for part in part_tables(data) if isinstance(part.content, dict)}


@dataclass(frozen=True)
class DrawnPart(PartTable):
    """A region or a winding, as drawn."""

    outline: DrawnOutline = field(kw_only=True)
    material: Material | None = None  # None for a winding and where the file's material is wrong

    @property
    def polygon(self) -> Polygon:
        """In mm, with chords for arcs."""
        return self.outline.polygon


@dataclass(frozen=True)
class Drawing:
    """What could be drawn of a file: the fixed regions first, then the moving ones, and the windings."""

    parts: tuple[DrawnPart, ...]
    complete: bool  # Whether every region and winding could be drawn

    def of(self, *, moves: bool) -> list[DrawnPart]:
        """All that moves, or all that stands still."""
        return [part for part in self.parts if part.moves == moves]

    def check(
        self,
        distances: Sequence[float],
        elements: Mapping[str, Given],
        problems: list[str],
        *,
        reference_face: bool,
    ) -> None:
        """Report parts that cannot be meshed, share an area, are nowhere, or do not clear each other within distances.

        Parameters
        ----------
        distances : sequence of float
            Swept ones in mm.
        elements : mapping
            Places of Hall elements by their paths; none is inside of a solid part or in the moving part's way.
        reference_face : bool
            Whether the fixed part must have a face where distances are counted from, as in schema 1.
        """
        for body in self.parts:  # whose elements are as large as it is thick
            inner, lower, outer, upper = body.polygon.bounds
            thin, long = sorted((outer - inner, upper - lower))
            if long > LARGEST_ASPECT * thin:
                aspect, least = long / thin, long / LARGEST_ASPECT
                complain(
                    problems, "thin", body.path, thin=thin, long=long, most=LARGEST_ASPECT, aspect=aspect, least=least
                )
        for first, second in combinations(self.parts, 2):
            shared = first.polygon.intersection(second.polygon)
            if first.moves == second.moves and shared.area > MIN_AREA:
                complain(problems, "overlap", first.path, second=second.path, area=shared.area, box=shared.bounds)
        if self.complete:
            self._check_bodies(problems, reference_face=reference_face)
        self._check_ways(distances, elements, problems)

    def _check_bodies(self, problems: list[str], *, reference_face: bool) -> None:
        """Report a body that is missing, in pieces, not where distances count from, or on which no force can act."""
        standing, mover = self.of(moves=False), self.of(moves=True)
        for bodies, code in ((mover, "no_moving"), (standing, "no_fixed")):
            if not bodies:
                complain(problems, code)
        heights = [z for body in standing for _, z in body.polygon.exterior.coords]
        if reference_face and heights and all(abs(z) > CONTACT for z in heights):
            complain(problems, "no_face", lowest=min(heights), highest=max(heights))
        nearest = min(mover, key=lambda part: float(part.polygon.bounds[1]), default=None)
        if nearest is not None and abs(height := nearest.polygon.bounds[1]) > CONTACT:
            complain(problems, "moving_face", nearest.path, height=height)
        pieces = unary_union([body.polygon for body in mover])
        if pieces.geom_type == "MultiPolygon":
            complain(problems, "pieces", count=len(pieces.geoms))
        materials = [body.material for body in mover if body.material is not None]
        if len(materials) < len(mover) or not materials:  # a winding has none
            return
        if all(m.remanence_T == 0 and m.relative_permeability <= NON_MAGNETIC_LIMIT for m in materials):
            complain(problems, "no_force", names=", ".join(sorted({material.name for material in materials})))

    def _check_ways(self, distances: Sequence[float], elements: Mapping[str, Given], problems: list[str]) -> None:
        """Report what the moving part touches within the distances, with the first such one, and Hall elements."""
        # On the axis a solid part is an edge of the half drawn, not its surface: look just beside.
        points = {path: Point(max(hall.r_mm, CONTACT), hall.z_mm) for path, hall in elements.items()}
        for path, hall in elements.items():
            for part in (part for part in self.of(moves=False) if part.polygon.contains(points[path])):
                complain(problems, "hall_inside", path, hall=hall, part=part.path)
        for mover in self.of(moves=True) if distances else ():
            way = swept(mover.polygon, distances[0], distances[-1])
            for body in self.of(moves=False):
                if way.distance(body.polygon) > CONTACT:
                    continue
                hits = (d for d in distances if translate(mover.polygon, yoff=d).distance(body.polygon) <= CONTACT)
                first = next(hits, None)
                when = "between two swept distances" if first is None else f"first at {first:g} mm"
                complain(problems, "collision", mover.path, body=body.path, when=when)
            for path in (path for path, point in points.items() if way.distance(point) <= CONTACT):
                complain(problems, "hall_passed", path, hall=elements[path], part=mover.path)


def swept(polygon: Polygon, start: float, stop: float) -> Polygon:
    """Everything that a polygon passes while it is shifted along z from start to stop, in mm."""
    ends = [translate(polygon, yoff=shift) for shift in (start, stop)]
    edges = zip(*(pairwise(end.exterior.coords) for end in ends), strict=True)
    return unary_union([*ends, *(MultiPoint([*before, *after]).convex_hull for before, after in edges)])


def read_drawing(data: Mapping[str, Any], entries: Mapping[str, Any], directory: Path, problems: list[str]) -> Drawing:
    """Draw what can be drawn of a file, whose right tables are ``entries`` by their key paths."""
    # The file's own materials come first; None where one of them is wrong
    materials: dict[str, Material | None] = {name: entry.material for name, entry in LIBRARY.items()}
    for name, table in table_at(data, "materials").items():
        entry = entries.get(joined("materials", name))
        materials[name] = None if entry is None else _material(entry, table, directory, problems)
    tables, parts = list(part_tables(data)), list[DrawnPart]()
    for table in tables:
        path, material = table.path, None
        if not table.winding and path in entries:
            material = _region_material(entries[path], path, materials, problems)
        if not table.winding and table.label in RESERVED:
            complain(problems, "reserved", path, names=" or ".join(RESERVED))
        shape = table.shape
        drawn = None if shape is None else outline(shape, path, problems)
        if drawn is None:
            continue
        part = DrawnPart(**vars(table), outline=drawn, material=material)
        if part.winding and drawn.polygon.bounds[0] <= 0:
            complain(problems, "winding_on_axis", path)
        if not part.winding and part.moves and part.place[-1] in {each.place[-1] for each in parts if not each.moves}:
            complain(problems, "region_twice", path, body="fixed")
        parts.append(part)
    return Drawing(tuple(parts), len(parts) == len(tables))


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
    entry: RegionEntry, path: str, materials: Mapping[str, Material | None], problems: list[str]
) -> Material | None:
    """The material at the region's temperature, turned as the region says."""
    if entry.material not in materials:
        refuse_name(problems, "no_material", path, entry.material, materials)
        return None
    material, celsius, direction = materials[entry.material], entry.temperature_C, entry.magnetization
    if material is None:
        return None
    code, remanence_T = "", material.remanence_T
    if bool(remanence_T) != bool(direction):
        code = "magnetization" if direction else "no_magnetization"
    elif celsius is not None and isinstance(material, LinearMaterial):
        # B_r (1 + alpha (T - 20 degC)) as in IEC 60404-8-1, the reversible part; the permeability is kept
        remanence_T *= 1.0 + material.remanence_coefficient_per_K * (celsius - REFERENCE_TEMPERATURE)
        if not material.remanence_coefficient_per_K or not direction:
            code = "temperature"
        elif remanence_T <= 0.0:
            code = "no_remanence"
        material = replace(material, temperature_C=celsius)
    if code:
        complain(problems, code, path, material=material.name, celsius=celsius)
        return None
    if isinstance(material, LinearMaterial) and direction is not None:
        opposed = isinstance(direction, str) and direction.startswith("-")
        remanence_T = (-1.0 if opposed else 1.0) * remanence_T
        material = replace(material, direction=unit_vector(direction), remanence_T=remanence_T)
    return material
