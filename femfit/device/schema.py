"""Tables of the actuator file that parts of the device follow from, in the file's units.

Those that are parts of the device as they stand are read straight into their records in SI units, in
:mod:`femfit.device.parts`, :mod:`femfit.device.mechanics`, :mod:`femfit.device.electrics` and
:mod:`femfit.device.thermal`. What a key may say of itself is in :mod:`femfit.device.keys`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, get_args

from femfit.device.electrics import DIODE, AnySensor, Circuit, HallElement
from femfit.device.keys import (
    ELECTRICAL,
    LENGTH,
    Entry,
    Key,
    Record,
    adapter,
    decimal_sum,
    key,
    keys_apart,
    keys_of,
    kind_of,
)
from femfit.device.mechanics import Mechanics
from femfit.device.parts import Coil, LinearMaterial, MovingPart, NonlinearMaterial, Region
from femfit.device.thermal import Surroundings

MAX_AXIS_POINTS = 10_000
MAX_FREQUENCIES = 1000
FREQUENCY: dict[str, Any] = {"gt": 0.0, "le": 1e9}
_DIGITS = 9
"""Significant digits of a frequency between the ends of a range, the same on every machine."""


class RangeEntry(Record):
    """``{ start = ..., stop = ..., step = ... }``, both ends included; the same on every machine."""

    start: float = key("the first value", **LENGTH)
    stop: float = key("the last value; it belongs to the grid", **LENGTH)
    step: float = key("a positive step that divides stop - start", gt=0)
    values: tuple[float, ...]

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """The values, in decimals."""
        count = round(min((entry.stop - entry.start) / entry.step, MAX_AXIS_POINTS))
        values = tuple(decimal_sum(entry.start, k, entry.step) for k in range(count + 1))
        if entry.stop <= entry.start:
            complain("no_range")
        elif count >= MAX_AXIS_POINTS:
            complain("many_steps", most=MAX_AXIS_POINTS)
        elif values[-1] != entry.stop:
            complain("no_divisor", end=values[-1])
        return {"values": values}


class FrequencyRangeEntry(Record):
    """``{ start = ..., stop = ..., per_decade = ... }``, both ends included."""

    start: float = key("the lowest frequency in Hz", **FREQUENCY)
    stop: float = key("the highest frequency in Hz; it belongs to the list", **FREQUENCY)
    per_decade: int = key("how many frequencies there are in each decade", ge=1, le=100)
    values: tuple[float, ...]

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """The values, equally spaced in their logarithm."""
        ratio = entry.stop / entry.start
        # A range of no whole number of steps gets a step more, not wider ones
        steps = math.ceil(round(entry.per_decade * math.log10(ratio), _DIGITS))
        if ratio <= 1.0:
            complain("no_range")
        elif steps >= MAX_FREQUENCIES:
            complain("many_frequencies", most=MAX_FREQUENCIES, count=steps + 1)
        between = (entry.start * ratio ** (k / steps) for k in range(1, steps))
        return {"values": (entry.start, *(float(f"{value:.{_DIGITS}g}") for value in between), entry.stop)}


SCHEMA_VERSION = 2
NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
MAX_NAME = 64
PARAMETER: dict[str, Any] = {"ge": -1e9, "le": 1e9}
AXIS: dict[str, Any] = {"count": ((1, MAX_AXIS_POINTS),), "ascending": True, "stepped": RangeEntry, **LENGTH}
BODIES = ("fixed", "moving")


class FixedEntry(Record):
    """``[fixed]``."""

    regions: tuple[Region, ...] = key("each fixed part as a table [fixed.regions.NAME]", ())


class SupplyEntry(Record):
    """``[supply]``."""

    voltage_min_V: float = key("the lowest voltage of the driver; negative for a bridge", **ELECTRICAL)
    voltage_max_V: float = key("the highest voltage of the driver", **ELECTRICAL)
    sample_time_s: float | None = key(
        "the controller's period in ms, or leave it out to have it from L/R", None, ge=1e-6, le=1e6
    )
    diode_V: float | None = key(**DIODE)


class SomeSensor(Record):
    """``[sensors.NAME]`` of no known kind, of which no other key can be read."""

    any_keys = True

    kind: Literal[*map(kind_of, get_args(AnySensor))] = key("one of them")  # type: ignore[valid-type]


class SweepEntry(Record):
    """``[sweep]``: its axes, and how its parameters are combined."""

    current_A: tuple[float, ...] = key("ascending currents as a list or as { start, stop, step }", usual=None, **AXIS)
    distance_mm: tuple[float, ...] = key("ascending distances as a list or as { start, stop, step }", **AXIS)
    parameters: Mapping[str, Any] = key(
        "what else is swept as a table [sweep.parameters], or leave it out", None, usual={}
    )
    design: Literal["grid", "list", "latin_hypercube"] = key(
        "how parameters are combined: every combination, line by line, or drawn at random", "grid"
    )
    samples: int | None = key("the number of samples of a latin_hypercube", None, ge=2, le=MAX_AXIS_POINTS)
    seed: int = key("the seed of a latin_hypercube", 1, ge=0, le=2**63 - 1)


class KeyEntry(Record):
    """``{ key = ..., factor = ..., offset = ... }``: a number of the file that follows a parameter, or a material."""

    path: str = key("a key path of this file in quotes", file="key")
    factor: float = key("what the parameter is multiplied by, -1 to mirror it", 1.0, **PARAMETER)
    offset: float = key("what is added then, in the file's unit", 0.0, **PARAMETER)


class SampledEntry(Record):
    """``{ min = ..., max = ..., step = ... }``: a range that a latin_hypercube draws from."""

    min: float = key("the lowest value", **PARAMETER)
    max: float = key("the highest value, above min", **PARAMETER)
    step: float | None = key("a step for values like whole turns, or leave it out", None, gt=0)

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """Nothing; the range is not empty, and a step divides it."""
        if entry.min >= entry.max:
            complain("min_max")
        elif entry.step is not None:
            steps = min(round((entry.max - entry.min) / entry.step), 10**9)
            if decimal_sum(entry.min, steps, entry.step) != entry.max:
                complain("sampled_step")
        return {}


class SolverEntry(Record):
    """``[solver]``: how accurate the field solver has to be, and at which frequencies."""

    tolerance: float | None = key(
        "the relative accuracy of force and flux linkage, as 1e-3 for 0.1 %", None, ge=1e-5, le=0.1
    )
    frequency_Hz: tuple[float, ...] | None = key(
        "the frequencies of the impedance as an ascending list or as { start, stop, per_decade }",
        None,
        ascending=True,
        stepped=FrequencyRangeEntry,
        count=((1, MAX_FREQUENCIES),),
        **FREQUENCY,
    )
    eddy_error: float = key(
        "the relative error of impedance, force and Hall field that the model of the eddy currents may have",
        0.01,
        ge=1e-4,
        le=0.2,
    )
    eddy_bias_A: float | tuple[float, ...] | None = key(
        "the current in A about which the eddy currents of saturating parts are linearised, or a list with one for "
        "each circuit",
        None,
        count=((0, None),),
    )


class ReferenceEntry(Record):
    """``[reference]``: the closed loop's steps."""

    distance_m: tuple[float, ...] = key(
        "the reference distances in mm, in their order, within the sweep", count=((1, 1000),), **LENGTH
    )


