"""The actuator file as typed tables: which keys there are, in which unit and range.

A field's description is the remedy printed when its key is missing or wrong. Lengths are in mm, masses in g;
:mod:`femfit.device.load` turns them into the SI data of :mod:`femfit.device.parts`.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue, PlainValidator, TypeAdapter, WithJsonSchema
from pydantic_core import PydanticCustomError

SCHEMA_VERSION = 2
NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
MAX_NAME = 64
MAX_AXIS_POINTS = 10_000

# The bounds are far beyond any actuator, and keep products of values far from overflow and underflow.
Length = Annotated[float, Field(ge=-1e5, le=1e5)]
Electrical = Annotated[float, Field(ge=-1e6, le=1e6)]
Interval = Annotated[list[Length], Field(min_length=2, max_length=2)]
Lengths = Annotated[list[Length], Field(min_length=2, max_length=1000)]
Noise = Annotated[float, Field(ge=0, le=1e6)]
Time = Annotated[float, Field(ge=0, le=1e6)]
Period = Annotated[float, Field(ge=1e-6, le=1e6)]
Drop = Annotated[float, Field(ge=0, le=100)]
Turns = Annotated[float, Field(ge=1, le=1e7)]
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=MAX_NAME)]


OLDER: dict[str, JsonValue] = {"schema": 1}
"""Marks the forms of schema 1, which are read and no longer described."""


STRICT = ConfigDict(strict=True, allow_inf_nan=False)


def list_of(kind: Any, most: int = MAX_AXIS_POINTS) -> TypeAdapter[list[Any]]:
    """What reads a list of one or more of a kind."""
    return TypeAdapter(Annotated[list[kind], Field(min_length=1, max_length=most)], config=STRICT)


def key(what: str, default: Any = ..., **limits: Any) -> Any:
    """A key of a table: what to give, which is also the remedy where it is missing or wrong, and its limits."""
    return Field(default, description=f"Give {what}.", **limits)


class Entry(BaseModel):
    """A table of the file: unknown keys, coerced types, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, **STRICT)

    def faults(self) -> Iterator[str]:
        """What is wrong between keys that are right each by itself, to be read behind the table's key path."""
        return iter(())


class FileEntry(Entry):
    """The top level; each table is read by its own entry so that one mistake hides no other."""

    schema_version: int = key("schema = 2", alias="schema", ge=1)
    name: Name = key("a short name of letters, digits, - and _; directories are named after it")
    description: str = key("free text in quotes", "")
    materials: dict[str, Any] = key("each material as a table [materials.NAME]", {})
    fixed: dict[str, Any] = key("fixed parts as [fixed.regions.NAME]", {})
    electromagnet: dict[str, Any] = key("fixed parts as [fixed.regions.NAME]", {}, json_schema_extra=OLDER)
    coils: dict[str, Any] = key("each winding as a table [coils.NAME]", {})
    coil: dict[str, Any] | None = key("the winding as a table [coils.NAME]", None, json_schema_extra=OLDER)
    circuits: dict[str, Any] = key("each circuit as [circuits.NAME]; without, one a coil", {})
    moving: dict[str, Any] = key("each magnetic part of the body as [moving.regions.NAME]", {})
    mechanics: dict[str, Any] | None = key("mass, springs, friction and stops as [mechanics]", None)
    sensors: dict[str, Any] = key("each sensor as a table [sensors.NAME] with its kind", {})
    hall: dict[str, Any] | None = key("the Hall element as a table [sensors.NAME]", None, json_schema_extra=OLDER)
    supply: dict[str, Any] | None = key("the driver as a table [supply]", None)
    sweep: dict[str, Any] = key("the grid as a table [sweep] with current_A and distance_mm")
    solver: dict[str, Any] | None = key("[solver] tolerance, or leave it out", None)
    thermal: dict[str, Any] | None = key("what temperatures depend on as a table [thermal]", None)
    reference: dict[str, Any] | None = key("[reference] distance_mm, or leave it out", None)
    tolerances: dict[str, Any] = key(
        "standard deviations of this file's numbers by their key paths as [tolerances]", {}
    )


Corner = Annotated[list[Length], Field(min_length=2, max_length=3)]


