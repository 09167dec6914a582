"""The drawing of an actuator file: materials, regions and windings, each on its own."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from femfit.device.bh import curve_problems, read_bh_csv, without_flat_end
from femfit.device.checks import DrawnPart
from femfit.device.complaints import did_you_mean, joined, read_part, table_at
from femfit.device.decimals import in_si
from femfit.device.materials import LIBRARY
from femfit.device.outlines import outline
from femfit.device.parts import LinearMaterial, Material, NonlinearMaterial
from femfit.device.schema import OutlineEntry, RegionEntry
from femfit.device.schema_device import CurveEntry
from femfit.device.thermal import ThermalMaterial

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
    for name in table_at(data, "materials"):
        entry = entries.get(joined("materials", name))
        materials[name] = None if entry is None else _material(name, entry, directory, problems)
    body = fixed_key(data)
    fixed, moving = (_regions(data, key, entries, materials, problems) for key in (body, "moving"))
    names = {part.name for part in fixed}
    problems += [
        f"{part.path} must have a name of its own; {body}.regions has one of the same name. Rename one of them."
        for part in moving
        if part.name in names
    ]
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


_THERMAL = {
    "thermal_conductivity_W_per_m_K": "conductivity_W_per_m_K",
    "heat_capacity_J_per_m3_K": "heat_capacity_J_per_m3_K",
    "working_temperature_C": "working_temperature_C",
}
"""Fields of :class:`ThermalMaterial` by the keys of a material in SI units."""


def _material(name: str, entry: Any, directory: Path, problems: list[str]) -> Material | None:
    values = in_si(entry, "bh_curve", "B_T", "H_A_per_m")
    heat = {field: values.pop(key) for key, field in _THERMAL.items() if key in values}
    if not isinstance(entry, CurveEntry):
        return LinearMaterial(name, thermal=ThermalMaterial(**heat), **values)
    path = joined("materials", name)
    library_material, points, wrong = LIBRARY.get(entry.bh_curve or ""), None, list[str]()
    if entry.bh_curve is None:
        points = tuple(entry.B_T or ()), tuple(entry.H_A_per_m or ())
    elif library_material is not None and isinstance(library_material.material, NonlinearMaterial):
        points = library_material.material.flux_density_T, library_material.material.field_A_per_m
    else:
        points, wrong = read_bh_csv(directory / entry.bh_curve)
    remark = ""
    if points is not None:
        if len(points[0]) == len(points[1]):
            points, remark = without_flat_end(*points)
        wrong = curve_problems(*points)
    problems += [f"{path}{'.bh_curve' * (entry.bh_curve is not None)} {problem}" for problem in wrong]
    if points is None or wrong:
        return None
    return NonlinearMaterial(name, *points, remark=remark, thermal=ThermalMaterial(**heat), **values)


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
            problems.append(f"{path} must not be named {' or '.join(RESERVED)}. Rename the region.")
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
        problems.append(
            f"{path}.material must name a material of [materials] or of the library; it is {entry.material[:60]!r}."
            f"{did_you_mean(entry.material, materials)} Known: {', '.join(materials)}."
        )
        return None
    material, celsius, direction = materials[entry.material], entry.temperature_C, entry.magnetization
    if material is None:
        return None
    problem, warmed, warmth = "", material, 0.0
    if celsius is not None and isinstance(material, LinearMaterial):
        warmed, warmth = material.at_temperature(celsius), material.remanence_coefficient_per_K * material.remanence_T
    if material.remanence_T and direction is None:
        problem = (
            f"magnetization is missing; {material.name} has a remanence. "
            'Give magnetization = "+z" (towards the moving part), "-z", "+r", "-r" or [r, z].'
        )
    elif direction and not material.remanence_T:
        problem = (
            f"magnetization must be left out; {material.name} has no remanence. "
            "Remove it, or name a magnet or give the material a remanence_T."
        )
    elif warmed is not material and not warmth:
        problem = (
            f"temperature_C must be left out; {material.name} has no remanence_coefficient_per_K. "
            "Remove it, or give the material one (-0.0012 is usual for NdFeB)."
        )
    elif warmed is not material and warmed.remanence_T <= 0:
        problem = (
            f"temperature_C must leave a remanence; at {celsius:g} degC there is none. "
            "Change it, or the material's remanence_coefficient_per_K."
        )
    if problem:
        problems.append(f"{path}.{problem}")
    elif isinstance(warmed, LinearMaterial) and direction is not None:
        unit = unit_vector(direction, f"{path}.magnetization", problems) or warmed.direction
        opposed = isinstance(direction, str) and direction.startswith("-")
        warmed = replace(warmed, direction=unit, remanence_T=(-1.0 if opposed else 1.0) * warmed.remanence_T)
    return None if problem else warmed


_DIRECTIONS = {"z": (0.0, 1.0), "r": (1.0, 0.0)}


def unit_vector(values: list[float] | str, path: str, problems: list[str]) -> tuple[float, float] | None:
    """A direction of length one, given as [r, z] or by its axis, whatever its sign; None where it has no length."""
    if isinstance(values, str):
        return _DIRECTIONS[values[-1]]
    length = math.hypot(*values)
    if length == 0.0:
        problems.append(
            f"{path} must have a direction; [0, 0] has none. Give for example [1, 0] for radially outwards."
        )
        return None
    return values[0] / length, values[1] / length


def _winding(path: str, table: Any, problems: list[str]) -> DrawnPart | None:
    part = _part(table, path, path.removeprefix("coils."), None, problems)
    if part is None or not isinstance(table, dict):
        return None
    if part.polygon.bounds[0] <= 0:
        problems.append(f"{path} must lie off the axis; its winding touches r = 0. Give an inner radius > 0.")
    return replace(part, moves=table.get("moves") is True)


def _part(table: object, path: str, name: str, material: Material | None, problems: list[str]) -> DrawnPart | None:
    entry = read_part(OutlineEntry, table)
    drawn = None if entry is None else outline(entry, path, problems)
    return None if drawn is None else DrawnPart(path, name, drawn, material)
