"""Circuits with their drivers, and sensors, as drawn and in SI units.

A winding is fed by a bridge, a one-sided driver with a freewheel diode, or a current amplifier. Every reading of a
sensor is characteristic + noise, kept within a range, rounded to the converter's steps, and late by a delay;
where the output of a Hall element leaves its range, it says nothing of the distance.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import field as limited
from math import inf
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount_range
from femfit.device.keys import ELECTRICAL, LENGTH, POINTS, Entry, Outline, Record, converted, in_same_table, key, scaled

DIODE: dict[str, Any] = {"says": "the forward voltage of the freewheel diode of a one-sided driver", "default": None}
DIODE |= {"ge": 0, "le": 100}
NOISE: dict[str, Any] = {"ge": 0.0, "le": 1e6}
TURNS: dict[str, Any] = {"ge": 1.0, "le": 1e7, "kind": "turns"}
DELAY: dict[str, Any] = {"says": "how late a reading is in ms", "default": 0.0, "ge": 0.0, "le": 1e6}
SAMPLE_TIME: dict[str, Any] = {"says": "the time from one reading to the next, or leave it to the controller's"}
SAMPLE_TIME |= {"default": None, "ge": 1e-6, "le": 1e6}


class Drive(Record, kw_only=False):
    """How a command becomes voltage or current; the limits of the voltage are those of the circuit.

    A voltage source gives what is commanded, within its limits. With a freewheel diode it is one-sided: it gives
    positive voltages alone, and without one the current goes on through the diode until it is zero.
    """

    kind: Literal["voltage", "current"] = key(
        '"voltage" for a bridge or a switch, "current" for a current amplifier', "voltage", file="drive"
    )
    # With that of a Zener diode in series; None for a bridge
    diode_V: float | None = key(**DIODE)
    # Without limits it follows every command, without a bandwidth as fast as its voltage allows
    current_min_A: float | None = key("the lowest current of a current amplifier", None, **ELECTRICAL)
    current_max_A: float | None = key("the highest current of a current amplifier", None, **ELECTRICAL)
    bandwidth_Hz: float | None = key("the bandwidth of a current amplifier", None, gt=0, le=1e9)


BRIDGE = Drive()
"""Voltages of both signs, as far as the limits go."""


class Circuit(Record, kw_only=False):
    """``[circuits.NAME]``: coils in series and their driver, U = R i + L_s i' + d(flux linkage)/dt."""

    needs_more = True

    # Of all coils and what is in series with them
    resistance_ohm: float = limited(metadata={"positive": True})
    # A drawing without a supply leaves them open behind a current amplifier, a model has both
    voltage_min_V: float = key("the lowest voltage, or have it from [supply]", -inf, usual=None, **ELECTRICAL)
    voltage_max_V: float = key("the highest voltage, or have it from [supply]", inf, usual=None, **ELECTRICAL)
    drive: Drive = in_same_table(BRIDGE)
    name: str = "coil"
    # L_s, outside of the field
    inductance_H: float = key("the inductance in series in mH", 0.0, file="external_inductance_mH", ge=0, le=1e9)
    coils: ClassVar[tuple[str, ...]] = key(
        'the coils in series as a list of names, "-NAME" for one that is connected the other way', count=((1, 100),)
    )
    external_resistance_ohm: ClassVar[float] = key("the resistance in series in ohm", 0.0, ge=0, le=1e9)


