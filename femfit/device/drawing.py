"""The drawing of an actuator file: materials, regions and windings, each on its own, and against each other.

Checked are overlap and collision, the sensor's place, and whether there is a force.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, pairwise
from pathlib import Path
from typing import Any

from shapely import MultiPoint, Point, Polygon, unary_union
from shapely.affinity import translate

from femfit.device.complaints import complain, did_you_mean, joined, read_part, table_at
from femfit.device.electrics import unit_vector
from femfit.device.keys import Given, OutlineEntry
from femfit.device.materials import LIBRARY, curve_problems, read_bh_csv, without_flat_end
from femfit.device.outlines import MIN_AREA, DrawnOutline, outline
from femfit.device.parts import REFERENCE_TEMPERATURE, LinearMaterial, Material, NonlinearMaterial
from femfit.device.schema import RegionEntry


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


RESERVED = ("air", "coil")
"""Region names that the field solver gives to what is not a region."""


@dataclass(frozen=True)
class Drawing:
    """What could be drawn of a file."""

    # Regions of the fixed and of the moving part, without windings
    fixed: tuple[DrawnPart, ...]
    moving: tuple[DrawnPart, ...]
    windings: tuple[DrawnPart, ...]
    complete: bool  # Whether every region and winding could be drawn

    @property
    def standing(self) -> tuple[DrawnPart, ...]:
        """All that stands still: regions and windings."""
        return (*self.fixed, *(winding for winding in self.windings if not winding.moves))

    @property
    def mover(self) -> tuple[DrawnPart, ...]:
        """All that moves: regions and windings."""
        return (*self.moving, *(winding for winding in self.windings if winding.moves))

    def check(self, distances: Sequence[float], problems: list[str], *, reference_face: bool) -> None:
        """Report parts that cannot be meshed, share an area, are nowhere, or do not clear each other within distances.

        Parameters
        ----------
        distances : sequence of float
            Swept ones in mm.
        reference_face : bool
            Whether the fixed part must have a face where distances are counted from, as in schema 1.
        """
        for body in (*self.standing, *self.mover):  # whose elements are as large as it is thick
            inner, lower, outer, upper = body.polygon.bounds
            thin, long = sorted((outer - inner, upper - lower))
            if long > LARGEST_ASPECT * thin:
                facts = {"most": LARGEST_ASPECT, "aspect": long / thin, "least": long / LARGEST_ASPECT}
                complain(problems, "thin", body.path, thin=thin, long=long, **facts)
        for first, second in chain(combinations(self.standing, 2), combinations(self.mover, 2)):
            shared = first.polygon.intersection(second.polygon)
            if shared.area > MIN_AREA:
                inner, lower, outer, upper = shared.bounds
                box = {"inner": inner, "outer": outer, "lower": lower, "upper": upper}
                complain(problems, "overlap", first.path, second=second.path, area=shared.area, **box)
        if self.complete:
            if not self.mover:
                complain(problems, "no_moving")
            if not self.standing:
                complain(problems, "no_fixed")
            self._check_zero_heights(problems, reference_face=reference_face)
            self._check_moving_body(problems)
        self._check_collisions(distances, problems)

    def _check_zero_heights(self, problems: list[str], *, reference_face: bool) -> None:
        """Report faces that are not where distances are counted from."""
        heights = [z for body in self.standing for _, z in body.polygon.exterior.coords]
        if reference_face and heights and all(abs(z) > CONTACT for z in heights):
            complain(problems, "no_face", lowest=min(heights), highest=max(heights))
        nearest = min(self.mover, key=lambda part: float(part.polygon.bounds[1]), default=None)
        if nearest is not None and abs(height := nearest.polygon.bounds[1]) > CONTACT:
            complain(problems, "moving_face", nearest.path, height=height)

    def _check_collisions(self, distances: Sequence[float], problems: list[str]) -> None:
        """Report each fixed part that the moving part touches within the distances, with the first such one."""
        for mover in self.mover if distances else ():
            way = swept(mover.polygon, distances[0], distances[-1])
            for body in self.standing:
                if way.distance(body.polygon) > CONTACT:
                    continue
                hits = (d for d in distances if translate(mover.polygon, yoff=d).distance(body.polygon) <= CONTACT)
                first = next(hits, None)
                when = "between two swept distances" if first is None else f"first at {first:g} mm"
                complain(problems, "collision", mover.path, body=body.path, when=when)

    def _check_moving_body(self, problems: list[str]) -> None:
        """Report a moving part in pieces, and one on which no magnetic force can act."""
        pieces = unary_union([body.polygon for body in self.mover])
        if pieces.geom_type == "MultiPolygon":
            complain(problems, "pieces", count=len(pieces.geoms))
        materials = [body.material for body in self.mover if body.material is not None]
        if len(materials) < len(self.mover) or not materials:  # a winding has none
            return
        if all(m.remanence_T == 0 and m.relative_permeability <= NON_MAGNETIC_LIMIT for m in materials):
            complain(problems, "no_force", names=", ".join(sorted({material.name for material in materials})))

    def check_hall_place(self, path: str, hall: Given, distances: Sequence[float], problems: list[str]) -> None:
        """Report a Hall element inside of a solid part or in the moving part's way."""
        # On the axis a solid part is an edge of the half drawn, not its surface: look just beside.
        element = Point(max(hall.r_mm, CONTACT), hall.z_mm)
        for part in (part for part in self.standing if part.polygon.contains(element)):
            complain(problems, "hall_inside", path, r=hall.r_mm, z=hall.z_mm, part=part.path)
        for part in self.mover if distances else ():
            if swept(part.polygon, distances[0], distances[-1]).distance(element) <= CONTACT:
                complain(problems, "hall_passed", path, r=hall.r_mm, z=hall.z_mm, part=part.path)