class ToleranceEntry(Record):
    """``[tolerances]``: how far numbers of the file may be off, beside those that are named by their key paths."""

    any_keys = True

    length_mm: float | None = key(
        "the standard deviation of all lengths in mm, or leave it to ISO 2768 m", None, gt=0, le=1e3
    )


class FileEntry(Record):
    """The top level; each table is read by its own record so that one mistake hides no other."""

    schema_version: int = key("schema = 2", file="schema", ge=1)
    described_by: str = key("where the JSON Schema is, for an editor", "", file="$schema")
    name: str = key(
        "a short name of letters, digits, - and _, after which directories are named",
        pattern=NAME_PATTERN,
        max_length=MAX_NAME,
    )
    description: str = key("free text in quotes", "")
    materials: tuple[LinearMaterial | NonlinearMaterial, ...] = key(
        "each material as a table [materials.NAME]", (), any_name=True
    )
    fixed: FixedEntry | None = key("fixed parts as [fixed.regions.NAME]", None)
    moving: MovingPart | None = key("each magnetic part of the body as [moving.regions.NAME]", None)
    coils: tuple[Coil, ...] = key("each winding as a table [coils.NAME]", ())
    circuits: tuple[Circuit, ...] = key("each circuit as [circuits.NAME]; without, one a coil", ())
    mechanics: Mechanics | None = key("mass, springs, friction and stops as [mechanics]", None)
    sensors: tuple[AnySensor | SomeSensor, ...] = key("each sensor as a table [sensors.NAME] with its kind", ())
    supply: SupplyEntry | None = key("the driver as a table [supply]", None)
    sweep: Mapping[str, Any] = key("the grid as a table [sweep] with current_A and distance_mm", form=SweepEntry)
    solver: SolverEntry | None = key("[solver] tolerance, or leave it out", None, of_device=False)
    thermal: Surroundings | None = key("what temperatures depend on as a table [thermal]", None, of_device=False)
    reference: ReferenceEntry | None = key("[reference] distance_mm, or leave it out", None, of_device=False)
    tolerances: Mapping[str, Any] = key(
        "standard deviations of this file's numbers by their key paths as [tolerances]",
        None,
        usual={},
        form=ToleranceEntry,
    )


