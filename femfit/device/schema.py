"""The actuator file as typed tables: which keys there are, in which unit and range.

A field's description is the remedy printed when its key is missing or wrong. Lengths are in mm, masses in g;
:mod:`femfit.device.load` turns them into the SI data of :mod:`femfit.device.parts`.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, JsonValue, PlainValidator, Tag
from pydantic_core import PydanticCustomError

SCHEMA_VERSION = 2
NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
MAX_AXIS_POINTS = 10_000

# The bounds are far beyond any actuator, and keep products of values far from overflow and underflow.
Length = Annotated[float, Field(ge=-1e5, le=1e5)]
Electrical = Annotated[float, Field(ge=-1e6, le=1e6)]
Interval = Annotated[list[Length], Field(min_length=2, max_length=2)]
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)]


OLDER: dict[str, JsonValue] = {"schema": 1}
"""Marks the forms of schema 1, which are read and no longer described."""


class Entry(BaseModel):
    """A table of the file: unknown keys, coerced types, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class FileEntry(Entry):
    """The top level; each table is read by its own entry so that one mistake hides no other."""

    schema_version: int = Field(alias="schema", ge=1, description="Write schema = 2.")
    name: Name = Field(description="Give a short name of letters, digits, - and _; directories are named after it.")
    description: str = Field("", description="Give free text in quotes.")
    materials: dict[str, Any] = Field({}, description="Give each material as a table [materials.NAME].")
    fixed: dict[str, Any] = Field({}, description="Give fixed parts as [fixed.regions.NAME].")
    electromagnet: dict[str, Any] = Field(
        {}, description="Give fixed parts as [fixed.regions.NAME].", json_schema_extra=OLDER
    )
    coils: dict[str, Any] = Field({}, description="Give each winding as a table [coils.NAME].")
    coil: dict[str, Any] | None = Field(
        None, description="Give the winding as a table [coils.NAME].", json_schema_extra=OLDER
    )
    circuits: dict[str, Any] = Field({}, description="Give each circuit as [circuits.NAME]; without, one a coil.")
    moving: dict[str, Any] = Field({}, description="Give each magnetic part of the body as [moving.regions.NAME].")
    mechanics: dict[str, Any] | None = Field(None, description="Give mass, springs, friction and stops as [mechanics].")
    sensors: dict[str, Any] = Field({}, description="Give each sensor as a table [sensors.NAME] with its kind.")
    hall: dict[str, Any] | None = Field(
        None, description="Give the Hall element as a table [sensors.NAME].", json_schema_extra=OLDER
    )
    supply: dict[str, Any] | None = Field(None, description="Give the driver as a table [supply].")
    sweep: dict[str, Any] = Field(description="Give the grid as a table [sweep] with current_A and distance_mm.")
    solver: dict[str, Any] | None = Field(None, description="Give [solver] tolerance, or leave it out.")
    thermal: dict[str, Any] | None = Field(None, description="Give what temperatures depend on as a table [thermal].")
    reference: dict[str, Any] | None = Field(None, description="Give [reference] distance_mm, or leave it out.")
    tolerances: dict[str, Any] = Field(
        {}, description="Give standard deviations of numbers of this file by their key paths as [tolerances]."
    )


Corner = Annotated[list[Length], Field(min_length=2, max_length=3)]


class OutlineEntry(Entry):
    """An outline: a box (r_mm and z_mm), a polygon with arcs (polygon_mm) or a circle (circle_mm)."""

    r_mm: Interval | None = Field(None, description="Give [inner, outer] radius in mm.")
    z_mm: Interval | None = Field(None, description="Give [lower, upper] height in mm.")
    polygon_mm: Annotated[list[Corner], Field(min_length=2, max_length=1000)] | None = Field(
        None,
        description="Give at least three corners [[r, z], ...] in mm; a third number is the angle in degrees of an arc "
        "to the next corner, positive counter-clockwise.",
    )
    circle_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = Field(
        None, description="Give [r, z, radius]: a ball where r is 0, a ring with a round section elsewhere."
    )


def _direction(*names: str) -> PlainValidator:
    """A direction by one of these names or as [r, z]."""

    def checked(value: object) -> str | list[float] | None:
        if value is None or (isinstance(value, str) and value in names):
            return value
        if isinstance(value, list) and len(value) == 2 and all(_is_number(number) for number in value):
            return [float(number) for number in value]
        choices = " or ".join(repr(name) for name in names)
        raise PydanticCustomError("direction", "Input should be {known} or a direction [r, z]", {"known": choices})

    return PlainValidator(checked, json_schema_input_type=Literal[*names] | list[float])


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MAX_DIRECTION


