"""Tables of the actuator file beside the drawing: wiring, motion, sensors, materials, ``[solver]`` and ``[thermal]``.

They are read as those of :mod:`femfit.device.schema`; defaults of ``[thermal]`` are those of
:mod:`femfit.device.thermal`.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args

from pydantic import ConfigDict, Field, WithJsonSchema

from femfit.device.schema import (
    CoilEntry,
    Drop,
    Electrical,
    ElectromagnetEntry,
    Entry,
    HallEntry,
    Interval,
    Length,
    Lengths,
    MovingEntry,
    Noise,
    OutlineEntry,
    Period,
    ReferenceEntry,
    RegionEntry,
    SupplyEntry,
    Time,
    Turns,
    key,
    list_of,
)
from femfit.device.thermal import STILL_AIR as USUAL

Force = Annotated[float, Field(ge=-1e6, le=1e6)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Points = Annotated[list[float], Field(min_length=2, max_length=1000)]


def ascends(values: Sequence[float] | None) -> bool:
    """Whether each value is above the one before it; so are none."""
    return all(before < after for before, after in pairwise(values or ()))


class WindingEntry(CoilEntry):
    """``[coils.NAME]``."""

    moves: bool = key("true for a coil that belongs to the moving part", False)


class CircuitEntry(Entry):
    """``[circuits.NAME]``."""

    coils: Annotated[list[str], Field(min_length=1, max_length=100)] = key(
        'the coils in series as a list of names, "-NAME" for one that is connected the other way'
    )
    external_resistance_ohm: float = key("the resistance in series in ohm", 0.0, ge=0, le=1e9)
    external_inductance_mH: float = key("the inductance in series in mH", 0.0, ge=0, le=1e9)
    drive: Literal["voltage", "current"] = key(
        '"voltage" for a bridge or a switch, "current" for a current amplifier', "voltage"
    )
    voltage_min_V: Electrical | None = key("the lowest voltage, or have it from [supply]", None)
    voltage_max_V: Electrical | None = key("the highest voltage, or have it from [supply]", None)
    diode_V: Drop | None = key("the forward voltage of the freewheel diode of a one-sided driver", None)
    current_min_A: Electrical | None = key("the lowest current of a current amplifier", None)
    current_max_A: Electrical | None = key("the highest current of a current amplifier", None)
    bandwidth_Hz: float | None = key("the bandwidth of a current amplifier", None, gt=0, le=1e9)


class SpringEntry(Entry):
    """``[mechanics.springs.NAME]``: a stiffness with a preload, or a measured table of forces."""

    stiffness_N_per_mm: Force | None = key("the stiffness in N/mm", None)
    preload_N: Force = key("the force at preload_at_mm; positive pushes the parts apart", 0.0)
    preload_at_mm: Length | None = key("the distance at which the spring has its preload", None)
    distance_mm: Lengths | None = key("ascending distances of a measured force, instead of stiffness_N_per_mm", None)
    force_N: Points | None = key("the forces at distance_mm; positive pushes the parts apart", None)

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        distances, forces = self.distance_mm, self.force_N
        if (distances is None) != (forces is None) or (distances is None) == (self.stiffness_N_per_mm is None):
            yield " must have either stiffness_N_per_mm or a table of distance_mm and force_N. Give one of the two."
        elif distances is None and self.preload_N and self.preload_at_mm is None:
            yield ".preload_at_mm is missing. Give the distance at which the spring has its preload_N."
        elif len(distances or ()) != len(forces or ()):
            yield f".force_N must have as many values as distance_mm; they are {forces} and {distances}. Complete it."
        elif not ascends(distances):
            yield ".distance_mm must ascend without repeats. Sort it, with its forces."


class StopEntry(Entry):
    """``[mechanics.near_stop]`` and ``[mechanics.far_stop]``."""

    distance_mm: Length = key("the distance at which the body meets the stop")
    restitution: float = key("the velocity after an impact over that before, 0 for no bounce", 0.0, ge=0, lt=1)
    stiffness_N_per_mm: float | None = key("the stop's stiffness, or leave it out for a rigid one", None, gt=0, le=1e9)


class MechanicsEntry(Entry):
    """``[mechanics]``."""

    mass_g: float = key("the mass of the whole moving body in grams", ge=1e-6, le=1e9)
    gravity: Literal["hanging", "standing", "horizontal", "off"] | None = key(
        '"hanging" where weight pulls the parts apart, "standing" where it pulls them together, "horizontal" or "off"',
        None,
    )
    gravity_deg: float | None = key("the angle from downwards to growing distance instead", None, ge=-360, le=360)
    viscous_N_s_per_m: float = key("the viscous friction in N s/m", 0.0, ge=0, le=1e9)
    coulomb_N: float = key("the dry friction in N", 0.0, ge=0, le=1e6)
    load_N: Force = key("a constant force; positive pulls the parts apart", 0.0)
    travel_mm: Interval | None = key("[least, largest] distance between rigid stops, or near_stop and far_stop", None)
    springs: dict[str, Any] = key("each spring as a table [mechanics.springs.NAME]", {})
    near_stop: dict[str, Any] | None = key("the stop at the least distance as a table", None)
    far_stop: dict[str, Any] | None = key("the stop at the largest distance as a table", None)

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        if None not in (self.gravity, self.gravity_deg):
            yield " must have either gravity or gravity_deg; it has both. Remove one."
        if self.travel_mm and (self.near_stop or self.far_stop):
            yield ".travel_mm must be left out beside near_stop and far_stop. Remove one of them."


class SensorTiming(Entry):
    """What every sensor of schema 2 may have."""

    bits: int = key("the converter's bits over the range, 0 for none", 0, ge=0, le=32)
    delay_ms: Time = key("how late a reading is in ms", 0.0)
    sample_time_ms: Period | None = key("the time from one reading to the next, or leave it to the controller's", None)

    @property
    def range_key(self) -> str:
        """The key of its range, which ends in the unit of its reading."""
        return next(name for name in type(self).model_fields if name.startswith("range_"))

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        key, limits = self.range_key, getattr(self, self.range_key)
        if not ascends(limits):
            yield f".{key} must ascend; it is {limits}. Exchange or change the values."
        if self.bits and limits is None:
            yield f".{key} is missing; {self.bits} bits are divided over it. Give [lowest, highest]."


class CurrentSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "current"``."""

    kind: Literal["current"] = key('"current" for a sensor of a circuit\'s current')
    circuit: str | None = key("the name of the circuit; it may be left out where there is one alone", None)
    noise_A: Noise = key("the standard deviation of one sample in A", 0.0)
    range_A: Pair | None = key("[lowest, highest] reading in A", None)


class PositionSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "position"``."""

    kind: Literal["position"] = key('"position" for a laser, an optical gate, an LVDT')
    gain_V_per_mm: Electrical | None = key("the slope of a linear sensor in V/mm", None)
    offset_V: Electrical = key("the output of a linear sensor at distance zero", 0.0)
    distance_mm: Lengths | None = key("ascending distances of the characteristic, instead of gain_V_per_mm", None)
    output_V: Points | None = key("the outputs at distance_mm, rising or falling throughout", None)
    noise_V: Noise = key("the standard deviation of one sample in V", 0.0)
    range_V: Pair | None = key("[lowest, highest] output in V", None)
    noise_mm: Noise = key("the noise of a sensor that reads the distance itself", 0.0)
    range_mm: Pair | None = key("the range of a sensor that reads the distance itself", None)

    @property
    def reads_distance(self) -> bool:
        """Whether the reading is the distance itself, in mm."""
        return self.gain_V_per_mm is None and self.distance_mm is None and self.output_V is None

    @property
    def range_key(self) -> str:
        """The key of its range."""
        return "range_mm" if self.reads_distance else "range_V"

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        yield from super().faults()
        points, outputs, reads_distance = self.distance_mm, self.output_V, self.reads_distance
        wrong = {"noise_V", "range_V", "offset_V"} if reads_distance else {"noise_mm", "range_mm"}
        if wrong := wrong & self.model_fields_set:
            remedy = (
                "gain_V_per_mm, or a characteristic, for an output in V" if reads_distance else "noise_V and range_V"
            )
            yield f" must not have {' and '.join(sorted(wrong))} with these keys. Give {remedy}."
        if self.gain_V_per_mm is not None and (points is not None or outputs is not None):
            yield " must have either gain_V_per_mm or distance_mm and output_V. Remove one."
        elif self.gain_V_per_mm == 0.0:
            yield ".gain_V_per_mm must not be 0; nothing would be seen. Give the sensor's slope."
        elif len(points or ()) != len(outputs or ()):
            yield " must have distance_mm and output_V of one length. Give both lists."
        elif not ascends(points) or not (ascends(outputs) or ascends((outputs or [])[::-1])):
            yield (
                ".distance_mm must ascend and output_V rise or fall throughout, so that an output means one distance. "
                "Leave the part out where it turns."
            )


class PickupCoilEntry(OutlineEntry, SensorTiming):
    """``[sensors.NAME]`` with ``kind = "pickup_coil"``."""

    kind: Literal["pickup_coil"] = key('"pickup_coil" for a winding without current')
    turns: Turns = key("the number of turns")
    moves: bool = key("true for a coil that belongs to the moving part", False)
    noise_V: Noise = key("the standard deviation of one sample in V", 0.0)
    range_V: Pair | None = key("[lowest, highest] output in V", None)


class AccelerationSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "acceleration"``."""

    kind: Literal["acceleration"] = key('"acceleration" for an accelerometer on the body')
    reads_gravity: bool = key("true for one that reads gravity too at rest, as MEMS accelerometers do", False)
    noise_m_per_s2: float = key("the standard deviation of one sample in m/s^2", 0.0, ge=0, le=1e9)
    range_m_per_s2: Pair | None = key("[lowest, highest] reading in m/s^2", None)


class ForceSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "force"``."""

    kind: Literal["force"] = key('"force" for a load cell that holds the body')
    noise_N: Noise = key("the standard deviation of one sample in N", 0.0)
    range_N: Pair | None = key("[lowest, highest] reading in N", None)


class ConductorEntry(Entry):
    """How a material of either kind conducts."""

    conductivity_MS_per_m: float = key(
        "the electrical conductivity in MS/m (10^6 S/m): copper 58, mild steel 5 to 9, 0 for what does not conduct",
        0.0,
        ge=0,
        le=1e4,
    )
    lamination_mm: float = key(
        "the thickness in mm of insulated sheets that stand radially around the axis, so that no current flows around "
        "it; 0 for a solid part and for discs",
        0.0,
        ge=0,
        le=100,
    )
    thermal_conductivity_W_per_m_K: float | None = key(
        "the thermal conductivity, or leave it to what is usual for its kind", None, gt=0, le=5e3
    )
    heat_capacity_MJ_per_m3_K: float | None = key(
        "density times specific heat (steel 3.4, aluminium 2.4), or leave it to what is usual", None, gt=0, le=100
    )

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        if self.lamination_mm and not self.conductivity_MS_per_m:
            yield (
                ".lamination_mm must stand beside a conductivity_MS_per_m > 0; sheets that do not conduct are a solid "
                "part. Give the conductivity of the sheets (electrical steel 2 to 5), or leave lamination_mm out."
            )


class MaterialEntry(ConductorEntry):
    """``[materials.NAME]``: a linear material."""

    relative_permeability: float = key(
        "mu_r, 1 for everything non-magnetic; the recoil permeability of a magnet", ge=1e-6, le=1e7
    )
    remanence_T: float = key("B_r in tesla (1 T = 10 kG); the direction is the region's magnetization", 0.0, ge=0, le=3)
    remanence_coefficient_per_K: float = key(
        "the relative change of B_r per kelvin: -0.0012 for -0.12 %/K", 0.0, ge=-0.02, le=0.02
    )
    working_temperature_C: float | None = key(
        "a magnet's largest working temperature in degC, where it is known", None, ge=-273, le=1000
    )


CurveValues = Annotated[list[float], Field(max_length=1000)]


class CurveEntry(ConductorEntry):
    """``[materials.NAME]``: a soft material with a magnetisation curve, from a file or from two lists."""

    bh_curve: str | None = key("a steel of the library, or a CSV file with columns B_T,H_A_per_m", None, min_length=1)
    B_T: CurveValues | None = key("ascending flux densities in tesla as a list, from 0", None)
    H_A_per_m: CurveValues | None = key("ascending fields in A/m as a list, from 0", None)

    def faults(self) -> Iterator[str]:
        """As of :meth:`Entry.faults`."""
        yield from super().faults()
        lists = {"B_T": self.B_T, "H_A_per_m": self.H_A_per_m}
        if self.bh_curve is None:
            for key in (key for key, values in lists.items() if values is None):
                yield f".{key} is missing; the curve needs B_T and H_A_per_m. Give both lists, or bh_curve."
        elif any(values is not None for values in lists.values()):
            yield " must have one curve; it has bh_curve and a list. Give bh_curve, or B_T and H_A_per_m."


CURVE_KEYS = CurveEntry.model_fields.keys() - ConductorEntry.model_fields.keys()


def has_curve(table: object) -> bool:
    """Whether a table of a material gives a magnetisation curve."""
    return isinstance(table, dict) and bool(table.keys() & CURVE_KEYS)


MAX_FREQUENCIES = 1000

Frequency = Annotated[float, Field(gt=0, le=1e9)]


class FrequencyRangeEntry(Entry):
    """``{ start = ..., stop = ..., per_decade = ... }``, both ends included."""

    start: Frequency = key("the lowest frequency in Hz")
    stop: Frequency = key("the highest frequency in Hz; it belongs to the list")
    per_decade: int = key("how many frequencies there are in each decade", ge=1, le=100)


FREQUENCIES = list_of(Frequency, MAX_FREQUENCIES)
FrequencyAxis = Annotated[Any, WithJsonSchema(FREQUENCIES.json_schema())]
"""A list of :data:`FREQUENCIES` or a table of :class:`FrequencyRangeEntry`."""


class SolverEntry(Entry):
    """``[solver]``: how accurate the field solver has to be, and at which frequencies."""

    tolerance: float | None = key(
        "the relative accuracy of force and flux linkage, as 1e-3 for 0.1 %", None, ge=1e-5, le=0.1
    )
    frequency_Hz: FrequencyAxis | None = key(
        "the frequencies of the impedance as an ascending list or as { start, stop, per_decade }", None
    )
    eddy_error: float = key(
        "the relative error of impedance, force and Hall field that the reduced model of the eddy currents has to meet",
        0.01,
        ge=1e-4,
        le=0.2,
    )
    eddy_bias_A: float | list[float] | None = key(
        "the current in A about which the eddy currents of saturating parts are linearised, or a list with one for "
        "each circuit",
        None,
    )


class ThermalEntry(Entry):
    """``[thermal]``: what temperatures depend on beside the drawing."""

    ambient_C: float = key("the temperature around the actuator", USUAL.ambient_C, ge=-200, le=500)
    film_W_per_m2_K: float = key(
        "what a free face gives off for each kelvin: 5 to 15 in still air with radiation, 20 to 100 with a fan",
        USUAL.film_W_per_m2_K,
        gt=0,
        le=1e5,
    )
    joint_mm: float = key("the air that is left where two parts touch; a press fit 0.005", 0.01, ge=1e-4, le=10)
    winding_joint_mm: float = key("the same between a winding and what it is drawn to touch", 0.1, ge=1e-4, le=10)
    insulation_W_per_m_K: float = key(
        "the thermal conductivity between a winding's strands: 0.1 dry, 0.25 in resin",
        USUAL.insulation_W_per_m_K,
        gt=0,
        le=100,
    )
    mounting_W_per_K: float = key(
        "what the heaviest fixed part conducts into what it is fastened to, for each kelvin",
        USUAL.mounting_W_per_K,
        ge=0,
        le=1e6,
    )
    winding_limit_C: float = key(
        "the largest temperature of a winding: 105, 120, 130, 155, 180 for the classes A, E, B, F, H",
        USUAL.winding_limit_C,
        ge=-200,
        le=1000,
    )


class SensorEntry(Entry):
    """A sensor whose kind decides which keys it has."""

    model_config = ConfigDict(extra="ignore")
    kind: Literal["hall", "current", "position", "pickup_coil", "acceleration", "force"] = key("one of them")


_OF_SENSORS: tuple[type[Entry], ...] = (HallEntry, *SensorTiming.__subclasses__())

SENSORS = {get_args(entry.model_fields["kind"].annotation)[0]: entry for entry in _OF_SENSORS}
"""Classes of sensors by their kind."""


def sensor_entry(table: object) -> type[Entry]:
    """The keys of a sensor's table, by its kind."""
    kind = table.get("kind") if isinstance(table, dict) else None
    return SENSORS.get(str(kind), SensorEntry)


