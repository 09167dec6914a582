"""Tables of an actuator file read by the keys of their records, and what is wrong with them in the user's words.

A sentence says the key path, what was given, what is needed and what to do. Those on a key by itself follow from what
is declared of it; those between keys stand in ``complaints.toml``, whose texts have the fields of :meth:`str.format`.

Older files, those of schema 1 among them, are translated first.
"""

import difflib
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from typing import Any, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from femfit.device.keys import Entry, Key, Place, adapter, in_si, keys_apart, keys_of, kind_of
from femfit.device.schema import MAX_NAME, NAME_PATTERN, OLDER, FileEntry

Tables = Mapping[str, Any]


_SENTENCES = tomllib.loads((files("femfit.device") / "complaints.toml").read_text(encoding="utf-8"))


class MistakeError(ValueError):
    """A mistake in the table or the key at a path, which says the sentence of its code."""

    def __init__(self, code: str, path: str = "", /, **facts: Any) -> None:
        super().__init__(_SENTENCES[code].format(path=path, **facts))


class DrawnTables(dict[str, Any]):
    """The tables of a file by today's names."""

    is_schema_1: bool
    older: dict[str, str]  # Key paths that the file has, by today's where these are others
    problems: list[str]  # What is wrong with its names


@dataclass(frozen=True)
class Reading:
    """A file that is read."""

    data: DrawnTables
    problems: list[str]
    entries: dict[str, Any]  # Records of its tables by key path, without those in which anything is wrong

    def complain(self, code: str, path: str = "", /, **facts: Any) -> None:
        """Report a mistake."""
        complain(self.problems, code, path, **facts)


def complain(problems: list[str], code: str, path: str = "", /, **facts: Any) -> None:
    """Append the sentence of a code on the table or key at a path."""
    problems.append(str(MistakeError(code, path, **facts)))


def refuse_name(problems: list[str], code: str, path: str, name: str, names: Iterable[str]) -> None:
    """Append the sentence of a code on a name that is none of those known, with the closest one."""
    listed = ", ".join(names := [*names]) or "none"
    complain(problems, code, path, given=name[:60], near=did_you_mean(name, names), known=listed)


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """`` Did you mean 'x'?`` for the closest known word, or nothing."""
    by_lower = {word.lower(): word for word in names}
    close = difflib.get_close_matches(name.lower()[:100], by_lower, n=1)
    return f" Did you mean {by_lower[close[0]]!r}?" if close else ""


def read_table(record: Any, table: object, path: str, problems: list[str], **more: Any) -> Any:
    """The record of a table at a key path, with a line for each problem; None if a known key is wrong.

    Unknown keys are reported and then ignored, so that they do not keep later checks from their work. Tables within
    this one are read by themselves; what the record has beside its keys is ``more``.
    """
    entry = read_entry(record, table, path, problems)
    if entry.wrong:
        return None
    count = len(problems)
    for name, key in ((name, key) for name, key in keys_of(record).items() if key.like):
        size, needed = (len(getattr(entry, each) or ()) for each in (name, key.like))
        if size != needed:
            complain(problems, "like", joined(path, name), count=size, other=key.like, needed=needed)
    if not record.needs_more:
        entry = in_si(
            record, entry, lambda code, **facts: complain(problems, code, path, **vars(entry) | facts), **more
        )
    return entry if len(problems) == count else None


def read_part(record: Any, table: object, *names: str) -> Entry | None:
    """What a larger table gives of the keys of a record, or None if one of them, or of those named, is wrong.

    The table's own record reports the problems: a mistake elsewhere in the table hides no later check.
    """
    keys = keys_of(record)
    shared = {key: table[key] for key in keys if key in table} if isinstance(table, Mapping) else table
    entry = read_entry(record, shared, "", [])
    return None if entry.wrong & {*(names or keys), ""} else entry


def read_entry(record: Any, table: object, path: str, problems: list[str]) -> Entry:
    """What a table gives of the keys of a record, each by itself."""
    keys = keys_of(record)
    entry = Entry(**{name: key.usual for name, key in keys.items()}, stated=set(), wrong=set())
    if not isinstance(table, Mapping):
        complain(problems, "no_table", path, given=shortened(table))
        entry.wrong.add("")
        return entry
    for name in (name for name in keys if name in table):
        count = len(problems)
        entry.stated.add(name)
        setattr(entry, name, read_value(keys[name], table[name], joined(path, name), problems))
        entry.wrong |= {name} if len(problems) > count else set()
    for name in (name for name, key in keys.items() if key.required and name not in table):
        complain(problems, "missing", joined(path, name), remedy=keys[name].remedy)
        entry.wrong.add(name)
    for name in (name for name in table if name not in keys and not record.any_keys):
        today = (getattr(table, "older", {}).get(key, key) for key in keys)  # or as the file has it
        older = (key for above, _, key in (each.rpartition(".") for each in OLDER) if above == path)
        refuse_name(problems, "unknown", joined(path, name), str(name), dict.fromkeys([*today, *older]))
    return entry


