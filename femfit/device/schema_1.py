"""Files of schema 1, and older names in those of schema 2, as today's schema has them.

A file of schema 1 has one coil, a face of the fixed part at z = 0, and distances above zero.
"""

import re
from typing import Any

from femfit.device.complaints import Place, Tables, complain, table_at

OLDER = {"electromagnet": "fixed", "coil": "coils.coil", "hall": "sensors.hall", "moving.mass_g": "mechanics.mass_g"}
"""Today's key path of each older one."""


class DrawnTables(dict[str, Any]):
    """The tables of a file by today's names."""

    is_schema_1: bool
    older: dict[str, str]  # Key paths that the file has, by today's where these are others
    problems: tuple[str, ...]  # What is wrong with its names


def translated(data: Tables) -> DrawnTables:
    """The tables of a file by today's names; again they are the same."""
    if isinstance(data, DrawnTables):
        return data
    tables, problems, version = DrawnTables(data), list[str](), data.get("schema")
    tables.older, tables.is_schema_1 = {}, version == 1 and not isinstance(version, bool)
    for today in ("fixed", "coils", "circuits", "mechanics", "sensors") if tables.is_schema_1 else ():
        if today in data:
            complain(problems, "schema_2", today)
    for older, today in OLDER.items():
        *above, name = older.split(".")
        holder = table_at(data, *above)
        if name in holder:
            tables.older[today] = older
            tables |= {each: {key: value for key, value in holder.items() if key != name} for each in above}
            if not _added(tables, today, holder[name]):
                complain(problems, "twice", today, older=older)
    if "mechanics" not in tables:
        complain(problems, "no_mass", "moving" if tables.is_schema_1 else "mechanics")
    tables.problems = tuple(problems)
    for older in tables.older.values():
        tables.pop(older, None)
    return tables


def _added(tables: DrawnTables, path: str, value: Any) -> bool:
    """Whether a path of one or two names was free for a value, which stands there first in its table."""
    table, *inner = path.split(".")
    if table in tables and (not inner or inner[0] in table_at(tables, table)):
        return False
    if table == "sensors" and isinstance(value, dict):
        value = {"kind": "hall", **value}
    beside = tables.get(table, {})
    if not inner or isinstance(beside, dict):  # what is no table is refused as such
        tables[table] = {inner[0]: value, **beside} if inner else value
    return True


def in_file(data: Tables, place: Place) -> Place:
    """Where the file has what stands at a place of its tables."""
    for today, older in translated(data).older.items():
        names = tuple(today.split("."))
        if place[: len(names)] == names:
            return (*older.split("."), *place[len(names) :])
    return place


def as_in_file(data: Tables, text: str) -> str:
    """A key path, or a sentence with some, with the names that the file has."""
    older = translated(data).older
    paths = "|".join(map(re.escape, older))
    return re.sub(rf"(?<![\w.])({paths})(?![\w-])", lambda path: older[path[0]], text) if older else text