class HallElement(Record, kw_only=False):
    """A linear Hall element with its analogue output and converter; it stands still."""

    # Position (r, z) of the element
    radius_m: float = key(
        "the radius of the element in mm, 0 on the axis", file="r_mm", ge=0, le=1e5, kind="hall_place"
    )
    height_m: float = key(
        "the height of the element in mm, 0 at the reference face", file="z_mm", kind="hall_place", **LENGTH
    )
    sensitivity_V_per_T: float = key("the slope in V/T (5 mV/G is 50 V/T)", 50.0, **ELECTRICAL)
    quiescent_V: float = key("the output without field in volts", 2.5, **ELECTRICAL)
    # Range of the output and of the converter
    output_min_V: float = key("the lowest output in volts", 0.0, **ELECTRICAL)
    output_max_V: float = key("the highest output in volts", 5.0, **ELECTRICAL)
    adc_bits: int = key("the converter's bits over that range, 0 for none", 12, ge=0, le=32)
    noise_V: float = key("the standard deviation of one sample in volts", 0.0, **NOISE)
    name: str = "hall"
    # Unit vector (r, z) of the component that it measures
    direction: tuple[float, float] = key(
        'the component that it measures, "z", "r" or [r, z]', (0.0, 1.0), words=("z", "r"), usual="z"
    )
    delay_s: float = key(**DELAY)
    sample_time_s: float | None = key(**SAMPLE_TIME)
    kind: Literal["hall"] = key('"hall" in a table of [sensors]', "hall")

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """The direction as a unit vector; the output is one that can be."""
        if entry.output_min_V >= entry.output_max_V:
            complain("hall_range")
        elif not entry.output_min_V <= entry.quiescent_V <= entry.output_max_V:
            complain("quiescent")
        if not entry.sensitivity_V_per_T:
            complain("sensitivity")
        return {"direction": unit_vector(entry.direction)}


_AXES = {"z": (0.0, 1.0), "r": (1.0, 0.0)}


def unit_vector(values: Sequence[float] | str) -> tuple[float, float]:
    """A direction of length one, given as [r, z] or by its axis, whatever its sign."""
    if isinstance(values, str):
        return _AXES[values[-1]]
    length = math.hypot(*values)
    return values[0] / length, values[1] / length


class Sensor(Record):
    """What all other sensors share; noise, range and resolution are in the unit of the reading."""

    UNIT = "V"  # As keys of the file end
    COLUMN = ""  # Of records; a current is named after its circuit

    name: str
    noise: float = key("the standard deviation of one sample in {unit}", 0.0, file="noise_{unit}", **NOISE)
    minimum: float | None = None  # None: no limit
    maximum: float | None = None
    bits: int = key("the converter's bits over the range, 0 for none", 0, ge=0, le=32, model={"within": (0, 64)})
    delay_s: float = key(**DELAY)
    sample_time_s: float | None = key(**SAMPLE_TIME)
    ends: ClassVar[tuple[float, float] | None] = key(
        "[lowest, highest] reading in {unit}", None, file="range_{unit}", ascending=True
    )

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """The ends of the range, without which there are no bits."""
        return _ends(entry, f"range_{cls.UNIT}", complain)


def _ends(entry: Entry, key: str, complain: Callable[..., None]) -> dict[str, Any]:
    ends = getattr(entry, key)
    if entry.bits and ends is None:
        complain("bits", key=key)
    return dict(zip(("minimum", "maximum"), ends or (None, None), strict=True))


class CurrentSensor(Sensor):
    """The current of a circuit, read in A."""

    UNIT = "A"

    circuit: str = key("the name of the circuit; it may be left out where there is one alone", usual="")
    gain: float = 1.0
    offset: float = 0.0
    kind: Literal["current"] = key('"current" for a sensor of a circuit\'s current', "current", required=True)


