"""The drawing of an actuator file: materials, regions and the winding, each region on its own."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from shapely import Polygon

from femfit.device.bh_table import Points, curve_problems, read_bh_csv, without_flat_end
from femfit.device.checks import DrawnPart, outline
from femfit.device.complaints import did_you_mean, joined, read_part, read_table
from femfit.device.materials import LIBRARY
from femfit.device.parts import LinearMaterial, Material, NonlinearMaterial
from femfit.device.schema import NAME_PATTERN, CurveEntry, MaterialEntry, OutlineEntry, RegionEntry

RESERVED = ("air", "coil")
"""Region names that the field solver gives to what is not a region."""


@dataclass(frozen=True)
class Drawing:
    """What could be drawn of a file."""

    # Regions of the electromagnet and of the moving part
    fixed: tuple[DrawnPart, ...]
    moving: tuple[DrawnPart, ...]
    winding: DrawnPart | None
    complete: bool  # Whether every region and the winding could be drawn

    @property
    def standing(self) -> tuple[DrawnPart, ...]:
        """The electromagnet's regions and the winding."""
        return self.fixed if self.winding is None else (*self.fixed, self.winding)


def read_drawing(data: Mapping[str, Any], directory: Path, problems: list[str]) -> Drawing:
    """Draw what can be drawn of a file."""
    materials = _materials(table_at(data, "materials"), directory, problems)
    fixed = _regions(data, "electromagnet", materials, problems)
    moving = _regions(data, "moving", materials, problems)
    problems += [
        f"{part.path} must have a name of its own; electromagnet.regions has one of the same name. Rename one of them."
        for part in moving
        if part.name in {other.name for other in fixed}
    ]
    winding = _winding(data, problems)
    regions = len(table_at(data, "electromagnet", "regions")) + len(table_at(data, "moving", "regions"))
    complete = len(fixed) + len(moving) == regions and winding is not None
    return Drawing(fixed, moving, winding, complete)


def table_at(data: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """The table at a key path, empty if there is none."""
    found: Any = data
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    return found if isinstance(found, dict) else {}


def _materials(tables: Mapping[str, Any], directory: Path, problems: list[str]) -> dict[str, Material | None]:
    """The library and the file's own materials, which come first; None where the file's is wrong."""
    materials: dict[str, Material | None] = {name: entry.material for name, entry in LIBRARY.items()}
    for name, table in tables.items():
        path = joined("materials", name)
        if isinstance(table, dict) and table.keys() & CurveEntry.model_fields.keys():
            materials[name] = _saturating(name, table, path, directory, problems)
            continue
        entry = read_table(MaterialEntry, table, path, problems)
        materials[name] = (
            None
            if entry is None
            else LinearMaterial(name, entry.relative_permeability, entry.remanence_T, entry.remanence_coefficient_per_K)
        )
    return materials


def _saturating(
    name: str, table: Mapping[str, Any], path: str, directory: Path, problems: list[str]
) -> NonlinearMaterial | None:
    entry = read_table(CurveEntry, table, path, problems)
    if entry is None:
        return None
    points: Points | None
    if entry.bh_curve is not None:
        if entry.B_T is not None or entry.H_A_per_m is not None:
            problems.append(
                f"{path} must have one curve; it has bh_curve and a list. Give bh_curve, or B_T and H_A_per_m."
            )
            return None
        path = f"{path}.bh_curve"
        points, found = read_bh_csv(directory / entry.bh_curve)
    elif entry.B_T is None or entry.H_A_per_m is None:
        missing = "B_T" if entry.B_T is None else "H_A_per_m"
        problems.append(
            f"{path}.{missing} is missing; the curve needs B_T and H_A_per_m. Give both lists, or bh_curve."
        )
        return None
    else:
        points, found = (tuple(entry.B_T), tuple(entry.H_A_per_m)), []
    remark = ""
    if points is not None:
        if len(points[0]) == len(points[1]):
            points, remark = without_flat_end(*points)
        found = curve_problems(*points)
    problems += [f"{path} {problem}" for problem in found]
    return None if points is None or found else NonlinearMaterial(name, *points, remark=remark)


def _regions(
    data: Mapping[str, Any], body: str, materials: Mapping[str, Material | None], problems: list[str]
) -> tuple[DrawnPart, ...]:
    parts = []
    for name, table in table_at(data, body, "regions").items():
        path = joined(body, "regions", name)
        if not re.match(NAME_PATTERN, name) or len(name) > 64 or name in RESERVED:
            problems.append(
                f"{path} must be named with letters, digits, - and _, beginning with a letter, and not "
                f"{' or '.join(RESERVED)}. Rename the region."
            )
        entry = read_table(RegionEntry, table, path, problems)
        material = None if entry is None else _region_material(entry, path, materials, problems)
        polygon = _polygon(table, path, problems)
        if polygon is not None:
            parts.append(DrawnPart(path, name, polygon, material))
    return tuple(parts)


def _region_material(
    entry: RegionEntry, path: str, materials: Mapping[str, Material | None], problems: list[str]
) -> Material | None:
    if entry.material not in materials:
        problems.append(
            f"{path}.material must name a material of [materials] or of the library; it is {entry.material[:60]!r}."
            f"{did_you_mean(entry.material, materials)} Known: {', '.join(materials)}."
        )
        return None
    material = materials[entry.material]
    if material is None:
        return None
    if material.remanence_T and entry.magnetization is None:
        problems.append(
            f"{path}.magnetization is missing; {material.name} has a remanence. "
            'Give magnetization = "+z" (towards the moving part) or "-z".'
        )
        return None
    if entry.magnetization and not material.remanence_T:
        problems.append(
            f"{path}.magnetization must be left out; {material.name} has no remanence. "
            "Remove it, or name a magnet or give the material a remanence_T."
        )
        return None
    return _magnet(entry, path, material, problems) if isinstance(material, LinearMaterial) else material


def _magnet(entry: RegionEntry, path: str, material: LinearMaterial, problems: list[str]) -> LinearMaterial | None:
    """The material at the region's temperature, turned as the region says."""
    if entry.temperature_C is not None:
        if not material.remanence_coefficient_per_K or not material.remanence_T:
            problems.append(
                f"{path}.temperature_C must be left out; {material.name} has no remanence_coefficient_per_K. "
                "Remove it, or give the material one (-0.0012 is usual for NdFeB)."
            )
            return None
        material = material.at_temperature(entry.temperature_C)
        if material.remanence_T <= 0:
            problems.append(
                f"{path}.temperature_C must leave a remanence; at {entry.temperature_C:g} degC there is none. "
                "Change it, or the material's remanence_coefficient_per_K."
            )
            return None
    return replace(material, remanence_T=-material.remanence_T) if entry.magnetization == "-z" else material


def _winding(data: Mapping[str, Any], problems: list[str]) -> DrawnPart | None:
    polygon = _polygon(data["coil"], "coil", problems) if isinstance(data.get("coil"), dict) else None
    if polygon is None:
        return None
    if polygon.bounds[0] <= 0:
        problems.append("coil must lie off the axis; its winding touches r = 0. Give an inner radius > 0.")
    return DrawnPart("coil", "coil", polygon)


def _polygon(table: object, path: str, problems: list[str]) -> Polygon | None:
    entry = read_part(OutlineEntry, table)
    return None if entry is None else outline(entry, path, problems)