class OutlineEntry(Entry):
    """An outline: a box (r_mm and z_mm), a polygon with arcs (polygon_mm) or a circle (circle_mm)."""

    r_mm: Interval | None = key("[inner, outer] radius in mm", None)
    z_mm: Interval | None = key("[lower, upper] height in mm", None)
    polygon_mm: Annotated[list[Corner], Field(min_length=2, max_length=1000)] | None = key(
        "at least three corners [[r, z], ...] in mm; a third number is the angle in degrees of an arc to the next "
        "corner, positive counter-clockwise",
        None,
    )
    circle_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = key(
        "[r, z, radius]: a ball where r is 0, a ring with a round section elsewhere", None
    )


def _direction(*names: str) -> PlainValidator:
    """A direction by one of these names or as [r, z]."""

    def checked(value: Any) -> str | list[float] | None:
        if value is None or (isinstance(value, str) and value in names):
            return value
        numbers = [number for number in value if type(number) in {int, float}] if isinstance(value, list) else []
        if len(numbers) == 2 == len(value) and all(abs(number) < MAX_DIRECTION for number in numbers):
            return [float(number) for number in numbers]
        choices = " or ".join(repr(name) for name in names)
        raise PydanticCustomError("direction", "Input should be {known} or a direction [r, z]", {"known": choices})

    return PlainValidator(checked, json_schema_input_type=Literal[*names] | list[float])


MAX_DIRECTION = 1e5  # far beyond any direction that is written, and not infinite


class RegionEntry(OutlineEntry):
    """``[fixed.regions.NAME]`` or ``[moving.regions.NAME]``."""

    material: str = key("the name of a material of [materials] or of the library")
    magnetization: Annotated[Any, _direction("+z", "-z", "+r", "-r")] = key(
        '"+z", "-z", "+r" (radially outwards), "-r" or a direction [r, z] for a magnet; leave it out otherwise', None
    )
    temperature_C: float | None = key("a magnet's temperature in degC, or leave it at 20 degC", None, ge=-273, le=500)


class ElectromagnetEntry(Entry):
    """``[fixed]``, or ``[electromagnet]`` of schema 1."""

    regions: dict[str, Any] = key("each fixed part as a table [fixed.regions.NAME]", {})


class CoilEntry(OutlineEntry):
    """``[coils.NAME]``, or ``[coil]`` of schema 1."""

    turns: Turns = key("the number of turns of the whole winding")
    wire_diameter_mm: float | None = key("the bare copper diameter in mm", None, ge=1e-3, le=1e3)
    resistance_ohm: float | None = key("the resistance in ohm, or leave it to the wire", None, ge=1e-9, le=1e9)
    temperature_C: float = key("the winding's temperature for the resistance from the wire", 20.0, ge=-200, le=500)


class MovingEntry(Entry):
    """``[moving]``."""

    mass_g: float | None = key(
        "the mass of the whole moving body as mechanics.mass_g", None, ge=1e-6, le=1e9, json_schema_extra=OLDER
    )
    regions: dict[str, Any] = key("each magnetic part of the body as [moving.regions.NAME]", {})


class HallPlace(Entry):
    """Where the Hall element sits."""

    r_mm: float = key("the radius of the element in mm, 0 on the axis", ge=0, le=1e5)
    z_mm: Length = key("the height of the element in mm, 0 at the fixed part's reference face")


class HallEntry(HallPlace):
    """``[sensors.NAME]`` of kind hall, or ``[hall]`` of schema 1; defaults as in :mod:`femfit.device.electrics`."""

    kind: Literal["hall"] = key('"hall" in a table of [sensors]', "hall")
    direction: Annotated[Any, _direction("z", "r")] = key('the component that it measures, "z", "r" or [r, z]', "z")
    delay_ms: Time = key("how late a reading is in ms", 0.0)
    sample_time_ms: Period | None = key("the time from one reading to the next, or leave it to the controller's", None)
    sensitivity_V_per_T: Electrical = key("the slope in V/T (5 mV/G is 50 V/T)", 50.0)
    quiescent_V: Electrical = key("the output without field in volts", 2.5)
    output_min_V: Electrical = key("the lowest output in volts", 0.0)
    output_max_V: Electrical = key("the highest output in volts", 5.0)
    adc_bits: int = key("the converter's bits, 0 for none", 12, ge=0, le=32)
    noise_V: Noise = key("the standard deviation of one sample in volts", 0.0)

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        low, high, quiescent = self.output_min_V, self.output_max_V, self.quiescent_V
        if low >= high:
            yield f".output_min_V must be below output_max_V; they are {low:g} and {high:g}. Exchange or change them."
        elif not low <= quiescent <= high:
            yield (
                f".quiescent_V must lie between output_min_V and output_max_V; it is {quiescent:g} with {low:g} and "
                f"{high:g}. Change one of the three."
            )
        if not self.sensitivity_V_per_T:
            yield ".sensitivity_V_per_T must not be 0; nothing would be seen. Give it, or remove the table."


