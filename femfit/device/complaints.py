"""Problems of a table in the user's words: key path, what was given, what is needed."""

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar, get_args

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from femfit.device.schema import MAX_NAME, NAME_PATTERN, Entry
from femfit.device.schema_device import NAMED, TABLES

AnyEntry = TypeVar("AnyEntry", bound=Entry)

_TABLE_TYPES = {"dict_type", "model_type", "model_attributes_type"}

UNCHECKED = ("materials", "mechanics")
"""Tables in which names may be any text: no column or file is named after what stands there."""


def read_table(entry: type[AnyEntry], table: object, path: str, problems: list[str]) -> AnyEntry | None:
    """Validate one table of the file, at a key path, and append a line for each problem; None if a known key is wrong.

    Unknown keys are reported and then ignored, so that they do not keep later checks from their work.
    """
    errors = _errors(entry, table)
    problems += [_sentence(entry, error, path) for error in errors]
    if isinstance(table, Mapping):
        unknown = {error["loc"][0] for error in errors if error["type"] == "extra_forbidden" and len(error["loc"]) == 1}
        table = {key: value for key, value in table.items() if key not in unknown}
    if _errors(entry, table):
        return None
    read = entry.model_validate(table)
    faults = [path + fault for fault in read.faults()]
    problems += faults
    return None if faults else read


def table_at(data: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """The table at a key path, empty if there is none."""
    place: Any = data
    for key in keys:
        place = place.get(key) if isinstance(place, dict) else None
    return place if isinstance(place, dict) else {}


def tables_of(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], type[Entry], Any]]:
    """Place, class and content of each table of a file, whatever is wrong with it."""
    for pattern, entry in TABLES.items():
        *above, last = pattern
        tables = table_at(data, *above)
        for name in tables if last == NAMED else [last] if last in tables else []:
            yield (*above, name), entry if isinstance(entry, type) else entry(tables[name]), tables[name]


def read_tables(data: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    """The entries of a file by their key paths, without those in which anything is wrong."""
    read = {}
    for place, entry, table in tables_of(data):
        path, name = joined("", *place), place[-1]
        if place[0] not in UNCHECKED and place[:-1] and not (re.match(NAME_PATTERN, name) and len(name) <= MAX_NAME):
            problems.append(f"{path} must be named with letters, digits, - and _, beginning with a letter. Rename it.")
        # One of the top level that is no table is a mistake of that level
        if len(place) > 1 or isinstance(table, dict):
            read[path] = read_table(entry, table, path, problems)
    return {path: entry for path, entry in read.items() if entry is not None}


def read_part(entry: type[AnyEntry], table: object) -> AnyEntry | None:
    """The keys of an entry out of a larger table, or None if one of them is wrong.

    The entry is a base of the table's own, which reports the problems: a mistake elsewhere in the table hides no later
    check.
    """
    if not isinstance(table, Mapping):
        return None
    values = {key: table[key] for key in entry.model_fields if key in table}
    return None if _errors(entry, values) else entry.model_validate(values)


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """`` Did you mean 'x'?`` for the closest known word, or nothing."""
    by_lower = {word.lower(): word for word in names}
    close = difflib.get_close_matches(name.lower()[:100], by_lower, n=1)
    return f" Did you mean {by_lower[close[0]]!r}?" if close else ""


def joined(path: str, *keys: object) -> str:
    """The key path of names, or positions in a list, below a table's path, quoted where TOML wants it."""
    for key in keys:
        if isinstance(key, int):
            path += f"[{key}]"
            continue
        name = str(key) if re.fullmatch(r"[A-Za-z0-9_-]+", str(key)) else _shortened(key)
        path = f"{path}.{name}" if path else name
    return path


def _errors(entry: type[Entry], table: object) -> Sequence[ErrorDetails]:
    try:
        entry.model_validate(table)
    except ValidationError as error:
        return error.errors(include_url=False, include_context=False)
    return ()


def _sentence(entry: type[Entry], error: ErrorDetails, path: str) -> str:
    keys = error["loc"]
    where = joined(path, *keys)
    fields: dict[str, Any] = {info.alias or name: info for name, info in entry.model_fields.items()}
    info = fields.get(str(keys[0])) if keys else None
    remedy = info.description if info is not None else ""
    if error["type"] == "extra_forbidden":
        return f"{where} is no known key.{did_you_mean(str(keys[0]), fields)} Known here: {', '.join(fields)}."
    if error["type"] == "missing":
        return f"{where} is missing. {remedy}"
    words = get_args(info.annotation) if info is not None and error["type"] == "literal_error" else ()
    near = did_you_mean(str(error["input"]), map(str, words))
    return f"{_need(error, where)}{near} {remedy}".rstrip()


def _need(error: ErrorDetails, where: str) -> str:
    """What was needed at a place, and what is there."""
    need = re.sub(r"^(Input|String|List) should", "must", error["msg"])
    need = need.replace("greater than or equal to", "at least").replace("less than or equal to", "at most")
    need = "must be a table" if error["type"] in _TABLE_TYPES else need.replace(" after validation", "")
    return f"{where} {need}; it is {_shortened(error['input'])}."


def read_list(
    kind: TypeAdapter[list[Any]], value: object, path: str, remedy: str, problems: list[str]
) -> tuple[Any, ...]:
    """The members of a list of a kind, as :data:`femfit.device.schema.NAMES`; none where one of them is wrong."""
    try:
        return tuple(kind.validate_python(value))
    except ValidationError as error:
        every = error.errors(include_url=False, include_context=False)
        problems += [f"{_need(each, joined(path, *each['loc']))} {remedy}" for each in every]
        return ()


def _shortened(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
