"""``[sweep.parameters]``: which numbers and materials of the file are swept, under which names, through which values.

A parameter is a key path of the file with its values, or a name of one's own with several ``keys`` that follow it
together, as a sleeve and the winding round it, or all parts of a core.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import product
from math import prod
from typing import Any

from femfit.core.sweep_columns import COLUMNS, VARIANT
from femfit.device.complaints import complain, did_you_mean, joined, read_part, read_table, read_value, table_at
from femfit.device.file_numbers import Location, material_keys, nearest_numbers, numbers_of
from femfit.device.keys import MAX_AXIS_POINTS, Key, RangeEntry, keys_of, unit_of
from femfit.device.materials import LIBRARY
from femfit.device.parameters import (
    FollowingKey,
    ParameterDesign,
    Points,
    SweptParameter,
    Values,
    latin_hypercube,
)
from femfit.device.schema import (
    PARAMETER,
    DesignEntry,
    KeyEntry,
    NamedParameterEntry,
    SampledEntry,
)

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
PATH = "sweep.parameters"
NUMBERS = Key(
    "at least one number", count=((1, MAX_AXIS_POINTS),), hint=tuple[float, ...], stepped=RangeEntry, **PARAMETER
)
NAMES = Key("at least one name of a material in quotes", count=((1, MAX_AXIS_POINTS),), hint=tuple[str, ...])
SPECIFICATION = {*keys_of(RangeEntry), *keys_of(SampledEntry), *keys_of(NamedParameterEntry)}


def read_design(data: Mapping[str, Any], problems: list[str]) -> ParameterDesign | None:
    """Read what a file sweeps beside its axes.

    Returns
    -------
    ParameterDesign or None
        None without parameters, or if anything is wrong.
    """
    entry: DesignEntry | None = read_part(DesignEntry, data.get("sweep"))
    if entry is None or not entry.parameters:
        return None
    count = len(problems)
    read = [_parameter(name, table, data, problems) for name, table in _flat(entry.parameters).items()]
    parameters = tuple(parameter for parameter in read if parameter is not None)
    _check_names(parameters, problems)
    points = _points(entry, parameters, problems) if len(problems) == count else ()
    return ParameterDesign(parameters, points) if len(problems) == count else None


def _flat(tables: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Key paths written without quotes are tables within tables to TOML: ``coil.turns = [1, 2]``."""
    flat: dict[str, Any] = {}
    for name, table in tables.items():
        inner = f"{path}.{name}" if path else name
        keys = table if isinstance(table, dict) else {}
        gives_values = any(key in SPECIFICATION and not isinstance(value, dict) for key, value in keys.items())
        if keys and not gives_values:
            flat |= _flat(keys, inner)
        else:
            flat[inner] = table
    return flat


def _parameter(name: str, table: object, data: Mapping[str, Any], problems: list[str]) -> SweptParameter | None:
    """A key path of the file, or a name of one's own for several, with its values; None where something is wrong."""
    path = joined(PATH, name)
    named = isinstance(table, dict) and bool(table.keys() & keys_of(NamedParameterEntry).keys())
    entry = read_table(NamedParameterEntry, table if named else {"keys": [name], "values": table}, path, problems)
    if entry is None:
        return None
    place = f"{path}.values" if named else path
    paths = [f"{path}.keys[{n}]" if named else path for n in range(len(entry.keys))]
    keys = [_following(text, each, data, problems) for text, each in zip(entry.keys, paths, strict=True)]
    readable = tuple(key for key in keys if key is not None)
    materials = [key.location in material_keys(data).values() for key in readable]
    if any(materials) and not all(materials):
        complain(problems, "keys_mixed", path)
        return None
    values: Values | None = (
        _names(entry.values, place, data, problems) if any(materials) else _values(entry.values, place, name, problems)
    )
    if values is None or len(readable) < len(keys):
        return None
    last_names = [[name for name in key.location if isinstance(name, str)][-1] for key in readable]
    units = sorted({unit_of(name) for name in last_names})
    if len(units) > 1:
        complain(problems, "key_units", path, units=" and ".join(unit or "none" for unit in units))
    elif named and (unit_of(name) != units[0] or not NAME.fullmatch(name)):
        end = f"end in _{units[0]}, the unit of its keys" if units[0] else "not end in a unit, as its keys have none"
        complain(problems, "parameter_name", path, end=end)
    return SweptParameter(name, readable, values)


