"""Tables of the actuator file that parts of the device follow from, in the file's units.

Those that are parts of the device as they stand are read straight into their records in SI units, in
:mod:`femfit.device.parts`, :mod:`femfit.device.mechanics`, :mod:`femfit.device.electrics` and
:mod:`femfit.device.thermal`. What a key may say of itself is in :mod:`femfit.device.keys`.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Literal, get_args

from femfit.device.electrics import DIODE, TURNS, AnySensor, Drive
from femfit.device.keys import ELECTRICAL, LENGTH, Given, OutlineEntry, Record, decimal_sum, key, kind_of
from femfit.device.mechanics import Mechanics
from femfit.device.parts import LinearMaterial, NonlinearMaterial
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
    def derived(cls, given: Given, complain: Callable[..., None]) -> dict[str, Any]:
        """The values, in decimals."""
        count = round(min((given.stop - given.start) / given.step, MAX_AXIS_POINTS))
        values = tuple(decimal_sum(given.start, k, given.step) for k in range(count + 1))
        if given.stop <= given.start:
            complain("no_range")
        elif count >= MAX_AXIS_POINTS:
            complain("many_steps", most=MAX_AXIS_POINTS)
        elif values[-1] != given.stop:
            complain("no_divisor", end=values[-1])
        return {"values": values}


class FrequencyRangeEntry(Record):
    """``{ start = ..., stop = ..., per_decade = ... }``, both ends included."""

    start: float = key("the lowest frequency in Hz", **FREQUENCY)
    stop: float = key("the highest frequency in Hz; it belongs to the list", **FREQUENCY)
    per_decade: int = key("how many frequencies there are in each decade", ge=1, le=100)
    values: tuple[float, ...]

    @classmethod
    def derived(cls, given: Given, complain: Callable[..., None]) -> dict[str, Any]:
        """The values, equally spaced in their logarithm."""
        ratio = given.stop / given.start
        # A range of no whole number of steps gets a step more, not wider ones
        steps = math.ceil(round(given.per_decade * math.log10(ratio), _DIGITS))
        if ratio <= 1.0:
            complain("no_range")
        elif steps >= MAX_FREQUENCIES:
            complain("many_frequencies", most=MAX_FREQUENCIES, count=steps + 1)
        between = (given.start * ratio ** (k / steps) for k in range(1, steps))
        return {"values": (given.start, *(float(f"{value:.{_DIGITS}g}") for value in between), given.stop)}


SCHEMA_VERSION = 2
NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]*$"
MAX_NAME = 64
PARAMETER: dict[str, Any] = {"ge": -1e9, "le": 1e9}
AXIS: dict[str, Any] = {"count": ((1, MAX_AXIS_POINTS),), "ascending": True, "stepped": RangeEntry, **LENGTH}
BODIES = ("fixed", "moving")


class RegionEntry(Record):
    """``[fixed.regions.NAME]`` or ``[moving.regions.NAME]``."""

    beside = (OutlineEntry,)

    material: str = key("the name of a material of [materials] or of the library")
    magnetization: tuple[float, float] | str | None = key(
        '"+z", "-z", "+r" (radially outwards), "-r" or a direction [r, z] for a magnet; leave it out otherwise',
        None,
        words=("+z", "-z", "+r", "-r"),
    )
    temperature_C: float | None = key("a magnet's temperature in degC, or leave it at 20 degC", None, ge=-273, le=500)


class FixedEntry(Record):
    """``[fixed]``."""

    regions: tuple[RegionEntry, ...] = key("each fixed part as a table [fixed.regions.NAME]", ())


class MovingEntry(Record):
    """``[moving]``."""

    regions: tuple[RegionEntry, ...] = key("each magnetic part of the body as [moving.regions.NAME]", ())


class CoilEntry(Record):
    """``[coils.NAME]``."""

    beside = (OutlineEntry,)

    turns: float = key("the number of turns of the whole winding", **TURNS)
    wire_diameter_mm: float | None = key("the bare copper diameter in mm", None, ge=1e-3, le=1e3)
    resistance_ohm: float | None = key(
        "the resistance in ohm, or leave it to the wire", None, ge=1e-9, le=1e9, kind="resistance"
    )
    temperature_C: float = key("the winding's temperature for the resistance from the wire", 20.0, ge=-200, le=500)
    moves: bool = key("true for a coil that belongs to the moving part", False)


class CircuitEntry(Drive):
    """``[circuits.NAME]``."""

    coils: tuple[str, ...] = key(
        'the coils in series as a list of names, "-NAME" for one that is connected the other way', count=((1, 100),)
    )
    external_resistance_ohm: float = key("the resistance in series in ohm", 0.0, ge=0, le=1e9)
    external_inductance_H: float = key("the inductance in series in mH", 0.0, ge=0, le=1e9)
    voltage_min_V: float | None = key("the lowest voltage, or have it from [supply]", None, **ELECTRICAL)
    voltage_max_V: float | None = key("the highest voltage, or have it from [supply]", None, **ELECTRICAL)


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
    def derived(cls, given: Given, complain: Callable[..., None]) -> dict[str, Any]:
        """Nothing; the range is not empty, and a step divides it."""
        if given.min >= given.max:
            complain("min_max")
        elif given.step is not None:
            steps = min(round((given.max - given.min) / given.step), 10**9)
            if decimal_sum(given.min, steps, given.step) != given.max:
                complain("sampled_step")
        return {}


class NamedParameterEntry(Record):
    """``[sweep.parameters.NAME]``: a name of one's own for one or more keys of the file."""

    keys: tuple[Any, ...] = key("the key paths that follow the parameter", count=((1, 100),))
    values: Any = key("a list, { start, stop, step }, or { min, max } for a latin_hypercube")


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
    moving: MovingEntry | None = key("each magnetic part of the body as [moving.regions.NAME]", None)
    coils: tuple[CoilEntry, ...] = key("each winding as a table [coils.NAME]", ())
    circuits: tuple[CircuitEntry, ...] = key("each circuit as [circuits.NAME]; without, one a coil", ())
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


class DrawnTables(dict[str, Any]):
    """The tables of a file by today's names."""

    is_schema_1: bool
    older: dict[str, str]  # Key paths that the file has, by today's where these are others
    problems: list[str]  # What is wrong with its names
