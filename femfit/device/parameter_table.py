"""``[sweep.parameters]``: which numbers and materials of the file are swept, under which names, through which values.

A parameter is a key path of the file with its values, or a name of one's own with several ``keys`` that follow it
together, as a sleeve and the winding round it, or all parts of a core.
"""

import re
from collections.abc import Mapping
from typing import Any, TypeGuard

from femfit.core.sweep_columns import COLUMNS, VARIANT
from femfit.device.complaints import did_you_mean, joined, read_list, read_part, read_table
from femfit.device.decimals import axis_values, decimal_sum
from femfit.device.file_numbers import (
    Location,
    known_materials,
    material_keys,
    nearest_numbers,
    numbers_of,
    unit_of,
    why_no_number,
)
from femfit.device.parameters import (
    AXES,
    FollowingKey,
    ParameterDesign,
    Points,
    SweptParameter,
    grid_points,
    latin_hypercube,
    list_points,
)
from femfit.device.schema import (
    NAMES,
    PARAMETER_VALUES,
    DesignEntry,
    KeyEntry,
    NamedParameterEntry,
    RangeEntry,
    SampledEntry,
)

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
PATH = "sweep.parameters"
SPECIFICATION = {*RangeEntry.model_fields, *SampledEntry.model_fields, *NamedParameterEntry.model_fields}

Values = tuple[float, ...] | tuple[str, ...] | SampledEntry


def read_design(data: Mapping[str, Any], problems: list[str]) -> ParameterDesign | None:
    """Read what a file sweeps beside its axes.

    Returns
    -------
    ParameterDesign or None
        None without parameters, or if anything is wrong.
    """
    entry = read_part(DesignEntry, data.get("sweep"))
    if entry is None:
        return None
    if not entry.parameters:
        unused = [key for key in ("design", "samples", "seed") if key in data["sweep"]]
        problems += [f"sweep.{key} must be left out without [sweep.parameters]. Remove it." for key in unused]
        return None
    count = len(problems)
    read = [_parameter(name, table, data, problems) for name, table in _flat(entry.parameters).items()]
    readable = [parameter for parameter in read if parameter is not None]
    parameters, values = tuple(parameter for parameter, _ in readable), [column for _, column in readable]
    _check_names(parameters, data, problems)
    points = _points(entry, parameters, values, problems) if len(problems) == count else ()
    return ParameterDesign(parameters, points) if len(problems) == count else None


