"""The page of the actuator file's keys, made from the schema that reads it."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from femfit.device import schema
from femfit.device.materials import LIBRARY

EXAMPLE = Path(__file__).parents[1] / "reference" / "every-key.toml"

# Table as it is written, what it describes, and the class of the schema that reads it
TABLES = (
    ("", "These keys stand above all tables, and these tables follow.", schema.FileEntry),
    ("[materials.NAME]", "A linear material: a magnet, a ferrite, or steel far from saturation.", schema.MaterialEntry),
    ("[materials.NAME]", "A soft material that saturates, by its magnetisation curve.", schema.CurveEntry),
    ("[electromagnet.regions.NAME]", "A part of the fixed core.", schema.RegionEntry),
    ("[coil]", "The winding.", schema.CoilEntry),
    ("[moving]", "The moving part.", schema.MovingEntry),
    ("[moving.regions.NAME]", "A magnetic part of the moving body.", schema.RegionEntry),
    ("[hall]", "A Hall element, where there is one.", schema.HallEntry),
    ("[supply]", "The driver.", schema.SupplyEntry),
    ("[sweep]", "The points that are solved.", schema.SweepEntry),
    ("[sweep.parameters.NAME]", "A name of your own for one or more keys that are swept.", schema.NamedParameterEntry),
    ("{ key, factor, offset }", "A key that follows a named parameter.", schema.KeyEntry),
    ("{ min, max, step }", "The range of a Latin hypercube.", schema.SampledEntry),
    ("{ start, stop, step }", "Equally spaced values, both ends included.", schema.RangeEntry),
    ("[solver]", "How accurate the field solution has to be.", schema.SolverEntry),
    ("[reference]", "The closed loop's steps.", schema.ReferenceEntry),
)

LONGEST_EXAMPLE = 50

UNITS = (
    ("_V_per_T", "V/T"), ("_A_per_m", "A/m"), ("_per_K", "1/K"), ("_mm", "mm"), ("_ms", "ms"), ("_ohm", "Ω"),
    ("_T", "T"), ("_A", "A"), ("_V", "V"), ("_g", "g"), ("_C", "°C"),
)  # fmt: skip


def page() -> str:
    """The whole page."""
    example = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    materials = "".join(f"| `{name}` | {_cell(entry.reference)} |\n" for name, entry in LIBRARY.items())
    sections = "".join(_section(*table, _examples(table[0], example)) for table in TABLES)
    return _HEAD + sections + _TAIL.format(materials=materials)


def _section(name: str, text: str, entry: type[schema.Entry], examples: dict[str, Any]) -> str:
    described = entry.model_json_schema(by_alias=True)
    required = set(described.get("required", ()))
    rows = "".join(
        f"| `{key}` | {_unit(key)} | {_cell(value['description'])} | {_range(value, described)} | "
        f"{'**required**' if key in required else _default(value)} | {_example(key, examples)} |\n"
        for key, value in described["properties"].items()
    )
    title = f"`{name}`" if name else "The top of the file"
    heading = f"\n## {title}\n\n" if name != "[materials.NAME]" or entry is schema.MaterialEntry else "\n"
    head = "| key | unit | what to give | range | default | example |\n|---|---|---|---|---|---|\n"
    return f"{heading}{text}\n\n{head}{rows}"


def _unit(key: str) -> str:
    return next((unit for ending, unit in UNITS if key.endswith(ending)), "")


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def _range(value: dict[str, Any], described: dict[str, Any]) -> str:
    """Limits of a number, of a text's characters or of a list's length, from the JSON schema."""
    parts = []
    for form in [value, *value.get("anyOf", ())]:
        kind = described["$defs"][form["$ref"].rpartition("/")[2]] if "$ref" in form else form
        items = kind.get("items", {})
        lower, upper = kind.get("minimum", items.get("minimum")), kind.get("maximum", items.get("maximum"))
        if "exclusiveMinimum" in kind:
            parts.append(f"above {kind['exclusiveMinimum']:g}")
        elif lower is not None:
            parts.append(f"at least {lower:g}" if upper is None else f"{lower:g} to {upper:g}")
        if "enum" in kind:
            parts.append(" or ".join(f'`"{one}"`' for one in kind["enum"]))
        if "minItems" in kind:
            least, most = kind["minItems"], kind.get("maxItems")
            parts.append(f"{least} values" if least == most else f"at least {least} values")
    return "; ".join(dict.fromkeys(parts))


def _default(value: dict[str, Any]) -> str:
    default = value.get("default")
    return "" if default in (None, "", {}) else f"`{_toml(default)}`"


def _example(key: str, examples: dict[str, Any]) -> str:
    if key not in examples:
        return ""
    value = examples[key]
    if isinstance(value, dict) and not set(value) & {"start", "min"}:
        return "a table"
    text = _toml(value)
    return f"`{text}`" if len(text) < LONGEST_EXAMPLE else f"`{text[: LONGEST_EXAMPLE - 4]} ...`"


def _examples(name: str, example: dict[str, Any]) -> dict[str, Any]:
    """Value by key in the example's tables of a name of :data:`TABLES`; where two have a key, of the fuller one."""
    if name.startswith("{"):
        first = name.strip("{ }").split(",")[0]
        tables = [table for _, table in _tables(example) if first in table]
    else:
        wanted = name.strip("[]").split(".") if name else []
        tables = [table for path, table in _tables(example) if _fits(path, wanted)]
    return {key: value for table in sorted(tables, key=len) for key, value in table.items()}


def _fits(path: tuple[str, ...], wanted: list[str]) -> bool:
    return len(path) == len(wanted) and all(want in ("NAME", part) for part, want in zip(path, wanted, strict=True))


def _tables(table: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Every table within a table with its path, those in lists too."""
    yield path, table
    for key, value in table.items():
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, dict):
                yield from _tables(inner, (*path, key))


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(one)}' for key, one in value.items())} }}"
    return re.sub(r"e-0", "e-", f"{value:g}")


_HEAD = """\
# The actuator file

An actuator file describes an axisymmetric actuator in [TOML](https://toml.io). Lengths are in mm and masses in g;
everything else is in SI units, and each key ends in its unit. The axis is `r = 0`. The fixed part ends at the face
`z = 0`, and the moving part lies above it: its distance is the height of its nearest face. Draw the moving part in its
own coordinates, its nearest face at `z = 0`.

femfit reports every mistake in a file at once, with the key, what it found and what to write instead.

[`every-key.toml`](../reference/every-key.toml) is a complete file that uses every key below; the examples come from it.
"""

_TAIL = """
## Materials of the library

`material` may also name one of these.

| name | where its values come from |
|---|---|
{materials}
## The whole example

```{{literalinclude}} ../reference/every-key.toml
:language: toml
```
"""
