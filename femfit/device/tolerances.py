"""The numbers of an actuator file by their key paths, and how far each may be off.

That is as its ``[tolerances]`` say, by key paths, or else by the kind of number: conventional values, for which limits
that a standard or a maker guarantees are read as two standard deviations.
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from femfit.device.complaints import complain, in_file, joined, read_table, table_at, tables_of
from femfit.device.drawing import materials_used
from femfit.device.drawn_faces import CONTOUR, drawn_faces
from femfit.device.keys import Place, keys_of
from femfit.device.materials import LIBRARY
from femfit.device.parts import CURVE_KEYS, LinearMaterial
from femfit.device.schema import ToleranceEntry
from femfit.device.thermal import ThermalMaterial

_ISO_2768_M = ((3.0, 0.1), (6.0, 0.1), (30.0, 0.2), (120.0, 0.3), (400.0, 0.5), (1000.0, 0.8), (2000.0, 1.2))
"""Limits in mm of lengths in mm up to so much, ISO 2768-1 (1989), table 1, class m."""

_LONGER = 2.0


@dataclass(frozen=True)
class Kind:
    """A kind of number."""

    tolerance: float  # Standard deviation: a share of the number; of lengths :func:`length_tolerance`
    words: str  # What it is, with ``{name}`` for the material's or the coil's name
    reciprocal: bool = False  # Whether the field's equations have its reciprocal, as the reluctivity of a permeability
    at_rest: bool = True  # Whether a field at rest depends on it


KINDS: dict[str, Kind] = {
    "length": Kind(0.0, "{key}"),
    "hall_place": Kind(0.0, "{key}"),
    # Ferrites are sold to +-20 to 25 % (Ferroxcube, Soft Ferrites and Accessories); annealed steel scatters as much
    "permeability": Kind(0.12, "the permeability of {name}", reciprocal=True),
    # 1.03 to 1.07 within the grades of NdFeB
    "recoil_permeability": Kind(0.01, "the recoil permeability of {name}", reciprocal=True),
    "remanence": Kind(0.015, "the remanence of {name}"),  # +-3 % within a grade, IEC 60404-8-1
    "curve_flux_density": Kind(0.02, "the flux density of {name} at every field"),  # polarisation by composition
    "curve_field": Kind(0.15, "the field that {name} needs for every flux density"),  # annealing and machining
    # 143 to 171 nOhm m from steel 1010 to 1018 at 20 degC, and 0.4 to 0.6 %/K
    "conductivity": Kind(0.1, "the conductivity of {name}", at_rest=False),
    "lamination": Kind(0.04, "the thickness of a sheet of {name}", at_rest=False),  # +-8 % of 0.35 and 0.5 mm, EN 10106
    "turns": Kind(0.005, "the number of turns of {name}"),
    "resistance": Kind(0.02, "the resistance of {name}"),  # round wire, IEC 60317-0-1
}


def length_tolerance(length: float) -> float:
    """Of a length in mm, in mm: half of the general tolerance's limit."""
    return 0.5 * next((limit for longest, limit in _ISO_2768_M if abs(length) <= longest), _LONGER)


LARGEST = 1e5
"""No number of a drawing has a larger standard deviation."""


WITHOUT_FIELD = {
    *keys_of(ThermalMaterial),
    *(name for name, key in keys_of(LinearMaterial).items() if key.kind and not KINDS[key.kind].at_rest),
}
"""Keys of materials on which no field at rest depends."""


def numbers_of(data: Mapping[str, Any]) -> dict[str, Place]:
    """Where the numbers of a file are.

    Returns
    -------
    dict
        Locations by key path; also optional numbers that the file leaves out, and those of library materials in use.
    """
    library = sorted((materials_used(data) - table_at(data, "materials").keys()) & LIBRARY.keys())
    written = [(place, record, table) for place, record, table, key in tables_of(data) if key.of_device]
    unwritten = [(("materials", name), type(LIBRARY[name].material), dict[str, Any]()) for name in library]
    locations: list[Place] = []
    for place, record, table in (*written, *unwritten):
        if isinstance(table, dict):
            for name, key in keys_of(record).items():
                locations += [(*place, name)] if key.is_number else _in_list(table.get(name), (*place, name))
    return {in_file(data, joined("", *location)): location for location in locations}


def _in_list(value: object, place: Place) -> Iterator[Place]:
    if isinstance(value, list):
        for k, each in enumerate(value):
            yield from _in_list(each, (*place, k))
    elif isinstance(value, int | float) and isinstance(place[-1], int):
        yield place


def value_at(data: Mapping[str, Any], location: Place) -> Any:
    """What stands at a place of a file; None where it leaves that out."""
    place: Any = data
    for key in location:
        place = place.get(key) if isinstance(place, dict) else place[key]
        if place is None:
            return None
    return place


def with_value(data: dict[str, Any], location: Place, value: float | str | list[float]) -> None:
    """Set a number of a file, a list of them, or the name of a material, in place."""
    first, name = location[:2]
    if first == "materials" and name not in table_at(data, "materials"):
        data.setdefault("materials", {})[name] = LIBRARY[str(name)].table
    value_at(data, location[:-1])[location[-1]] = value


def nearest(path: str, paths: Iterable[str]) -> list[str]:
    """The key paths closest to one that does not exist, closest first."""
    paths = list(paths)
    inside = [name for name in paths if path and name.startswith((f"{path}.", f"{path}["))]
    return list(dict.fromkeys([*inside, *difflib.get_close_matches(path[:200], paths, n=4, cutoff=0.4)]))[:4]


def read_tolerances(data: Mapping[str, Any], problems: list[str]) -> tuple[dict[str, float], float | None]:
    """Standard deviations by key path, each in its number's unit, and that of all other lengths in mm."""
    table = data.get("tolerances")
    if not isinstance(table, dict):
        return {}, None
    entries = {key: value for key, value in table.items() if key in keys_of(ToleranceEntry)}
    general = read_table(ToleranceEntry, entries, "tolerances", problems)
    # The lists of a magnetisation curve, each of which is scaled as a whole: their tolerances are shares
    curves = {joined("materials", name, key) for name in materials_used(data) for key in CURVE_KEYS}
    faces = drawn_faces(data) if any(CONTOUR in key for key in table) else []
    contours = {in_file(data, face.key) for face in faces}
    numbers, tolerances = numbers_of(data), {}
    for key, value in ((key, value) for key, value in table.items() if key not in entries):
        if not key or key not in {*numbers, *curves, *contours}:
            near = ", ".join(nearest(key, numbers))
            complain(problems, "no_number", key=key, near=f" Near it: {near}." if near else "")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < LARGEST:
            complain(problems, "tolerance", key=key, given=str(value)[:60])
        else:
            tolerances[key] = float(value)
    return tolerances, None if general is None else general.length_mm
