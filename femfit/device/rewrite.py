"""The text of an actuator file with other numbers in it, its comments and its layout kept."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import tomlkit

from femfit.core.errors import ActuatorFileError, OutputError
from femfit.core.paths import path_of
from femfit.device.complaints import joined
from femfit.device.decimals import decimal_sum
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.file_numbers import Location, library_table, numbers_of, with_value
from femfit.device.load import actuator_from_tables, actuator_from_toml, parse, read_text
from femfit.device.parts import Actuator, NonlinearMaterial

_DIGITS = 9
"""Significant digits of the points of a scaled curve."""


def drawing_text(path: str | Path) -> str:
    """The text of an actuator file with its line ends as they are; errors as of ``read_actuator``."""
    path = path_of(path, "An actuator file")
    read_text(path)  # says what is wrong with a file that cannot be read
    return path.read_bytes().decode("utf-8-sig")


def require_same_elsewhere(drawing: Path, written: Path) -> None:
    """Refuse a place for a drawing from which the further files that it names are not found."""
    text = drawing_text(drawing)
    try:
        same = actuator_from_toml(text, str(drawing), drawing.parent) == actuator_from_toml(
            text, str(written), written.parent
        )
    except ActuatorFileError:
        actuator_from_toml(text, str(drawing), drawing.parent)  # its own problems are said of itself
        same = False
    if not same:
        raise OutputError(
            f"{drawing} names further files relative to itself, which are not beside {written}. Write it beside "
            "the old drawing."
        )


def rewritten(
    text: str, values: Iterable[tuple[NumberFacts, float]], source: str, directory: Path | None = None
) -> str:
    """The text with other values of its numbers; those of faces move all their places by the same length.

    A number of a library's material, or a curve from a file, is written into ``[materials.NAME]``; the value of a curve
    is a factor.
    """
    drawn = parse(text, source)
    locations, tables = numbers_of(drawn), tomlkit.parse(text)
    for one, value in values:
        if value == one.value:
            continue
        if one.kind.startswith("curve_"):
            _scale_curve(tables, one.key, value, actuator_from_tables(drawn, source, directory))
        elif one.unit:
            for path in one.paths:
                before = _at(drawn, locations[path])
                with_value(tables, locations[path], decimal_sum(decimal_sum(before, -1.0, one.value), 1.0, value))
        else:
            before = _at(drawn, locations[one.key])
            with_value(tables, locations[one.key], math.copysign(value, one.value if before is None else before))
    return tomlkit.dumps(tables)


def _at(tables: Mapping[str, Any], location: Location) -> Any:
    """What stands at a place of the file; None where it leaves that out."""
    place: Any = tables
    try:
        for key in location:
            place = place[key]
    except KeyError:
        return None
    return place


def _scale_curve(tables: dict[str, Any], path: str, factor: float, actuator: Actuator) -> None:
    """One list of a magnetisation curve times a factor, both lists written where the file has neither."""
    used = (region.material for region in (*actuator.fixed, *actuator.moving.regions))
    curves = [material for material in used if isinstance(material, NonlinearMaterial)]
    by_path = {joined("materials", curve.name, key): (curve, key) for curve in curves for key in ("B_T", "H_A_per_m")}
    curve, key = by_path[path]
    points = {"B_T": curve.flux_density_T, "H_A_per_m": curve.field_A_per_m}
    points[key] = tuple(float(f"{factor * x:.{_DIGITS}g}") for x in points[key])
    materials = tables.setdefault("materials", {})
    if curve.name not in materials:
        materials[curve.name] = library_table(curve.name)
    table = materials[curve.name]
    table.pop("bh_curve", None)
    for column, values in points.items():
        if column not in table:
            table[column] = list(values)
        elif column == key:
            for place, value in enumerate(values):
                table[column][place] = value
