"""How far a drawing's numbers may be off: as its ``[tolerances]`` say, or else by the kind of number.

Limits that a standard or a maker guarantees are read as two standard deviations. They are conventional: a drawing's own
``[tolerances]``, by key paths, replace them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from femfit.device.complaints import complain, joined, read_table
from femfit.device.drawing import materials_used
from femfit.device.drawn_faces import CONTOUR, drawn_faces
from femfit.device.file_numbers import nearest_numbers, numbers_of
from femfit.device.keys import keys_of
from femfit.device.schema import ToleranceEntry

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


def read_tolerances(data: Mapping[str, Any], problems: list[str]) -> tuple[dict[str, float], float | None]:
    """Standard deviations by key path, each in its number's unit, and that of all other lengths in mm."""
    table = data.get("tolerances")
    if not isinstance(table, dict):
        return {}, None
    entries = {key: value for key, value in table.items() if key in keys_of(ToleranceEntry)}
    general = read_table(ToleranceEntry, entries, "tolerances", problems)
    keys, tolerances = {*numbers_of(data)}, {}
    for material in materials_used(data):
        # The lists of a magnetisation curve, each of which is scaled as a whole: their tolerances are shares
        keys |= {joined("materials", material, name) for name in ("B_T", "H_A_per_m")}
    for key, value in ((key, value) for key, value in table.items() if key not in entries):
        if CONTOUR in key and any(face.key == key for face in drawn_faces(data)):
            keys.add(key)
        if key not in keys:
            complain(problems, "no_number", key=key, near=", ".join(nearest_numbers(key, data)))
        elif isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < LARGEST:
            complain(problems, "tolerance", key=key, given=str(value)[:60])
        else:
            tolerances[key] = float(value)
    return tolerances, None if general is None else general.length_mm
