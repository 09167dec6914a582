"""The text of an actuator file with other numbers in it, its comments and its layout kept; and the variants of a sweep.

Each variant of a parameter sweep is a file of its own, checked as such.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit

from femfit.core.errors import ActuatorFileError
from femfit.core.files import path_of
from femfit.device.complaints import MistakeError, joined, place_in_file, table_at
from femfit.device.drawing import materials_used
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.keys import decimal_sum
from femfit.device.load import actuator_from_tables, parse, read_text
from femfit.device.materials import LIBRARY
from femfit.device.parameters import Value, read_design
from femfit.device.parts import CURVE_KEYS, Actuator, NonlinearMaterial, SweepAxes
from femfit.device.tolerances import numbers_of, value_at, with_value

_DIGITS = 9
"""Significant digits of a scaled number: points of a curve, a warm magnet's remanence."""


def drawing_text(path: str | Path) -> str:
    """The text of an actuator file with its line ends as they are; errors as of ``read_actuator``."""
    path = path_of(path, "An actuator file")
    read_text(path)  # says what is wrong with a file that cannot be read
    return path.read_bytes().decode("utf-8-sig")


def rewritten(
    text: str, values: Iterable[tuple[NumberFacts, float]], source: str, directory: Path | None = None
) -> str:
    """The text with other values of its numbers; those of faces move all their places by the same length.

    A number of a library's material, or a curve from a file, is written into ``[materials.NAME]``; the value of a curve
    is a factor.
    """
    drawn = parse(text, source)
    locations, tables = numbers_of(drawn), tomlkit.parse(text)
    for key, value in values:
        if value == key.value:
            continue
        if key.kind.startswith("curve_"):
            _scale_curve(tables, key.key, value, actuator_from_tables(drawn, source, directory))
        elif key.unit:
            for location in map(locations.__getitem__, key.paths):
                offset = decimal_sum(value_at(drawn, location), -1.0, key.value)
                with_value(tables, place_in_file(drawn, location), decimal_sum(offset, 1.0, value))
        else:
            location = locations[key.key]
            before = value_at(drawn, location)
            if before is None:  # a material of the library
                before = LIBRARY[str(location[1])].table.get(str(location[-1]), key.value)
            if not math.isclose(abs(before), abs(key.value)):  # of a warm magnet the file has the remanence at 20 degC
                value = float(f"{abs(before) * value / abs(key.value):.{_DIGITS}g}")  # noqa: PLW2901
            with_value(tables, place_in_file(drawn, location), math.copysign(value, before))
    return tomlkit.dumps(tables)


def _scale_curve(tables: dict[str, Any], path: str, factor: float, actuator: Actuator) -> None:
    """One list of a magnetisation curve times a factor, both lists written where the file has neither."""
    curves = (region.material for region in actuator.regions if isinstance(region.material, NonlinearMaterial))
    by_path = {joined("materials", curve.name, key): (curve, key) for curve in curves for key in CURVE_KEYS}
    curve, key = by_path[path]
    points = dict(zip(CURVE_KEYS, (curve.flux_density_T, curve.field_A_per_m), strict=True))
    points[key] = tuple(float(f"{factor * x:.{_DIGITS}g}") for x in points[key])
    lists = table_at(tables, "materials", curve.name)
    for column, values in points.items():
        place = "materials", curve.name, column
        if column not in lists:
            with_value(tables, place, list(values))
        elif column == key:
            for k, value in enumerate(values):
                with_value(tables, (*place, k), value)
    tables["materials"][curve.name].pop("bh_curve", None)


@dataclass(frozen=True)
class Variant:
    """One variant."""

    values: tuple[Value, ...]  # One a column of the sweep, in SI units or a material's name
    sweep: SweepAxes
    actuator: Actuator | None  # None if it cannot be built
    problem: str = ""


@dataclass(frozen=True)
class VariantSweep:
    """An actuator and what becomes of it when parameters change."""

    actuator: Actuator
    # Names of the parameters in the table, each ending in its SI unit; empty without parameters
    columns: tuple[str, ...]
    variants: tuple[Variant, ...]  # In the order of the design; the actuator alone without parameters
    unused: tuple[str, ...] = ()  # Materials of the file that no region has in any variant

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was left out of the drawing's materials, and which ones are of no use."""
        used = [region.material for region in self.actuator.regions if isinstance(region.material, NonlinearMaterial)]
        curves = {f"Material {curve.name}: {curve.remark}." for curve in used if curve.remark}
        unused = (str(MistakeError("unused", joined("materials", name))) for name in self.unused)
        return (*sorted(curves), *unused)


def read_variants(path: str | Path) -> VariantSweep:
    """Read an actuator file with all its variants.

    Returns
    -------
    VariantSweep
        A variant that cannot be built, as one whose parts overlap, is one with its problem.
    """
    path = path_of(path, "An actuator file")
    return variants_from_toml(read_text(path), str(path), path.parent)


def variants_from_toml(text: str, source: str = "actuator file", directory: Path | None = None) -> VariantSweep:
    """Build all variants of an actuator from TOML text; arguments and errors as of :func:`read_variants`."""
    data = parse(text, source)
    actuator = actuator_from_tables(data, source, directory)
    design = read_design(data, [])
    swept = {value for point in design.points for value in point} if design else set()
    unused = tuple(name for name in table_at(data, "materials") if name not in {*materials_used(data), *swept})
    if design is None:
        return replace(only(actuator), unused=unused)
    variants = []
    for point in design.points:
        values = tuple(parameter.in_si(value) for parameter, value in zip(design.parameters, point, strict=True))
        try:
            built = actuator_from_tables(design.variant(data, point), "variant", directory)
            variants.append(Variant(values, built.sweep, built))
        except ActuatorFileError as error:
            variants.append(Variant(values, actuator.sweep, None, " ".join(error.problems)))
    if all(variant.actuator is None for variant in variants):
        raise ActuatorFileError(
            source, [f"sweep.parameters must leave a variant that can be built; the first one: {variants[0].problem}"]
        )
    return VariantSweep(actuator, tuple(parameter.column for parameter in design.parameters), tuple(variants), unused)


def only(actuator: Actuator) -> VariantSweep:
    """An actuator without parameters as a sweep of variants."""
    return VariantSweep(actuator, (), (Variant((), actuator.sweep, actuator),))