def material_entry(table: object) -> type[Entry]:
    """The keys of a material's table, by what it gives."""
    return CurveEntry if has_curve(table) else MaterialEntry


BODIES = ("electromagnet", "fixed", "moving")
NAMED = "*"
"""Stands for any name in :data:`TABLES`."""

TABLES: dict[tuple[str, ...], type[Entry] | Callable[[object], type[Entry]]] = {
    ("materials", NAMED): material_entry,
    ("electromagnet",): ElectromagnetEntry,
    ("fixed",): ElectromagnetEntry,
    ("moving",): MovingEntry,
    **{(body, "regions", NAMED): RegionEntry for body in BODIES},
    ("coil",): CoilEntry,
    ("hall",): HallEntry,
    ("supply",): SupplyEntry,
    ("mechanics",): MechanicsEntry,
    ("coils", NAMED): WindingEntry,
    ("circuits", NAMED): CircuitEntry,
    ("sensors", NAMED): sensor_entry,
    ("mechanics", "springs", NAMED): SpringEntry,
    ("mechanics", "near_stop"): StopEntry,
    ("mechanics", "far_stop"): StopEntry,
    ("solver",): SolverEntry,
    ("thermal",): ThermalEntry,
    ("reference",): ReferenceEntry,
}
"""What each table of the file is read as, by its place; one of a name by what it holds."""
