"""``[sweep.parameters]``: which numbers and materials of the file are swept, under which names, through which values.

A parameter is a key path of the file with its values, or a name of one's own with several ``keys`` that follow it
together, as a sleeve and the winding round it, or all parts of a core.

References
----------
M. D. McKay, R. J. Beckman and W. J. Conover, Technometrics 21 (1979) 239: Latin hypercube sampling.
"""

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any, ClassVar

import numpy as np

from femfit.core.sweep_columns import COLUMNS, VARIANT
from femfit.device import schema
from femfit.device.complaints import complain, in_file, joined, read_part, read_table, read_value, refuse_name, table_at
from femfit.device.drawing import part_tables
from femfit.device.keys import UNITS, Entry, Key, Place, Record, decimal_sum, key, keys_of, scaled, unit_of
from femfit.device.materials import LIBRARY
from femfit.device.tolerances import nearest, numbers_of, with_value

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
PATH = "sweep.parameters"
COUNT = ((1, schema.MAX_AXIS_POINTS),)
NUMBERS = Key(
    "Give at least one number.", count=COUNT, hint=tuple[float, ...], stepped=schema.RangeEntry, limits=schema.PARAMETER
)
NAMES = Key("Give at least one name of a material in quotes.", count=COUNT, hint=tuple[str, ...])

Value = float | str
"""Value of a parameter: a number, or the name of a material."""

Points = tuple[tuple[Value, ...], ...]
"""One tuple a point, one value a parameter."""

Values = Sequence[float] | Sequence[str] | schema.SampledEntry
"""Those of one parameter, or the range that they are drawn from."""


class SweptParameter(Record):
    """``[sweep.parameters.NAME]``: a name of one's own for keys of the file, or the path of one that is swept alone."""

    needs_more = True

    name: str
    # Of numbers that it sets to offset + factor * value, or of names of materials that it sets
    keys: tuple[schema.KeyEntry, ...]
    values: Values
    paths: ClassVar[tuple[Any, ...]] = key("the key paths that follow the parameter", file="keys", count=((1, 100),))
    range: ClassVar[Any] = key("a list, { start, stop, step }, or { min, max } for a latin_hypercube", file="values")

    @property
    def column(self) -> str:
        """Name in the table, which ends in the SI unit: ``sleeve_radius_mm`` is ``sleeve_radius_m`` there."""
        stem, unit, si = self._unit
        return f"{stem.removesuffix(f'_{unit}')}{self.name.removeprefix(stem)}_{si}" if unit else self.name

    def in_si(self, value: Value) -> Value:
        """A value of the file in the table's unit."""
        _, unit, si = self._unit
        return value if isinstance(value, str) or unit == si else scaled(value)

    @property
    def _unit(self) -> tuple[str, str, str]:
        """The name without positions in a list at its end, its unit, and that of the table, of a thousandth another."""
        stem = re.sub(r"(?:\[\d+\])*\Z", "", self.name)
        unit = unit_of(stem)
        return stem, unit, UNITS[unit].si if unit and UNITS[unit].power == -3 else unit


@dataclass(frozen=True)
class ParameterDesign:
    """The variants of a file."""

    parameters: tuple[SweptParameter, ...]
    points: Points  # One a variant, one value a parameter, in the file's units or a material's name
    places: Mapping[str, Place]  # Of what a parameter can set, by key path

    def variant(self, data: dict[str, Any], point: tuple[Value, ...]) -> dict[str, Any]:
        """The file of a variant, without ``[sweep.parameters]``."""
        tables = deepcopy(data)
        axes = keys_of(schema.SweepEntry)
        tables["sweep"] = {key: value for key, value in tables["sweep"].items() if axes[key].stepped}
        for parameter, value in zip(self.parameters, point, strict=True):
            for entry in parameter.keys:
                number = value if isinstance(value, str) else decimal_sum(entry.offset, entry.factor, value)
                with_value(tables, self.places[entry.path], number)
        return tables


