"""What a sweep can set in an actuator file, by key path: every number, and the materials that regions name."""

import difflib
from collections.abc import Iterator, Mapping
from itertools import chain
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from femfit.device.complaints import joined, table_at, tables_of
from femfit.device.decimals import scaled, si_key
from femfit.device.materials import LIBRARY
from femfit.device.parts import NonlinearMaterial
from femfit.device.schema_device import BODIES, has_curve, material_entry

Location = tuple[str | int, ...]
"""Keys and list positions from the top of the file."""

UNITS = (
    "A_per_m", "MS_per_m", "V_per_T", "N_per_mm", "V_per_mm", "N_s_per_m", "m_per_s2", "per_K", "mm", "ms", "mH", "ohm",
    "deg", "Hz", "g", "T", "C", "V", "A", "N",
)  # fmt: skip
"""That numbers of the file may be in; a key ends in ``_`` and its unit, or is a bare number."""

SI_UNITS = {"mm": "m", "ms": "s", "g": "kg", "mH": "H"}
"""SI units of the units that actuator files use; each of these is a thousandth."""


def numbers_of(data: Mapping[str, Any]) -> dict[str, Location]:
    """Where the numbers of a file are.

    Returns
    -------
    dict
        Locations by key path; also optional numbers that the file leaves out, and those of library materials in use.
    """
    return {joined("", *location): location for location in _locations(data)}


def material_keys(data: Mapping[str, Any]) -> dict[str, Location]:
    """Where the regions of a file name their materials."""
    places = ((body, "regions", name, "material") for body in BODIES for name in table_at(data, body, "regions"))
    return {joined("", *place): place for place in places}


def known_materials(data: Mapping[str, Any]) -> tuple[str, ...]:
    """Names that a region may have as its material: the library's and the file's own."""
    return tuple(dict.fromkeys([*LIBRARY, *table_at(data, "materials")]))


SOFT = 10.0
"""Conventional: relative permeability from which a part carries flux, as a pole does; magnets have little above 1."""


def conducts_flux(data: Mapping[str, Any], material: object) -> bool:
    """Whether a material of the file, or of the library, is soft magnetic."""
    table = table_at(data, "materials").get(str(material))
    if table is None and str(material) in LIBRARY:
        table = library_table(str(material))
    return has_curve(table) or (isinstance(table, dict) and table.get("relative_permeability", 1.0) > SOFT)


def with_value(data: dict[str, Any], location: Location, value: float | str) -> None:
    """Set a number of a file, or the name of a material, in place."""
    first, name = location[:2]
    if first == "materials" and name not in table_at(data, "materials"):
        data.setdefault("materials", {})[name] = library_table(str(name))
    place: Any = data
    for key in location[:-1]:
        place = place[key]
    place[location[-1]] = value


_NOT_OF_THE_DEVICE = {
    "schema": "it says how the file is written",
    "sweep": "it is of the grid itself",
    "solver": "it says how the field is solved, not what the device is",
    "thermal": "temperatures alone depend on it, which a sweep does not solve",
    "reference": "it says what a closed loop is asked for, not what the device is",
    "tolerances": "it says how far another number may be off",
}
_BITS = "bits", "adc_bits"


def why_no_number(path: str) -> str:
    """Why a number of the file can neither be swept nor be off; empty for all others."""
    first, last = path.partition(".")[0], path.rpartition(".")[2]
    return "a converter has a whole number of bits" if last in _BITS else _NOT_OF_THE_DEVICE.get(first, "")


def nearest_numbers(path: str, data: Mapping[str, Any]) -> list[str]:
    """The key paths closest to one that does not exist, closest first."""
    numbers = [*numbers_of(data), *material_keys(data)]
    inside = [name for name in numbers if path and name.startswith((f"{path}.", f"{path}["))]
    return list(dict.fromkeys([*inside, *difflib.get_close_matches(path[:200], numbers, n=4, cutoff=0.4)]))[:4]


def unit_of(name: str) -> str:
    """The unit that a key or a column ends in, empty for bare numbers."""
    return next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")


def _locations(data: Mapping[str, Any]) -> Iterator[Location]:
    regions = [table for body in BODIES for table in table_at(data, body, "regions").values()]
    used = {str(table.get("material")) for table in regions if isinstance(table, dict)}
    library = sorted((used - table_at(data, "materials").keys()) & LIBRARY.keys())
    tables = ((("materials", name), material_entry(library_table(name)), dict[str, Any]()) for name in library)
    for place, entry, table in chain(tables_of(data), tables):
        if why_no_number(place[0]) or not isinstance(table, dict):
            continue
        for key, info in entry.model_fields.items():
            if _is_number(info.annotation):
                yield (*place, key)
            elif isinstance(table.get(key), list):
                yield from _in_list(table[key], (*place, key))


def _is_number(annotation: object) -> bool:
    """Whether a field holds a number, under whatever alias and with or without None beside it."""
    return annotation is float or (
        get_origin(annotation) in {Annotated, Union, UnionType} and any(map(_is_number, get_args(annotation)))
    )


def _in_list(values: list[Any], path: Location) -> Iterator[Location]:
    for place, value in enumerate(values):
        if isinstance(value, list):
            yield from _in_list(value, (*path, place))
        elif isinstance(value, int | float):
            yield (*path, place)


def library_table(name: str) -> dict[str, Any]:
    """A material of the library as an actuator file would write it."""
    material = LIBRARY[name].material
    if isinstance(material, NonlinearMaterial):
        table: dict[str, Any] = {"B_T": list(material.flux_density_T), "H_A_per_m": list(material.field_A_per_m)}
    else:
        table = {}
    values = vars(material) | {_THERMAL.get(key, key): value for key, value in vars(material.thermal).items()}
    for key in material_entry(table).model_fields:
        si, power = si_key(key)
        if values.get(si) is not None:
            table[key] = scaled(values[si], -power) if power else values[si]
    return table


_THERMAL = {"conductivity_W_per_m_K": "thermal_conductivity_W_per_m_K"}
"""Keys of materials that their fields are not named after."""
