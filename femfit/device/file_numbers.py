"""What a sweep can set in an actuator file, by key path: every number, and the materials that regions name."""

import difflib
from collections.abc import Iterator, Mapping
from typing import Any

from femfit.device.complaints import joined, table_at, tables_of
from femfit.device.drawing import is_winding, materials_used, part_tables
from femfit.device.keys import keys_of
from femfit.device.materials import LIBRARY
from femfit.device.thermal import ThermalMaterial

Location = tuple[str | int, ...]
"""Keys and list positions from the top of the file."""


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
    regions = (place for place, _ in part_tables(data) if not is_winding(place))
    return {joined("", *place, "material"): (*place, "material") for place in regions}


def with_value(data: dict[str, Any], location: Location, value: float | str) -> None:
    """Set a number of a file, or the name of a material, in place."""
    first, name = location[:2]
    if first == "materials" and name not in table_at(data, "materials"):
        data.setdefault("materials", {})[name] = LIBRARY[str(name)].table
    place: Any = data
    for key in location[:-1]:
        place = place[key]
    place[location[-1]] = value


def value_at(data: Mapping[str, Any], location: Location) -> Any:
    """What stands at a place of a file; None where it leaves that out."""
    place: Any = data
    for key in location:
        place = place.get(key) if isinstance(place, dict) else place[key]
        if place is None:
            return None
    return place


WITHOUT_FIELD = {"conductivity_MS_per_m", "lamination_mm", *keys_of(ThermalMaterial)}
"""Keys of materials on which no field at rest depends."""

NOT_OF_THE_DEVICE = ("schema", "sweep", "solver", "thermal", "reference", "tolerances")
"""Tables whose numbers can neither be swept nor be off: they say how it is solved, heated or used, not what it is."""


def nearest_numbers(path: str, data: Mapping[str, Any]) -> list[str]:
    """The key paths closest to one that does not exist, closest first."""
    numbers = [*numbers_of(data), *material_keys(data)]
    inside = [name for name in numbers if path and name.startswith((f"{path}.", f"{path}["))]
    return list(dict.fromkeys([*inside, *difflib.get_close_matches(path[:200], numbers, n=4, cutoff=0.4)]))[:4]


def _locations(data: Mapping[str, Any]) -> Iterator[Location]:
    library = sorted((materials_used(data) - table_at(data, "materials").keys()) & LIBRARY.keys())
    unwritten = [(("materials", name), type(LIBRARY[name].material), dict[str, Any](), None) for name in library]
    for place, record, table, _ in (*tables_of(data), *unwritten):
        if place[0] in NOT_OF_THE_DEVICE or not isinstance(table, dict):
            continue
        for name, key in keys_of(record).items():
            if key.is_number:
                yield (*place, name)
            elif isinstance(table.get(name), list):
                yield from _in_list(table[name], (*place, name))


def _in_list(values: list[Any], path: Location) -> Iterator[Location]:
    for place, value in enumerate(values):
        if isinstance(value, list):
            yield from _in_list(value, (*path, place))
        elif isinstance(value, int | float):
            yield (*path, place)