def _flat(tables: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Key paths written without quotes are tables within tables to TOML: ``coil.turns = [1, 2]``."""
    flat: dict[str, Any] = {}
    for name, table in tables.items():
        inner = f"{path}.{name}" if path else name
        if isinstance(table, dict) and table and not _specifies(table):
            flat |= _flat(table, inner)
        else:
            flat[inner] = table
    return flat


def _specifies(table: Mapping[str, Any]) -> bool:
    """Whether a table gives values, rather than being the beginning of a key path."""
    return any(key in SPECIFICATION and not isinstance(value, dict) for key, value in table.items())


def _parameter(
    name: str, table: object, data: Mapping[str, Any], problems: list[str]
) -> tuple[SweptParameter, Values] | None:
    """A key path of the file, or a name of one's own for several, with its values; None where something is wrong."""
    path = joined(PATH, name)
    named = isinstance(table, dict) and bool(table.keys() & NamedParameterEntry.model_fields.keys())
    if name in AXES and not named:
        axis = _values(table, path, name, problems)
        return None if axis is None else (SweptParameter(name, ()), axis)
    entry = NamedParameterEntry(keys=[name], values=table) if not named else None
    entry = entry or read_table(NamedParameterEntry, table, path, problems)
    if entry is None:
        return None
    place = f"{path}.values" if named else path
    paths = [f"{path}.keys[{n}]" if named else path for n in range(len(entry.keys))]
    keys = [_following(text, each, data, problems) for text, each in zip(entry.keys, paths, strict=True)]
    readable = tuple(key for key in keys if key is not None)
    materials = [key.location in material_keys(data).values() for key in readable]
    if any(materials) and not all(materials):
        problems.append(f"{path}.keys must all be materials or all be numbers; they are both. Make two parameters.")
        return None
    values: Values | None = (
        _names(entry.values, place, data, problems) if any(materials) else _values(entry.values, place, name, problems)
    )
    if values is None or len(readable) < len(keys):
        return None
    units = sorted({unit_of(_last_name(key.location)) for key in readable})
    if len(units) > 1:
        problems.append(
            f"{path}.keys must all be in one unit; they are in {' and '.join(unit or 'none' for unit in units)}. "
            "Make one parameter of each unit."
        )
    elif named and (unit_of(name) != units[0] or not NAME.fullmatch(name)):
        needed = f"end in _{units[0]}, the unit of its keys" if units[0] else "not end in a unit, as its keys have none"
        problems.append(
            f"{path} must be named with letters, digits and _, beginning with a letter, and {needed}. Rename it."
        )
    return SweptParameter(name, readable), values


def _following(value: object, path: str, data: Mapping[str, Any], problems: list[str]) -> FollowingKey | None:
    entry = read_table(KeyEntry, {"key": value} if isinstance(value, str) else value, path, problems)
    if entry is None:
        return None
    material = material_keys(data).get(entry.path)
    if material is not None and entry.model_fields_set != {"path"}:
        problems.append(f"{path} must have neither factor nor offset, as it names a material. Remove them.")
    location = material or _location(entry.path, path, data, problems)
    return None if location is None else FollowingKey(location, entry.factor, entry.offset)


def _location(name: str, path: str, data: Mapping[str, Any], problems: list[str]) -> Location | None:
    location = numbers_of(data).get(name)
    if location is None and (why := why_no_number(name)):
        problems.append(f"{path} cannot be {name[:100]!r}: {why}. Leave it out.")
    elif location is None:
        near = nearest_numbers(name, data)
        problems.append(
            f"{path} must be the key path of a number or a material in this file; {name[:100]!r} is none. "
            + (f"Nearest: {', '.join(near)}." if near else 'An example: "coils.NAME.turns".')
        )
    return location


def _values(value: object, path: str, name: str, problems: list[str]) -> Values | None:
    if isinstance(value, list):
        return read_list(PARAMETER_VALUES, value, path, "Give at least one number.", problems) or None
    if isinstance(value, dict) and value.keys() & {"min", "max"}:
        entry = read_table(SampledEntry, value, path, problems)
        problem = "" if entry is None else _fault(entry)
        problems += [f"{path} {problem}"] * bool(problem)
        return None if problem else entry
    if isinstance(value, dict):
        stepped = read_table(RangeEntry, value, path, problems)
        return None if stepped is None else axis_values(stepped, path, problems) or None
    problems.append(
        f"{path} must be a list of numbers, {{ start, stop, step }}, or {{ min, max }} for a latin_hypercube; it is "
        f"{str(value)[:60]!r}. Write for example {name[:60]} = [1, 2]."
    )
    return None


def _names(value: object, path: str, data: Mapping[str, Any], problems: list[str]) -> tuple[str, ...] | None:
    materials = known_materials(data)
    if not isinstance(value, list):
        problems.append(
            f"{path} must be a list of names of materials, for every design; it is {str(value)[:60]!r}. Write for "
            f'example ["{materials[0]}", "{materials[-1]}"].'
        )
        return None
    names = read_list(NAMES, value, path, "Give at least one name of a material in quotes.", problems)
    wrong = [name for name in names if name not in materials]
    if wrong:
        problems.append(
            f"{path} must name materials of [materials] or of the library; {wrong[0][:60]!r} is none."
            f"{did_you_mean(wrong[0], materials)} Known: {', '.join(materials)}."
        )
    return None if wrong else names or None


def _fault(entry: SampledEntry) -> str:
    if entry.min >= entry.max:
        return f"must have max > min; they are {entry.max:g} and {entry.min:g}. Exchange them."
    steps = 0 if entry.step is None else min(round((entry.max - entry.min) / entry.step), 10**9)
    if entry.step is not None and decimal_sum(entry.min, steps, entry.step) != entry.max:
        return f"must have a step that divides max - min; {entry.step:g} does not. Change one of them."
    return ""


def _check_names(parameters: tuple[SweptParameter, ...], data: Mapping[str, Any], problems: list[str]) -> None:
    problems += [
        f"{joined(PATH, parameter.name)} must stand in [sweep] or in [sweep.parameters]; it stands in both. Remove one."
        for parameter in parameters
        if parameter.name in AXES and parameter.name in data["sweep"]
    ]
    columns = [parameter.column for parameter in parameters if parameter.name not in AXES]
    problems += [
        f"{PATH} must give columns that the table does not have yet; {column} is one or comes twice. Rename it."
        for place, column in enumerate(columns)
        if column in COLUMNS or column == VARIANT or column in columns[:place]
    ]
    owners: dict[Location, str] = {}
    for parameter in parameters:
        for key in parameter.keys:
            if key.location in owners:
                problems.append(
                    f"{joined(PATH, parameter.name)} must not set {joined('', *key.location)}; "
                    f"{owners[key.location]} does. Remove one."
                )
            owners[key.location] = parameter.name


def _points(
    entry: DesignEntry, parameters: tuple[SweptParameter, ...], values: list[Values], problems: list[str]
) -> Points:
    sampled = entry.design == "latin_hypercube"
    for parameter, column in zip(parameters, values, strict=True):
        if isinstance(column, SampledEntry) != sampled and not _is_names(column):
            form = "{ min, max }" if sampled else "a list or { start, stop, step }"
            problems.append(
                f'{joined(PATH, parameter.name)} must be given as {form} for design = "{entry.design}". '
                "Change it or the design."
            )
        elif not isinstance(column, SampledEntry) and entry.design == "grid" and len(set(column)) < len(column):
            problems.append(f"{joined(PATH, parameter.name)} must not repeat a value on a grid. Remove the repetition.")
    if sampled and entry.samples is None:
        problems.append('sweep.samples is missing; design = "latin_hypercube" needs it. Give the number of samples.')
    unused = [] if sampled else [key for key in ("samples", "seed") if key in entry.model_fields_set]
    problems += [f'sweep.{key} must be left out for design = "{entry.design}". Remove it.' for key in unused]
    drawn = [column for column in values if isinstance(column, SampledEntry) or _is_names(column)]
    lists = [column for column in values if not isinstance(column, SampledEntry)]
    if sampled:
        return latin_hypercube(drawn, entry.samples, entry.seed) if entry.samples and len(drawn) == len(values) else ()
    if len(lists) < len(values):
        return ()
    if entry.design == "list":
        return list_points([parameter.name for parameter in parameters], lists, problems)
    return grid_points(lists, problems)


def _is_names(values: Values) -> TypeGuard[tuple[str, ...]]:
    return isinstance(values, tuple) and all(isinstance(value, str) for value in values)


def _last_name(location: Location) -> str:
    return str([key for key in location if isinstance(key, str)][-1])