MAX_DIRECTION = 1e5  # far beyond any direction that is written, and not infinite


class RegionEntry(OutlineEntry):
    """``[fixed.regions.NAME]`` or ``[moving.regions.NAME]``."""

    material: str = Field(description="Name a material of [materials] or of the library.")
    magnetization: Annotated[Any, _direction("+z", "-z", "+r", "-r")] = Field(
        None,
        description='Give "+z", "-z", "+r" (radially outwards), "-r" or a direction [r, z] for a magnet; leave it out '
        "otherwise.",
    )
    temperature_C: float | None = Field(
        None, ge=-273, le=500, description="Give a magnet's temperature in degC; values are those of 20 degC otherwise."
    )


class ElectromagnetEntry(Entry):
    """``[fixed]``, or ``[electromagnet]`` of schema 1."""

    regions: dict[str, Any] = Field({}, description="Give each fixed part as a table [fixed.regions.NAME].")


class CoilEntry(OutlineEntry):
    """``[coils.NAME]``, or ``[coil]`` of schema 1."""

    turns: float = Field(ge=1, le=1e7, description="Give the number of turns of the whole winding.")
    wire_diameter_mm: float | None = Field(None, ge=1e-3, le=1e3, description="Give the bare copper diameter in mm.")
    resistance_ohm: float | None = Field(
        None, ge=1e-9, le=1e9, description="Give the resistance in ohm, or leave it out to have it from the wire."
    )
    temperature_C: float = Field(
        20.0, ge=-200, le=500, description="Give the winding's temperature for the resistance from the wire."
    )


class MovingEntry(Entry):
    """``[moving]``."""

    mass_g: float | None = Field(
        None,
        ge=1e-6,
        le=1e9,
        description="Give the mass of the whole moving body as mechanics.mass_g.",
        json_schema_extra=OLDER,
    )
    regions: dict[str, Any] = Field({}, description="Give each magnetic part of the body as [moving.regions.NAME].")


class HallPlace(Entry):
    """Where the Hall element sits."""

    r_mm: float = Field(ge=0, le=1e5, description="Give the radius of the element in mm, 0 on the axis.")
    z_mm: Length = Field(description="Give the height of the element in mm, 0 at the fixed part's reference face.")


class HallEntry(HallPlace):
    """``[sensors.NAME]`` of kind hall, or ``[hall]`` of schema 1; defaults as in :mod:`femfit.device.electrics`."""

    kind: Literal["hall"] = Field("hall", description='Give "hall" in a table of [sensors].')
    direction: Annotated[Any, _direction("z", "r")] = Field(
        "z", description='Give the component that it measures, "z", "r" or [r, z].'
    )
    delay_ms: float = Field(0.0, ge=0, le=1e6, description="Give how late a reading is in ms.")
    sample_time_ms: float | None = Field(
        None,
        ge=1e-6,
        le=1e6,
        description="Give the time from one reading to the next, or leave it to the controller's.",
    )

    sensitivity_V_per_T: Electrical = Field(50.0, description="Give the slope in V/T (5 mV/G is 50 V/T).")
    quiescent_V: Electrical = Field(2.5, description="Give the output without field in volts.")
    output_min_V: Electrical = Field(0.0, description="Give the lowest output in volts.")
    output_max_V: Electrical = Field(5.0, description="Give the highest output in volts.")
    adc_bits: int = Field(12, ge=0, le=32, description="Give the converter's bits, 0 for none.")
    noise_V: float = Field(0.0, ge=0, le=1e6, description="Give the standard deviation of one sample in volts.")


class SupplyEntry(Entry):
    """``[supply]``."""

    voltage_min_V: Electrical = Field(description="Give the lowest voltage of the driver; negative for a bridge.")
    voltage_max_V: Electrical = Field(description="Give the highest voltage of the driver.")
    sample_time_ms: float | None = Field(
        None, ge=1e-6, le=1e6, description="Give the controller's period in ms, or leave it out to have it from L/R."
    )
    diode_V: float | None = Field(
        None, ge=0, le=100, description="Give the forward voltage of the freewheel diode of a one-sided driver."
    )