def read_drawing(data: Mapping[str, Any], entries: Mapping[str, Any], directory: Path, problems: list[str]) -> Drawing:
    """Draw what can be drawn of a file, whose right tables are ``entries`` by their key paths."""
    # The file's own materials come first; None where one of them is wrong
    materials: dict[str, Material | None] = {name: entry.material for name, entry in LIBRARY.items()}
    for name, table in table_at(data, "materials").items():
        entry = entries.get(joined("materials", name))
        materials[name] = None if entry is None else _material(entry, table, directory, problems)
    tables, fixed, moving, windings = dict(part_tables(data)), list[DrawnPart](), list[DrawnPart](), list[DrawnPart]()
    for place, table in tables.items():
        path = joined("", *place)
        entry = None if is_winding(place) else entries.get(path)
        material = None if entry is None else _region_material(entry, path, materials, problems)
        part = _part(place, table, material, problems)
        if part is not None:
            (windings if is_winding(place) else moving if place[0] == "moving" else fixed).append(part)
    names = {part.name for part in fixed}
    for part in (part for part in moving if part.name in names):
        complain(problems, "region_twice", part.path, body=fixed_key(data))
    complete = len(fixed) + len(moving) + len(windings) == len(tables)
    return Drawing(tuple(fixed), tuple(moving), tuple(windings), complete)


def fixed_key(data: Mapping[str, Any]) -> str:
    """Which table has the fixed regions: ``fixed``, or ``electromagnet`` as in schema 1."""
    return "fixed" if "fixed" in data else "electromagnet"


def part_tables(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Place and table of each region, the fixed ones first, and of each winding."""
    for body in (fixed_key(data), "moving"):
        yield from (((body, "regions", name), table) for name, table in table_at(data, body, "regions").items())
    if isinstance(data.get("coil"), dict):
        yield ("coil",), data["coil"]
    yield from ((("coils", name), table) for name, table in table_at(data, "coils").items())


def materials_used(data: Mapping[str, Any]) -> set[str]:
    """Names of the materials of the file's regions."""
    return {str(table.get("material")) for _, table in part_tables(data) if isinstance(table, dict)}


def is_winding(place: Sequence[object]) -> bool:
    """Whether the table of a winding stands at a place."""
    return place[0] in {"coil", "coils"}


def _material(material: Material, table: Any, directory: Path, problems: list[str]) -> Material | None:
    """A material of the file with its curve, which a file may have, or the library; None if that is wrong."""
    if not isinstance(material, NonlinearMaterial):
        return material
    path, source = joined("materials", material.name), table.get("bh_curve")
    library_material, points, wrong = LIBRARY.get(source or ""), None, list[str]()
    if source is None:
        points = material.flux_density_T, material.field_A_per_m
    elif library_material is not None and isinstance(library_material.material, NonlinearMaterial):
        points = library_material.material.flux_density_T, library_material.material.field_A_per_m
    else:
        points, wrong = read_bh_csv(directory / source)
    remark = ""
    if points is not None:
        if len(points[0]) == len(points[1]):
            points, remark = without_flat_end(*points)
        wrong = curve_problems(*points)
    problems += [f"{path}{'.bh_curve' * (source is not None)} {problem}" for problem in wrong]
    if points is None or wrong:
        return None
    return replace(material, flux_density_T=points[0], field_A_per_m=points[1], remark=remark)


def _region_material(
    entry: RegionEntry, path: str, materials: Mapping[str, Material | None], problems: list[str]
) -> Material | None:
    """The material at the region's temperature, turned as the region says."""
    if entry.material not in materials:
        near, known = did_you_mean(entry.material, materials), ", ".join(materials)
        complain(problems, "no_material", path, given=entry.material[:60], near=near, known=known)
        return None
    material, celsius, direction = materials[entry.material], entry.temperature_C, entry.magnetization
    if material is None:
        return None
    warmed, code = material, ""
    if celsius is not None and isinstance(material, LinearMaterial):
        # B_r (1 + alpha (T - 20 degC)) as in IEC 60404-8-1, the reversible part; the permeability is kept
        factor = 1.0 + material.remanence_coefficient_per_K * (celsius - REFERENCE_TEMPERATURE)
        warmed = replace(material, remanence_T=material.remanence_T * factor, temperature_C=celsius)
    if material.remanence_T and direction is None:
        code = "no_magnetization"
    elif direction and not material.remanence_T:
        code = "magnetization"
    elif isinstance(warmed, LinearMaterial) and warmed is not material:
        code = "" if warmed.remanence_coefficient_per_K * material.remanence_T else "temperature"
        code = code or ("" if warmed.remanence_T > 0.0 else "no_remanence")
    if code:
        complain(problems, code, path, material=material.name, celsius=celsius)
        return None
    if isinstance(warmed, LinearMaterial) and direction is not None:
        opposed = isinstance(direction, str) and direction.startswith("-")
        remanence_T = (-1.0 if opposed else 1.0) * warmed.remanence_T
        warmed = replace(warmed, direction=unit_vector(direction), remanence_T=remanence_T)
    return warmed


def _part(place: tuple[str, ...], table: Any, material: Material | None, problems: list[str]) -> DrawnPart | None:
    """A region of its material, or a winding; None without an outline."""
    path, name, winding = joined("", *place), place[-1], is_winding(place)
    if not winding and name in RESERVED:
        complain(problems, "reserved", path, names=" or ".join(RESERVED))
    shape = read_part(OutlineEntry, table)
    drawn = None if shape is None else outline(shape, path, problems)
    if drawn is None:
        return None
    if winding and drawn.polygon.bounds[0] <= 0:
        complain(problems, "winding_on_axis", path)
    return DrawnPart(path, name, drawn, material, moves=winding and table.get("moves") is True)
