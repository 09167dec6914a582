"""Actuator files as JSON Schema has them, for editors that complete keys and say what each wants."""

from typing import Any

from femfit.device.complaints import adapter
from femfit.device.keys import keys_of
from femfit.device.schema import FileEntry
from femfit.device.schema_1 import OLDER


def json_schema() -> dict[str, Any]:
    """That of a file, under its older names, too."""
    schema = _of_table(FileEntry)
    for older, today in OLDER.items():
        (*above, name), described, holder = older.split("."), schema, schema
        for key in today.split("."):
            described = described.get("properties", {}).get(key) or described["additionalProperties"]
        for key in above:
            holder = holder["properties"][key]
        holder["properties"][name] = described
    return schema


def _of_table(record: Any) -> dict[str, Any]:
    properties = {}
    for name, key in keys_of(record).items():
        ways = [_of_table(each) for each in key.records if not each.any_keys]
        ways += [] if ways else [_of_table(key.form) if key.form else adapter(key).json_schema()]
        # Of a circuit's currents there is a table by their names, too
        ways += [{**_of_table(key.stepped), "required": [], "additionalProperties": True}] if key.stepped else []
        form = ways[0] if len(ways) == 1 else {"anyOf": ways}
        usual = {} if key.usual is None else {"default": key.usual}
        properties[name] = {"type": "object", "additionalProperties": form} if key.named else form
        properties[name] = {**properties[name], "description": key.remedy, **usual}
    needed = [name for name, key in keys_of(record).items() if key.required]
    return {"type": "object", "properties": properties, "required": needed, "additionalProperties": record.any_keys}
