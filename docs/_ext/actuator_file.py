"""The page of the actuator file's keys, made from the schema that reads it."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from femfit.device import electrics, mechanics, parameters, parts, schema
from femfit.device.keys import UNITS, Key, adapter, keys_of, kind_of, unit_of
from femfit.device.materials import LIBRARY
from femfit.device.thermal import Surroundings

REFERENCE = Path(__file__).parents[1] / "reference"
EXAMPLES = [REFERENCE / "every-key-circuits.toml", REFERENCE / "every-key.toml"]  # the later one's come first

# Table as it is written, what it describes, and the record that it is read as
TABLES: tuple[tuple[str, str, Any], ...] = (
    ("", "These keys stand above all tables, and these tables follow.", schema.FileEntry),
    (
        "[materials.NAME]",
        "A linear material: a magnet, a ferrite, or steel far from saturation.",
        parts.LinearMaterial,
    ),
    ("[materials.NAME]", "A soft material that saturates, by its magnetisation curve.", parts.NonlinearMaterial),
    ("[fixed.regions.NAME]", "A part that stands still.", parts.Region),
    ("[coils.NAME]", "A winding.", parts.Coil),
    (
        "[circuits.NAME]",
        "Coils in series and what feeds them. Without it each coil has its own, fed by `[supply]`.",
        electrics.Circuit,
    ),
    ("[moving.regions.NAME]", "A magnetic part of the moving body.", parts.Region),
    ("[mechanics]", "The mass and what else acts on the moving part.", mechanics.Mechanics),
    ("[mechanics.springs.NAME]", "A spring by its stiffness.", mechanics.Spring),
    ("[mechanics.springs.NAME] as measured", "A spring as measured.", mechanics.ForceTable),
    ("[mechanics.near_stop]", "A stop; `[mechanics.far_stop]` has the same keys.", mechanics.Stop),
    ("[sensors.NAME] Hall element", "A Hall element.", electrics.HallElement),
    ("[sensors.NAME] current", "A sensor of a circuit's current.", electrics.CurrentSensor),
    ("[sensors.NAME] position", "A sensor of the distance.", electrics.PositionSensor),
    ("[sensors.NAME] pickup coil", "A winding without current.", electrics.PickupCoil),
    ("[sensors.NAME] acceleration", "An accelerometer.", electrics.AccelerationSensor),
    ("[sensors.NAME] force", "A load cell.", electrics.ForceSensor),
    ("[supply]", "The driver of every circuit without limits of its own.", schema.SupplyEntry),
    ("[sweep]", "The points that are solved.", schema.SweepEntry),
    ("[sweep.parameters.NAME]", "A name of your own for one or more keys that are swept.", parameters.SweptParameter),
    ("{ key, factor, offset }", "A key that follows a named parameter.", schema.KeyEntry),
    ("{ min, max, step }", "The range of a Latin hypercube.", schema.SampledEntry),
    ("{ start, stop, step }", "Equally spaced values, both ends included.", schema.RangeEntry),
    ("[solver]", "How accurate the field solution has to be, and at which frequencies.", schema.SolverEntry),
    (
        "{ start, stop, per_decade }",
        "Frequencies equally spaced in their logarithm.",
        schema.FrequencyRangeEntry,
    ),
    (
        "[thermal]",
        "What temperatures depend on beside the drawing: [Find temperatures](../howto/find_temperatures.md).",
        Surroundings,
    ),
    ("[reference]", "The closed loop's steps.", schema.ReferenceEntry),
    (
        "[tolerances]",
        'How far numbers of the file may be off, by `"key.path" = 0.05` in each one\'s unit, and all other lengths.',
        schema.ToleranceEntry,
    ),
)

LONGEST_EXAMPLE = 50


def page() -> str:
    """The whole page."""
    examples = [tomllib.loads(path.read_text(encoding="utf-8")) for path in EXAMPLES]
    materials = "".join(f"| `{name}` | {_cell(entry.reference)} |\n" for name, entry in LIBRARY.items())
    sections = "".join(_section(*table, _examples(table[0], table[2], examples)) for table in TABLES)
    return _HEAD + sections + _TAIL.format(materials=materials)


def _section(name: str, text: str, record: Any, examples: dict[str, Any]) -> str:
    rows = "".join(
        f"| `{name}` | {_unit(name)} | {_cell(key.remedy)} | {_range(key)} | "
        f"{'**required**' if key.required else _default(key.usual)} | {_example(name, examples)} |\n"
        for name, key in sorted(keys_of(record).items(), key=lambda item: item[0] != "kind")
    )
    title = f"`{name}`" if name else "The top of the file"
    heading = f"\n## {title}\n\n" if record is not parts.NonlinearMaterial else "\n"
    head = "| key | unit | what to give | range | default | example |\n|---|---|---|---|---|---|\n"
    return f"{heading}{text}\n\n{head}{rows}"


def _unit(name: str) -> str:
    unit = unit_of(name)
    return unit and UNITS[unit].printed


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def _range(key: Key) -> str:
    """Limits of a number, of a text's characters or of a list's length, from the JSON schema."""
    described = adapter(key).json_schema()
    parts = []
    for form in [described, *described.get("anyOf", ())]:
        items = form.get("items", {})
        lower, upper = form.get("minimum", items.get("minimum")), form.get("maximum", items.get("maximum"))
        if "exclusiveMinimum" in form:
            parts.append(f"above {form['exclusiveMinimum']:g}")
        elif lower is not None:
            parts.append(f"at least {lower:g}" if upper is None else f"{lower:g} to {upper:g}")
        if "enum" in form:
            parts.append(" or ".join(f'`"{one}"`' for one in form["enum"]))
        if form.get("minItems") and not key.words:
            least, most = form["minItems"], form.get("maxItems")
            parts.append(f"{least} values" if least == most else f"at least {least} values")
    return "; ".join(dict.fromkeys(parts))


def _default(usual: object) -> str:
    return "" if usual in (None, "", {}) else f"`{_toml(usual)}`"


def _example(key: str, examples: dict[str, Any]) -> str:
    if key not in examples:
        return ""
    value = examples[key]
    if isinstance(value, dict) and not set(value) & {"start", "min"}:
        return "a table"
    text = _toml(value)
    return f"`{text}`" if len(text) < LONGEST_EXAMPLE else f"`{text[: LONGEST_EXAMPLE - 4]} ...`"


def _examples(name: str, record: Any, examples: list[dict[str, Any]]) -> dict[str, Any]:
    """Value by key in the examples' tables of a name of :data:`TABLES`; where two have a key, of the fuller one."""
    every = [one for example in examples for one in _tables(example)]
    if name.startswith("{"):
        names = set(name.strip("{ }").split(", "))
        tables = [table for _, table in every if names <= table.keys()]
    else:
        wanted = name.partition(" ")[0].strip("[]").split(".") if name else []
        tables = [table for path, table in every if _fits(path, wanted)]
        if "sensors" in wanted:
            tables = [table for table in tables if table.get("kind") == kind_of(record)]
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
everything else is in SI units, and each key ends in its unit. The axis is `r = 0`, and `z = 0` is the fixed part's
reference face. The moving part is drawn in its own coordinates, its nearest face at `z = 0`; its distance is what the
sweep adds to z. A moving coil that reaches into its gap has a negative distance.

femfit reports every mistake in a file at once, with the key, what it found and what to write instead.

`femfit new` writes a commented drawing to start from. Older files with `schema = 1` are still read: they have `[coil]`
for `[coils.coil]`, `[hall]` for `[sensors.hall]`, `[electromagnet]` for `[fixed]`, and the mass in `[moving]`.

[`every-key.toml`](../reference/every-key.toml) and
[`every-key-circuits.toml`](../reference/every-key-circuits.toml) use every key below; the examples come from them.
"""

_TAIL = """
## Materials of the library

`material` may also name one of these.

| name | where its values come from |
|---|---|
{materials}
## The whole examples

```{{literalinclude}} ../reference/every-key.toml
:language: toml
```

```{{literalinclude}} ../reference/every-key-circuits.toml
:language: toml
```
"""