def read_design(data: Mapping[str, Any], problems: list[str]) -> ParameterDesign | None:
    """Read what a file sweeps beside its axes.

    Returns
    -------
    ParameterDesign or None
        None without parameters, or if anything is wrong.
    """
    entry = read_part(schema.SweepEntry, data.get("sweep"), "parameters", "design", "samples", "seed")
    if entry is None or not entry.parameters:
        return None
    regions = [table for table in part_tables(data) if not table.winding]
    count, places = len(problems), numbers_of(data)
    places |= {in_file(data, f"{region.path}.material"): (*region.place, "material") for region in regions}
    materials = tuple(dict.fromkeys([*LIBRARY, *table_at(data, "materials")]))
    read = (_parameter(name, table, places, materials, problems) for name, table in _flat(entry.parameters).items())
    parameters = tuple(parameter for parameter in read if parameter is not None)
    columns = [*COLUMNS, VARIANT]
    owners: dict[Place, str] = {}
    for parameter in parameters:
        if parameter.column in columns:
            complain(problems, "column_twice", column=parameter.column)
        columns.append(parameter.column)
        for place, path in ((places[follower.path], follower.path) for follower in parameter.keys):
            if place in owners:
                complain(problems, "key_twice", joined(PATH, parameter.name), key=path, owner=owners[place])
            owners[place] = parameter.name
    points = _points(entry, parameters, problems) if len(problems) == count else ()
    return ParameterDesign(parameters, points, places) if len(problems) == count else None