class SupplyEntry(Entry):
    """``[supply]``."""

    voltage_min_V: Electrical = key("the lowest voltage of the driver; negative for a bridge")
    voltage_max_V: Electrical = key("the highest voltage of the driver")
    sample_time_ms: Period | None = key("the controller's period in ms, or leave it out to have it from L/R", None)
    diode_V: Drop | None = key("the forward voltage of the freewheel diode of a one-sided driver", None)


class RangeEntry(Entry):
    """``{ start = ..., stop = ..., step = ... }``, both ends included."""

    start: Length = key("the first value")
    stop: Length = key("the last value; it belongs to the grid")
    step: float = key("a positive step that divides stop - start", gt=0)


ParameterValue = Annotated[float, Field(ge=-1e9, le=1e9)]
AXIS_VALUES = list_of(Length)
PARAMETER_VALUES = list_of(ParameterValue)
NAMES = list_of(str)
Axis = Annotated[Any, WithJsonSchema(AXIS_VALUES.json_schema())]
"""A list of :data:`AXIS_VALUES` or a table of :class:`RangeEntry`, which :mod:`femfit.device.read_sweep` reads."""


class DesignEntry(Entry):
    """How a sweep's parameters are combined."""

    parameters: dict[str, Any] = key("what else is swept as a table [sweep.parameters], or leave it out", {})
    design: Literal["grid", "list", "latin_hypercube"] = key(
        "how parameters are combined: every combination, line by line, or drawn at random", "grid"
    )
    samples: int | None = key("the number of samples of a latin_hypercube", None, ge=2, le=MAX_AXIS_POINTS)
    seed: int = key("the seed of a latin_hypercube", 1, ge=0, le=2**63 - 1)


class SweepEntry(DesignEntry):
    """``[sweep]``."""

    current_A: Axis = key("ascending currents as a list or as { start, stop, step }")
    distance_mm: Axis = key("ascending distances as a list or as { start, stop, step }")


class KeyEntry(Entry):
    """``{ key = ..., factor = ..., offset = ... }``: a number of the file that follows a parameter, or a material."""

    path: str = key("a key path of this file in quotes", alias="key")
    factor: ParameterValue = key("what the parameter is multiplied by, -1 to mirror it", 1.0)
    offset: ParameterValue = key("what is added then, in the file's unit", 0.0)


class NamedParameterEntry(Entry):
    """``[sweep.parameters.NAME]``: a name of one's own for one or more keys of the file."""

    keys: Annotated[list[Any], Field(min_length=1, max_length=100)] = key("the key paths that follow the parameter")
    values: Any = key("a list, { start, stop, step }, or { min, max } for a latin_hypercube")


class SampledEntry(Entry):
    """``{ min = ..., max = ..., step = ... }``: a range that a latin_hypercube draws from."""

    min: ParameterValue = key("the lowest value")
    max: ParameterValue = key("the highest value, above min")
    step: float | None = key("a step for values like whole turns, or leave it out", None, gt=0)


class ToleranceEntry(Entry):
    """``[tolerances]``: how far numbers of the file may be off, beside those that are named by their key paths."""

    length_mm: float | None = key(
        "the standard deviation of all lengths in mm, or leave it to ISO 2768 m", None, gt=0, le=1e3
    )


class ReferenceEntry(Entry):
    """``[reference]``: the closed loop's steps."""

    distance_mm: Annotated[list[Length], Field(min_length=1, max_length=1000)] = key(
        "the reference distances in mm, in their order, within the sweep"
    )