OLDER = {"electromagnet": "fixed", "coil": "coils.coil", "hall": "sensors.hall", "moving.mass_g": "mechanics.mass_g"}
"""Today's key path of each older one."""


def json_schema() -> dict[str, Any]:
    """That of a file, under its older names, too."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **_of_table(FileEntry)}
    for older, today in OLDER.items():
        (*above, name), described, holder = older.split("."), schema, schema
        for table in today.split("."):
            described = described.get("properties", {}).get(table) or described["additionalProperties"]
        for table in above:
            holder = holder["properties"][table]
        # Which kind of sensor it is, its name says
        holder["properties"][name] = _of_table(HallElement) if name == "hall" else described
    return schema


def _of_table(record: Any) -> dict[str, Any]:
    keys, properties = keys_of(record), {}
    for name, declared in keys.items():
        form = _of_records(declared.records) if declared.records else _of_values(declared)
        form = {"type": "object", "additionalProperties": form} if declared.named else form
        usual = {} if declared.usual is None else {"default": declared.usual}
        properties[name] = {**form, "description": declared.remedy, **usual}
    needed = [name for name, declared in keys.items() if declared.required]
    return {"type": "object", "properties": properties, "required": needed, "additionalProperties": record.any_keys}


def _of_records(records: Sequence[Any]) -> dict[str, Any]:
    """Of the record that a table's keys decide for: an editor points then at the key that is wrong in it."""
    tagged = bool(kind_of(records[0]))
    *tried, usual = records if tagged else records[::-1]
    form = _of_table(usual)
    for record in tried[::-1]:
        kind = {"properties": {"kind": {"const": kind_of(record)}}, "required": ["kind"]}
        has_own = {"anyOf": [{"required": [name]} for name in sorted(keys_apart(record, records))]}
        form = {"if": kind if tagged else has_own, "then": _of_table(record), "else": form}
    return form


def _of_values(declared: Key) -> dict[str, Any]:
    """Of a value, of a list that a range may stand for, or of a table that is read by a reader of its own."""
    form = _of_table(declared.form) if declared.form else adapter(declared).json_schema()
    ways = [way for way in form.get("anyOf", ()) if way != {"type": "null"}]  # TOML has none
    form = ways[0] if len(ways) == 1 else {"anyOf": ways} if ways else form
    if not declared.stepped:
        return form
    table = _of_table(declared.stepped)
    form = {"if": {"type": "object"}, "then": table, "else": form}
    if declared.field == "current_A":  # Of each circuit by its name, unless a number stands at a key of a range
        numbers = {name: {"type": "number"} for name in table["properties"]}
        ranged = {"properties": numbers, "anyOf": [{"required": [name]} for name in numbers]}
        form = {**form, "then": {"if": ranged, "then": table, "else": {"additionalProperties": form}}}
    return form