def _flat(tables: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Key paths written without quotes are tables within tables to TOML: ``coil.turns = [1, 2]``."""
    specifying = {key for record in (schema.RangeEntry, schema.SampledEntry, SweptParameter) for key in keys_of(record)}
    flat: dict[str, Any] = {}
    for name, table in tables.items():
        inner = f"{path}.{name}" if path else name
        keys = table if isinstance(table, dict) else {}
        gives_values = any(key in specifying and not isinstance(value, dict) for key, value in keys.items())
        flat |= _flat(keys, inner) if keys and not gives_values else {inner: table}
    return flat


def _parameter(
    name: str, content: object, places: Mapping[str, Place], materials: Sequence[str], problems: list[str]
) -> SweptParameter | None:
    """A key path of the file, or a name of one's own for several, with its values; None where something is wrong."""
    path = joined(PATH, name)
    named = isinstance(content, dict) and bool(content.keys() & keys_of(SweptParameter).keys())
    entry = read_table(SweptParameter, content if named else {"keys": [name], "values": content}, path, problems)
    if entry is None:
        return None
    paths = (f"{path}.keys[{n}]" if named else path for n in range(len(entry.keys)))
    read = (_following(key, of_key, places, problems) for key, of_key in zip(entry.keys, paths, strict=False))
    keys = tuple(key for key in read if key is not None)
    ends = [[step for step in places[key.path] if isinstance(step, str)][-1] for key in keys]
    units = sorted({unit_of(end) for end in ends})
    if len({end == "material" for end in ends}) > 1:
        complain(problems, "keys_mixed", path)
        return None
    names = materials if "material" in ends else ()
    values = _values(entry.values, f"{path}.values" if named else path, name, names, problems)
    if not values or len(keys) < len(entry.keys):
        return None
    if len(units) > 1:
        complain(problems, "key_units", path, units=" and ".join(unit or "none" for unit in units))
    elif named and (unit_of(name) != units[0] or not NAME.fullmatch(name)):
        end = f"end in _{units[0]}, the unit of its keys" if units[0] else "not end in a unit, as its keys have none"
        complain(problems, "parameter_name", path, end=end)
    return SweptParameter(name=name, keys=keys, values=values)


def _following(value: object, path: str, places: Mapping[str, Place], problems: list[str]) -> schema.KeyEntry | None:
    table = {"key": value} if isinstance(value, str) else value
    entry: schema.KeyEntry | None = read_table(schema.KeyEntry, table, path, problems)
    if entry is not None and entry.path not in places:
        near = ", ".join(nearest(entry.path, places))
        near = f"Nearest: {near}." if near else 'An example: "coils.NAME.turns".'
        complain(problems, "no_key", path, key=entry.path[:100], near=near)
        return None
    if entry is not None and places[entry.path][-1] == "material" and isinstance(table, dict) and len(table) > 1:
        complain(problems, "material_factor", path)
    return entry


def _values(value: object, path: str, name: str, materials: Sequence[str], problems: list[str]) -> Values | None:
    """Numbers, or names of these materials where there are any."""
    if not materials and isinstance(value, dict) and value.keys() & {"min", "max"}:
        return read_table(schema.SampledEntry, value, path, problems)
    if not isinstance(value, list if materials else list | dict):
        facts = {"first": materials[0], "last": materials[-1]} if materials else {"name": name[:60]}
        complain(problems, "no_names" if materials else "no_values", path, given=str(value)[:60], **facts)
        return None
    values: Sequence[Any] = read_value(NAMES if materials else NUMBERS, value, path, problems) or []
    wrong = next((each for each in values if materials and each not in materials), None)
    if wrong is not None:
        refuse_name(problems, "wrong_name", path, wrong, materials)
    return values if wrong is None else None


def _points(entry: Entry, parameters: tuple[SweptParameter, ...], problems: list[str]) -> Points:
    """Every combination, the last parameter fastest; the first values together, and so on; or samples of the ranges."""
    sampled, count = entry.design == "latin_hypercube", len(problems)
    columns: list[Any] = [parameter.values for parameter in parameters]
    for parameter, column in zip(parameters, columns, strict=True):
        path, ranged = joined(PATH, parameter.name), isinstance(column, schema.SampledEntry)
        if ranged != sampled and (ranged or not all(isinstance(value, str) for value in column)):
            form = "{ min, max }" if sampled else "a list or { start, stop, step }"
            complain(problems, "design_form", path, form=form, design=entry.design)
        elif not ranged and entry.design == "grid" and len(set(column)) < len(column):
            complain(problems, "repeated", path)
    if sampled and entry.samples is None:
        complain(problems, "no_samples")
    if len(problems) > count:
        return ()
    if sampled:
        return latin_hypercube(columns, entry.samples, entry.seed)
    sizes = {parameter.name: len(column) for parameter, column in zip(parameters, columns, strict=True)}
    if entry.design == "grid" and prod(sizes.values()) > schema.MAX_AXIS_POINTS:
        complain(problems, "many_points", most=schema.MAX_AXIS_POINTS, count=prod(sizes.values()))
    elif entry.design == "list" and len({*sizes.values()}) > 1:
        complain(problems, "list_lengths", lengths=", ".join(f"{name} {size}" for name, size in sizes.items()))
    else:
        return tuple(product(*columns) if entry.design == "grid" else zip(*columns, strict=True))
    return ()


def latin_hypercube(ranges: Sequence[schema.SampledEntry | Sequence[str]], samples: int, seed: int) -> Points:
    """Samples of which each of equally many slices of every range holds one.

    Returns
    -------
    tuple of tuple of float or str
        With a step, values are those of the steps whose equal shares of the range the samples fall into.
    """
    from scipy.stats import qmc  # noqa: PLC0415  half a second that other actuator files need not spend

    shares = qmc.LatinHypercube(len(ranges), rng=np.random.default_rng(seed)).random(samples)
    return tuple(tuple(map(_at_share, ranges, row.tolist())) for row in shares)


def _at_share(entry: schema.SampledEntry | Sequence[str], share: float) -> Value:
    if not isinstance(entry, schema.SampledEntry):
        return entry[int(share * len(entry))]
    if entry.step is None:
        return entry.min + share * (entry.max - entry.min)
    steps = round((entry.max - entry.min) / entry.step)
    return decimal_sum(entry.min, min(int(share * (steps + 1)), steps), entry.step)
