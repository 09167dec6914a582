"""The drawing of an actuator file: materials, regions and windings, each on its own."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from femfit.device.bh import curve_problems, read_bh_csv, without_flat_end
from femfit.device.checks import DrawnPart
from femfit.device.complaints import complain, did_you_mean, joined, read_part, table_at
from femfit.device.electrics import unit_vector
from femfit.device.materials import LIBRARY
from femfit.device.outline_entry import OutlineEntry
from femfit.device.outlines import outline
from femfit.device.parts import LinearMaterial, Material, NonlinearMaterial
from femfit.device.schema import RegionEntry

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


def read_drawing(data: Mapping[str, Any], entries: Mapping[str, Any], directory: Path, problems: list[str]) -> Drawing:
    """Draw what can be drawn of a file, whose right tables are ``entries`` by their key paths."""
    # The file's own materials come first; None where one of them is wrong
    materials: dict[str, Material | None] = {name: entry.material for name, entry in LIBRARY.items()}
    for name, table in table_at(data, "materials").items():
        entry = entries.get(joined("materials", name))
        materials[name] = None if entry is None else _material(entry, table, directory, problems)
    body = fixed_key(data)
    fixed, moving = (_regions(data, key, entries, materials, problems) for key in (body, "moving"))
    names = {part.name for part in fixed}
    for part in (part for part in moving if part.name in names):
        complain(problems, "region_twice", part.path, body=body)
    tables = dict(coil_tables(data))
    drawn = [_winding(path, table, problems) for path, table in tables.items()]
    windings = tuple(winding for winding in drawn if winding is not None)
    regions = len(table_at(data, body, "regions")) + len(table_at(data, "moving", "regions"))
    complete = len(fixed) + len(moving) == regions and len(windings) == len(tables)
    return Drawing(fixed, moving, windings, complete)


def fixed_key(data: Mapping[str, Any]) -> str:
    """Which table has the fixed regions: ``fixed``, or ``electromagnet`` as in schema 1."""
    return "fixed" if "fixed" in data else "electromagnet"


def coil_tables(data: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Key path and table of each winding: ``[coil]``, or those of ``[coils]``."""
    if isinstance(data.get("coil"), dict):
        yield "coil", data["coil"]
    for name, table in table_at(data, "coils").items():
        yield joined("coils", name), table


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


def _regions(
    data: Mapping[str, Any],
    body: str,
    entries: Mapping[str, Any],
    materials: Mapping[str, Material | None],
    problems: list[str],
) -> tuple[DrawnPart, ...]:
    parts = []
    for name, table in table_at(data, body, "regions").items():
        path = joined(body, "regions", name)
        if name in RESERVED:
            complain(problems, "reserved", path, names=" or ".join(RESERVED))
        entry = entries.get(path)
        material = None if entry is None else _region_material(entry, path, materials, problems)
        part = _part(table, path, name, material, problems)
        if part is not None:
            parts.append(part)
    return tuple(parts)


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
        warmed = material.at_temperature(celsius)
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


def _winding(path: str, table: Any, problems: list[str]) -> DrawnPart | None:
    part = _part(table, path, path.removeprefix("coils."), None, problems)
    if part is None or not isinstance(table, dict):
        return None
    if part.polygon.bounds[0] <= 0:
        complain(problems, "winding_on_axis", path)
    return replace(part, moves=table.get("moves") is True)


def _part(table: object, path: str, name: str, material: Material | None, problems: list[str]) -> DrawnPart | None:
    entry = read_part(OutlineEntry, table)
    drawn = None if entry is None else outline(entry, path, problems)
    return None if drawn is None else DrawnPart(path, name, drawn, material)