AxisValue = Annotated[float, Field(ge=-1e5, le=1e5)]


class RangeEntry(Entry):
    """``{ start = ..., stop = ..., step = ... }``, both ends included."""

    start: AxisValue = Field(description="Give the first value.")
    stop: AxisValue = Field(description="Give the last value; it belongs to the grid.")
    step: float = Field(gt=0, description="Give a positive step that divides stop - start.")


AXIS_KINDS = ("<range>", "<list>")


def axis_kind(value: object) -> str | None:
    """Which of :data:`AXIS_KINDS` a value is written as."""
    if isinstance(value, Entry | dict):
        return AXIS_KINDS[0]
    return AXIS_KINDS[1] if isinstance(value, list) else None


Axis = Annotated[
    Annotated[RangeEntry, Tag(AXIS_KINDS[0])]
    | Annotated[list[AxisValue], Field(min_length=1, max_length=MAX_AXIS_POINTS), Tag(AXIS_KINDS[1])],
    Discriminator(
        axis_kind,
        custom_error_type="axis",
        custom_error_message="Input should be a list of numbers or a table { start, stop, step }",
    ),
]


class CurrentAxis(Entry):
    """The currents of the sweep."""

    current_A: Axis = Field(description="Give ascending currents as a list or as { start, stop, step }.")


class DistanceAxis(Entry):
    """The distances of the sweep."""

    distance_mm: Axis = Field(description="Give ascending distances as a list or as { start, stop, step }.")


class DesignEntry(Entry):
    """How a sweep's parameters are combined."""

    parameters: dict[str, Any] = Field(
        {}, description="Give what else is swept as a table [sweep.parameters], or leave it out."
    )
    design: Literal["grid", "list", "latin_hypercube"] = Field(
        "grid", description="Give how parameters are combined: every combination, line by line, or drawn at random."
    )
    samples: int | None = Field(
        None, ge=2, le=MAX_AXIS_POINTS, description="Give the number of samples of a latin_hypercube."
    )
    seed: int = Field(1, ge=0, le=2**63 - 1, description="Give the seed of a latin_hypercube.")


class SweepEntry(CurrentAxis, DistanceAxis, DesignEntry):
    """``[sweep]``."""


ParameterValue = Annotated[float, Field(ge=-1e9, le=1e9)]


class KeyEntry(Entry):
    """``{ key = ..., factor = ..., offset = ... }``: a number of the file that follows a parameter, or a material."""

    key: str = Field(description="Give a key path of this file in quotes.")
    factor: ParameterValue = Field(1.0, description="Give what the parameter is multiplied by, -1 to mirror it.")
    offset: ParameterValue = Field(0.0, description="Give what is added then, in the file's unit.")


class NamedParameterEntry(Entry):
    """``[sweep.parameters.NAME]``: a name of one's own for one or more keys of the file."""

    keys: Annotated[list[Any], Field(min_length=1, max_length=100)] = Field(
        description="Give the key paths that follow the parameter as a list."
    )
    values: Any = Field(description="Give a list, { start, stop, step }, or { min, max } for a latin_hypercube.")


class ValuesEntry(Entry):
    """A list of values."""

    values: Annotated[list[ParameterValue], Field(min_length=1, max_length=MAX_AXIS_POINTS)] = Field(
        description="Give at least one number."
    )


class NamesEntry(Entry):
    """A list of names."""

    values: Annotated[list[str], Field(min_length=1, max_length=MAX_AXIS_POINTS)] = Field(
        description="Give at least one name of a material in quotes."
    )


class SampledEntry(Entry):
    """``{ min = ..., max = ..., step = ... }``: a range that a latin_hypercube draws from."""

    min: ParameterValue = Field(description="Give the lowest value.")
    max: ParameterValue = Field(description="Give the highest value, above min.")
    step: float | None = Field(None, gt=0, description="Give a step for values like whole turns, or leave it out.")


class ToleranceEntry(Entry):
    """``[tolerances]``: how far numbers of the file may be off, beside those that are named by their key paths."""

    length_mm: float | None = Field(
        None, gt=0, le=1e3, description="Give the standard deviation of all lengths in mm, or leave it to ISO 2768 m."
    )


class ReferenceEntry(Entry):
    """``[reference]``: the closed loop's steps."""

    distance_mm: Annotated[list[Length], Field(min_length=1, max_length=1000)] = Field(
        description="Give the reference distances in mm, in their order, within the sweep."
    )