def _following(value: object, path: str, data: Mapping[str, Any], problems: list[str]) -> FollowingKey | None:
    table = {"key": value} if isinstance(value, str) else value
    entry: KeyEntry | None = read_table(KeyEntry, table, path, problems)
    if entry is None:
        return None
    material = material_keys(data).get(entry.path)
    if material is not None and isinstance(table, dict) and len(table) > 1:
        complain(problems, "material_factor", path)
    location = material or numbers_of(data).get(entry.path)
    if location is None:
        near = ", ".join(nearest_numbers(entry.path, data))
        near = f"Nearest: {near}." if near else 'An example: "coils.NAME.turns".'
        complain(problems, "no_key", path, key=entry.path[:100], near=near)
        return None
    return FollowingKey(location, entry.factor, entry.offset)


def _values(value: object, path: str, name: str, problems: list[str]) -> Values | None:
    if isinstance(value, dict) and value.keys() & {"min", "max"}:
        return read_table(SampledEntry, value, path, problems)
    if isinstance(value, list | dict):
        return read_value(NUMBERS, value, path, problems) or None
    complain(problems, "no_values", path, given=str(value)[:60], name=name[:60])
    return None


def _names(value: object, path: str, data: Mapping[str, Any], problems: list[str]) -> Sequence[str] | None:
    materials = tuple(dict.fromkeys([*LIBRARY, *table_at(data, "materials")]))
    if not isinstance(value, list):
        complain(problems, "no_names", path, given=str(value)[:60], first=materials[0], last=materials[-1])
        return None
    names: list[str] = read_value(NAMES, value, path, problems) or []
    wrong = [name for name in names if name not in materials]
    if wrong:
        near, known = did_you_mean(wrong[0], materials), ", ".join(materials)
        complain(problems, "wrong_name", path, given=wrong[0][:60], near=near, known=known)
    return None if wrong else names or None


def _check_names(parameters: tuple[SweptParameter, ...], problems: list[str]) -> None:
    columns: list[str] = []
    owners: dict[Location, str] = {}
    for parameter in parameters:
        path, column = joined(PATH, parameter.name), parameter.column
        if column in COLUMNS or column == VARIANT or column in columns:
            complain(problems, "column_twice", column=column)
        columns.append(column)
        for key in parameter.keys:
            if key.location in owners:
                complain(problems, "key_twice", path, key=joined("", *key.location), owner=owners[key.location])
            owners[key.location] = parameter.name


def _points(entry: DesignEntry, parameters: tuple[SweptParameter, ...], problems: list[str]) -> Points:
    """Every combination, the last parameter fastest; the first values together, and so on; or samples of the ranges."""
    sampled, count = entry.design == "latin_hypercube", len(problems)
    columns: list[Any] = [parameter.values for parameter in parameters]
    for parameter, column in zip(parameters, columns, strict=True):
        path, ranged = joined(PATH, parameter.name), isinstance(column, SampledEntry)
        if ranged != sampled and (ranged or not all(isinstance(value, str) for value in column)):
            form = "{ min, max }" if sampled else "a list or { start, stop, step }"
            complain(problems, "design_form", path, form=form, design=entry.design)
        elif not ranged and entry.design == "grid" and len(set(column)) < len(column):
            complain(problems, "repeated", path)
    if sampled and entry.samples is None:
        complain(problems, "no_samples")
    if len(problems) > count:
        return ()
    if sampled and entry.samples is not None:
        return latin_hypercube(columns, entry.samples, entry.seed)
    sizes = {parameter.name: len(column) for parameter, column in zip(parameters, columns, strict=True)}
    if entry.design == "grid" and prod(sizes.values()) > MAX_AXIS_POINTS:
        complain(problems, "many_points", most=MAX_AXIS_POINTS, count=prod(sizes.values()))
    elif entry.design == "list" and len({*sizes.values()}) > 1:
        complain(problems, "list_lengths", lengths=", ".join(f"{name} {size}" for name, size in sizes.items()))
    else:
        return tuple(product(*columns) if entry.design == "grid" else zip(*columns, strict=True))
    return ()
