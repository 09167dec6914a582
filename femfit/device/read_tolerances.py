"""[tolerances]: how far numbers of the file may be off, by their key paths."""

from collections.abc import Iterator, Mapping
from typing import Any

from femfit.device.complaints import joined, read_table
from femfit.device.drawing import fixed_key, table_at
from femfit.device.drawn_faces import CONTOUR, drawn_faces
from femfit.device.file_numbers import nearest_numbers, numbers_of, why_no_number
from femfit.device.schema import ToleranceEntry

LARGEST = 1e5
"""No number of a drawing has a larger standard deviation."""


def read_tolerances(data: Mapping[str, Any], problems: list[str]) -> tuple[dict[str, float], float | None]:
    """Standard deviations by key path, each in its number's unit, and that of all other lengths in mm."""
    table = data.get("tolerances")
    if not isinstance(table, dict):
        return {}, None
    own = {key: value for key, value in table.items() if key in ToleranceEntry.model_fields}
    general = read_table(ToleranceEntry, own, "tolerances", problems)
    known, given = {*numbers_of(data), *_curve_keys(data)}, {}
    for key, value in table.items():
        if key in own:
            continue
        if CONTOUR in key and any(face.key == key for face in drawn_faces(data)):
            known.add(key)
        if key not in known and (why := why_no_number(key)):
            problems.append(f"tolerances.{key!r} cannot be given: {why}. Leave it out.")
        elif key not in known:
            near = ", ".join(nearest_numbers(key, data))
            problems.append(f"tolerances.{key!r} must be a key path of this file in quotes. Near it: {near}.")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < LARGEST:
            problems.append(
                f"tolerances.{key!r} must be a number > 0; it is {str(value)[:60]!r}. Give the number's standard "
                "deviation."
            )
        else:
            given[key] = float(value)
    return given, None if general is None else general.length_mm


def _curve_keys(data: Mapping[str, Any]) -> Iterator[str]:
    """The lists of magnetisation curves, each of which is scaled as a whole: their tolerances are shares."""
    bodies = (fixed_key(data), "moving")
    for material in {str(one.get("material")) for body in bodies for one in table_at(data, body, "regions").values()}:
        for key in ("B_T", "H_A_per_m"):
            yield joined("materials", material, key)
