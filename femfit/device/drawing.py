"""The drawing of an actuator file: materials, regions and windings, each on its own."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from femfit.device.bh import Points, curve_problems, read_bh_csv, without_flat_end
from femfit.device.checks import DrawnPart
from femfit.device.complaints import did_you_mean, joined, read_part, read_table
from femfit.device.decimals import MEGA_EXPONENT, scaled
from femfit.device.materials import LIBRARY
from femfit.device.outlines import outline
from femfit.device.parts import LinearMaterial, Material, NonlinearMaterial
from femfit.device.schema import NAME_PATTERN, OutlineEntry, RegionEntry
from femfit.device.schema_device import ConductorEntry, CurveEntry, MaterialEntry, has_curve
from femfit.device.thermal import ThermalMaterial

RESERVED = ("air", "coil")
"""Region names that the field solver gives to what is not a region."""


@dataclass(frozen=True)
class DrawnWinding:
    """A coil as drawn."""

    part: DrawnPart
    moves: bool


@dataclass(frozen=True)
class Drawing:
    """What could be drawn of a file."""

    # Regions of the fixed and of the moving part, without windings
    fixed: tuple[DrawnPart, ...]
    moving: tuple[DrawnPart, ...]
    windings: tuple[DrawnWinding, ...]
    complete: bool  # Whether every region and winding could be drawn

    @property
    def standing(self) -> tuple[DrawnPart, ...]:
        """All that stands still: regions and windings."""
        return (*self.fixed, *(winding.part for winding in self.windings if not winding.moves))

    @property
    def mover(self) -> tuple[DrawnPart, ...]:
        """All that moves: regions and windings."""
        return (*self.moving, *(winding.part for winding in self.windings if winding.moves))


def read_drawing(data: Mapping[str, Any], directory: Path, problems: list[str]) -> Drawing:
    """Draw what can be drawn of a file."""
    materials = _materials(table_at(data, "materials"), directory, problems)
    body = fixed_key(data)
    fixed = _regions(data, body, materials, problems)
    moving = _regions(data, "moving", materials, problems)
    problems += [
        f"{part.path} must have a name of its own; {body}.regions has one of the same name. Rename one of them."
        for part in moving
        if part.name in {body.name for body in fixed}
    ]
    tables = dict(coil_tables(data))
    windings = tuple(
        winding for path, table in tables.items() if (winding := _winding(path, table, problems)) is not None
    )
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


def table_at(data: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """The table at a key path, empty if there is none."""
    data_at_path: Any = data
    for key in keys:
        data_at_path = data_at_path.get(key) if isinstance(data_at_path, dict) else None
    return data_at_path if isinstance(data_at_path, dict) else {}


def _materials(tables: Mapping[str, Any], directory: Path, problems: list[str]) -> dict[str, Material | None]:
    """The library and the file's own materials, which come first; None where the file's is wrong."""
    materials: dict[str, Material | None] = {name: entry.material for name, entry in LIBRARY.items()}
    for name, table in tables.items():
        path = joined("materials", name)
        if has_curve(table):
            materials[name] = _saturating(name, table, path, directory, problems)
            continue
        entry = read_table(MaterialEntry, table, path, problems)
        if entry is None:
            materials[name] = None
            continue
        thermal = ThermalMaterial(working_temperature_C=entry.working_temperature_C)
        linear = LinearMaterial(
            name, entry.relative_permeability, entry.remanence_T, entry.remanence_coefficient_per_K, thermal=thermal
        )
        materials[name] = _conducting(linear, entry, path, problems)
    return materials


def _conducting(material: Material, entry: ConductorEntry, path: str, problems: list[str]) -> Material:
    if entry.lamination_mm and not entry.conductivity_MS_per_m:
        problems.append(
            f"{path}.lamination_mm must stand beside a conductivity_MS_per_m > 0; sheets that do not conduct are a "
            "solid part. Give the conductivity of the sheets (electrical steel 2 to 5), or leave lamination_mm out."
        )
    capacity = entry.heat_capacity_MJ_per_m3_K
    return replace(
        material,
        conductivity_S_per_m=scaled(entry.conductivity_MS_per_m, MEGA_EXPONENT),
        lamination_m=scaled(entry.lamination_mm),
        thermal=replace(
            material.thermal,
            conductivity_W_per_m_K=entry.thermal_conductivity_W_per_m_K,
            heat_capacity_J_per_m3_K=capacity and scaled(capacity, MEGA_EXPONENT),
        ),
    )


def _curve(named: str, directory: Path) -> tuple[Points | None, list[str]]:
    """B and H of a material of the library, or of a file, as of :func:`read_bh_csv`."""
    library_material = LIBRARY.get(named)
    if library_material is not None and isinstance(library_material.material, NonlinearMaterial):
        return (library_material.material.flux_density_T, library_material.material.field_A_per_m), []
    return read_bh_csv(directory / named)


def _saturating(
    name: str, table: Mapping[str, Any], path: str, directory: Path, problems: list[str]
) -> Material | None:
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
        points, curve = _curve(entry.bh_curve, directory)
    elif entry.B_T is None or entry.H_A_per_m is None:
        missing = "B_T" if entry.B_T is None else "H_A_per_m"
        problems.append(
            f"{path}.{missing} is missing; the curve needs B_T and H_A_per_m. Give both lists, or bh_curve."
        )
        return None
    else:
        points, curve = (tuple(entry.B_T), tuple(entry.H_A_per_m)), []
    remark = ""
    if points is not None:
        if len(points[0]) == len(points[1]):
            points, remark = without_flat_end(*points)
        curve = curve_problems(*points)
    problems += [f"{path} {problem}" for problem in curve]
    if points is None or curve:
        return None
    return _conducting(NonlinearMaterial(name, *points, remark=remark), entry, path.removesuffix(".bh_curve"), problems)


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
        part = _part(table, path, name, material, problems)
        if part is not None:
            parts.append(part)
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
            'Give magnetization = "+z" (towards the moving part), "-z", "+r", "-r" or [r, z].'
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
    direction = entry.magnetization
    if isinstance(direction, list):
        unit = unit_vector(direction, f"{path}.magnetization", problems)
        return None if unit is None else replace(material, direction=unit)
    if direction in {"+r", "-r"}:
        material = replace(material, direction=(1.0, 0.0))
    return replace(material, remanence_T=-material.remanence_T) if direction in {"-z", "-r"} else material


def unit_vector(values: list[float], path: str, problems: list[str]) -> tuple[float, float] | None:
    """A direction [r, z] of length one; None where it has no length."""
    length = math.hypot(*values)
    if length == 0.0:
        problems.append(
            f"{path} must have a direction; [0, 0] has none. Give for example [1, 0] for radially outwards."
        )
        return None
    return values[0] / length, values[1] / length


def _winding(path: str, table: Any, problems: list[str]) -> DrawnWinding | None:
    name = path.removeprefix("coils.")
    check_name(name, path, problems)
    part = _part(table, path, name, None, problems)
    if part is None or not isinstance(table, dict):
        return None
    if part.polygon.bounds[0] <= 0:
        problems.append(f"{path} must lie off the axis; its winding touches r = 0. Give an inner radius > 0.")
    return DrawnWinding(part, table.get("moves") is True)


def check_name(name: str, path: str, problems: list[str]) -> None:
    """Report a name that columns and files cannot have."""
    if not re.match(NAME_PATTERN, name) or len(name) > 64:
        problems.append(f"{path} must be named with letters, digits, - and _, beginning with a letter. Rename it.")


def _part(table: object, path: str, name: str, material: Material | None, problems: list[str]) -> DrawnPart | None:
    entry = read_part(OutlineEntry, table)
    drawn = None if entry is None else outline(entry, path, problems)
    return None if drawn is None else DrawnPart(path, name, drawn, material)