def read_value(key: Key, value: object, path: str, problems: list[str]) -> Any:
    """A value of a key, in the file's unit, with a line for each problem; what is usual in place of a wrong one."""
    if key.stepped and isinstance(value, dict):
        entry = read_table(key.stepped, value, path, problems)
        return None if entry is None else entry.values
    try:
        read = adapter(key).validate_python(value)
    except ValidationError as error:
        every = error.errors(include_url=False, include_context=False)
        problems += [_sentence(key, each, joined(path, *each["loc"])) for each in every]
        return key.usual
    steps = [*pairwise(read or ())] if key.ascending or key.monotone else []
    fall = next((step for step in steps if step[0] >= step[1]), None)
    if fall and key.ascending:
        complain(problems, "pair" if len(read) == 2 else "order", path, before=fall[0], after=fall[1])
    elif fall and not all(before > after for before, after in steps):
        complain(problems, "turns", path, given=shortened(read))
    return read


def _sentence(key: Key, error: ErrorDetails, where: str) -> str:
    """What was needed at a place, what is there and what to do."""
    need = re.sub(r"^(Input|String|List) should", "must", error["msg"])
    need = need.replace("greater than or equal to", "at least").replace("less than or equal to", "at most")
    need = "must be a table" if error["type"] == "dict_type" else need.replace(" after validation", "")
    words = get_args(key.hint) if error["type"] == "literal_error" else ()
    near = did_you_mean(str(error["input"]), map(str, words))
    return f"{where} {need}; it is {shortened(error['input'])}.{near} {key.remedy}"


def tables_of(data: Tables, record: Any = FileEntry, place: Place = ()) -> Iterator[tuple[Place, Any, Any, Key]]:
    """Place, record, content and key of each table within one of a record, whatever is wrong with it."""
    for name, key in keys_of(record).items():
        inner = data.get(name) if key.records else None
        tables = {(*place, name): inner} if inner is not None and not key.named else {}
        if key.named and isinstance(inner, dict):
            tables = {(*place, name, each): table for each, table in inner.items()}
        for path, table in tables.items():
            meant = meant_by(table, key.records)
            yield path, meant, table, key
            if isinstance(table, dict):
                yield from tables_of(table, meant, path)


def meant_by(table: object, records: Sequence[Any]) -> Any:
    """The record that a table's ``kind`` names, or else the last with a key of its own there, or else the first."""
    stated = table if isinstance(table, dict) else {}
    if kind_of(records[0]):
        return {kind_of(record): record for record in records[:-1]}.get(str(stated.get("kind")), records[-1])
    return next((record for record in records[::-1] if keys_apart(record, records) & stated.keys()), records[0])


def read_tables(data: Tables, problems: list[str]) -> dict[str, Any]:
    """The records of a file's tables by their key paths, without those in which anything is wrong."""
    read = {}
    for place, record, table, key in tables_of(data):
        path, name = joined("", *place), str(place[-1])
        if key.named and not key.any_name and not (re.match(NAME_PATTERN, name) and len(name) <= MAX_NAME):
            complain(problems, "name", path)
        # One that should not have a name and is no table is a mistake of the table above it
        if key.named or isinstance(table, dict):
            named = {"name": name} if "name" in record.__dataclass_fields__ and "name" not in keys_of(record) else {}
            read[path] = read_table(record, table, path, problems, **named)
    return {path: record for path, record in read.items() if record is not None}


def translated(data: Tables) -> DrawnTables:
    """The tables of a file by today's names; again they are the same."""
    if isinstance(data, DrawnTables):
        return data
    tables, version = DrawnTables(deepcopy(dict(data))), data.get("schema")
    tables.older, tables.problems, tables.is_schema_1 = {}, [], version == 1 and not isinstance(version, bool)
    for older, today in OLDER.items():
        (*above, name), (table, *inner) = older.split("."), today.split(".")
        holder = table_at(tables, *above)
        if name not in holder:
            continue
        value, beside = holder.pop(name), tables.get(table, {})
        value = {"kind": "hall", **value} if table == "sensors" and isinstance(value, dict) else value
        if inner[0] in table_at(tables, table) if inner else table in tables:
            complain(tables.problems, "twice", today, older=older)
            continue
        tables.older[today] = older
        if not inner or isinstance(beside, dict):  # what is no table is refused as such
            tables[table] = {inner[0]: value, **beside} if inner else value
    if "mechanics" not in tables:
        complain(tables.problems, "no_mass", "moving" if tables.is_schema_1 else "mechanics")
    return tables


def place_in_file(data: Tables, place: Place) -> Place:
    """Where the file has what stands at a place of its tables."""
    for today, older in translated(data).older.items():
        names = tuple(today.split("."))
        if place[: len(names)] == names:
            return (*older.split("."), *place[len(names) :])
    return place


def in_file(data: Tables, text: str) -> str:
    """A key path, or a sentence with some, with the names that the file has."""
    older = translated(data).older
    paths = "|".join(map(re.escape, older))
    return re.sub(rf"(?<![\w.])({paths})(?![\w-])", lambda path: older[path[0]], text) if older else text


def table_at(data: Tables, *keys: str) -> dict[str, Any]:
    """The table at a key path, empty if there is none."""
    place: Any = data
    for key in keys:
        place = place.get(key) if isinstance(place, dict) else None
    return place if isinstance(place, dict) else {}


def joined(path: str, *keys: object) -> str:
    """The key path of names, or positions in a list, below a table's path, quoted where TOML wants it."""
    for key in keys:
        if isinstance(key, int):
            path += f"[{key}]"
            continue
        name = str(key) if re.fullmatch(r"[A-Za-z0-9_-]+", str(key)) else shortened(key)
        path = f"{path}.{name}" if path else name
    return path


def shortened(value: object) -> str:
    """A value as a message shows it."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