class PositionSensor(Sensor):
    """The distance as a laser, an optical gate or an LVDT reads it: interpolated between points of a characteristic."""

    COLUMN = "position_V"  # A reading in metres is a distance

    distances_m: tuple[float, ...] = key(
        "ascending distances, instead of gain_V_per_mm",
        file="distance_mm",
        count=POINTS,
        ascending=True,
        usual=None,
        **LENGTH,
    )
    readings: tuple[float, ...] = key(
        "the outputs at distance_mm, rising or falling throughout",
        file="output_V",
        count=POINTS,
        monotone=True,
        like="distance_mm",
        usual=None,
    )
    unit: str = limited(default="V", metadata={"always": True})  # V, or m where the reading is the distance itself
    kind: Literal["position"] = key('"position" for a laser, an optical gate, an LVDT', "position", required=True)
    gain_V_per_mm: ClassVar[float | None] = key("the slope of a linear sensor in V/mm", None, **ELECTRICAL)
    offset_V: ClassVar[float] = key("the output of a linear sensor at distance zero", 0.0, **ELECTRICAL)
    noise_mm: ClassVar[float] = key("the noise of a sensor that reads the distance itself", 0.0, **NOISE)
    range_mm: ClassVar[tuple[float, float] | None] = key(
        "the range of a sensor that reads the distance itself", None, ascending=True
    )

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """Points of the characteristic, of which there is one kind; noise and range of one that reads the distance."""
        characteristic = entry.stated & {"gain_V_per_mm", "distance_mm", "output_V"}
        in_wrong_unit = {"noise_mm", "range_mm"} if characteristic else {"noise_V", "range_V", "offset_V"}
        if wrong := entry.stated & in_wrong_unit:
            complain("other_in_V" if characteristic else "other_in_mm", wrong=" and ".join(sorted(wrong)))
        if {"gain_V_per_mm"} < characteristic:
            complain("characteristics")
        elif entry.gain_V_per_mm == 0.0:
            complain("gain")
        values = _ends(entry, "range_V" if characteristic else "range_mm", complain)
        if not characteristic:
            ends = {name: converted(end, -3) for name, end in values.items()}
            values = {"unit": "m", "noise": scaled(entry.noise_mm), **ends}
        if entry.distance_mm is None:  # Linear, or the distance itself
            slope = 1.0 if entry.gain_V_per_mm is None else scaled(entry.gain_V_per_mm, 3)
            values |= {"distances_m": (0.0, 1.0), "readings": (entry.offset_V, entry.offset_V + slope)}
        return values


class PickupCoil(Sensor, Outline):
    """A winding without current: the voltage that its flux linkage induces, in V."""

    COLUMN = "pickup_V"

    vertices_m: tuple[tuple[float, float], ...] = ()
    turns: float = key("the number of turns", **TURNS)
    moves: bool = key("true for a coil that belongs to the moving part", False)
    kind: Literal["pickup_coil"] = key('"pickup_coil" for a winding without current', "pickup_coil", required=True)


class AccelerationSensor(Sensor):
    """The moving part's acceleration along growing distance, in m/s^2."""

    UNIT, COLUMN = "m_per_s2", "acceleration_m_s2"

    # Whether it reads d'' - g, as accelerometers of silicon do: a body at rest that hangs reads 9.8 towards the magnet
    reads_gravity: bool = key("true for one that reads gravity too at rest, as MEMS accelerometers do", False)
    kind: Literal["acceleration"] = key(
        '"acceleration" for an accelerometer on the body', "acceleration", required=True
    )


class ForceSensor(Sensor):
    """The magnetic force on the moving part, positive towards smaller distance, in N."""

    UNIT, COLUMN = "N", "force_N"

    kind: Literal["force"] = key('"force" for a load cell that holds the body', "force", required=True)


AnySensor: TypeAlias = HallElement | CurrentSensor | PositionSensor | PickupCoil | AccelerationSensor | ForceSensor


REMEDY = "There it says nothing of the distance: take a wider range, or move the element."


def where_clipped(hall: Any, distance: FloatArray, field: FloatArray) -> str:
    """Where the output is clipped, as a clause such as ``clipped at 5 V from 1.0 to 6.0 mm at some currents``.

    Parameters
    ----------
    hall : HallElement or HallSensor
        Of a drawing or of a model.
    distance : array, shape (n,)
        In m.
    field : array, shape (n,)
        In T; points without a field are passed over.

    Returns
    -------
    str
        Empty where it is clipped nowhere; with ``at some currents`` unless it is clipped at every point of the range.
    """
    volts = hall.quiescent_V + hall.sensitivity_V_per_T * field
    ends = ((hall.output_max_V, volts >= hall.output_max_V), (hall.output_min_V, volts <= hall.output_min_V))
    clauses = []
    for end, clipped in ends:
        if clipped.any():
            low, high = distance[clipped].min(), distance[clipped].max()
            within = (low <= distance) & (distance <= high) & np.isfinite(field)
            always = "" if clipped[within].all() else " at some currents"
            clauses.append(f"clipped at {end:g} V from {amount_range(low, high, 'm', 3)}{always}")
    return " and ".join(clauses)
