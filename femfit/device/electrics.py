"""Circuits with their drivers, and sensors, as drawn and in SI units.

A winding is fed by a bridge, a one-sided driver with a freewheel diode, or a current amplifier. Every reading of a
sensor is characteristic + noise, kept within a range, rounded to the converter's steps, and late by a delay;
where the output of a Hall element leaves its range, it says nothing of the distance.
"""

from dataclasses import dataclass
from dataclasses import field as limited
from math import inf
from typing import Any, Literal, TypeAlias

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount, amount_range

# Limits in a field's metadata are what a model file is held to: see femfit.model.json_section.


@dataclass(frozen=True)
class Drive:
    """How a command becomes voltage or current; the limits of the voltage are those of the circuit.

    A voltage source gives what is commanded, within its limits. With a freewheel diode it is one-sided: it gives
    positive voltages alone, and without one the current goes on through the diode until it is zero.
    """

    kind: Literal["voltage", "current"] = "voltage"
    # Forward drop of the freewheel diode in V, with that of a Zener diode in series; None for a bridge
    diode_V: float | None = limited(default=None, metadata={"lower": 0.0})
    # Of a current amplifier; without limits it follows every command, without a bandwidth as fast as its voltage allows
    current_min_A: float | None = None
    current_max_A: float | None = None
    bandwidth_Hz: float | None = limited(default=None, metadata={"positive": True})


@dataclass(frozen=True)
class Circuit:
    """Coils in series and their driver: U = R i + L_s i' + d(flux linkage)/dt."""

    # Of all coils and what is in series with them
    resistance_ohm: float = limited(metadata={"positive": True})
    # Of the supply; a drawing without one leaves them open behind a current amplifier, a model has both
    voltage_min_V: float = -inf
    voltage_max_V: float = limited(default=inf, metadata={"not_below": "voltage_min_V"})
    drive: Drive = Drive()  # A bridge: voltages of both signs, as far as the limits go
    name: str = "coil"
    # L_s, in series, outside of the field
    inductance_H: float = limited(default=0.0, metadata={"lower": 0.0})


@dataclass(frozen=True)
class HallElement:
    """A linear Hall element with its analogue output and converter; it stands still."""

    # Position (r, z) of the element
    radius_m: float
    height_m: float
    sensitivity_V_per_T: float = 50.0  # Slope of the output; 50 V/T is 5 mV/G
    quiescent_V: float = 2.5
    # Range of the output and of the converter
    output_min_V: float = 0.0
    output_max_V: float = 5.0
    adc_bits: int = 12  # Resolution of the converter over that range; 0 for none
    noise_V: float = 0.0  # Standard deviation of white noise on one sample
    name: str = "hall"
    direction: tuple[float, float] = (0.0, 1.0)  # Unit vector (r, z) of the component that it measures
    delay_s: float = 0.0
    sample_time_s: float | None = None  # None: the controller's
    kind: Literal["hall"] = "hall"


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """What all other sensors share; noise, range and resolution are in the unit of the reading."""

    name: str
    noise: float = limited(default=0.0, metadata={"lower": 0.0})  # Standard deviation of white noise on one sample
    minimum: float | None = None  # None: no limit
    maximum: float | None = limited(default=None, metadata={"above": "minimum"})
    bits: int = limited(default=0, metadata={"within": (0, 64)})  # Of the converter over that range; 0 for none
    delay_s: float = limited(default=0.0, metadata={"lower": 0.0})
    sample_time_s: float | None = limited(default=None, metadata={"positive": True})  # None: the controller's


@dataclass(frozen=True, kw_only=True)
class CurrentSensor(Sensor):
    """The current of a circuit, read in A."""

    circuit: str
    gain: float = 1.0
    offset: float = 0.0
    kind: Literal["current"] = "current"


@dataclass(frozen=True, kw_only=True)
class PositionSensor(Sensor):
    """The distance as a laser, an optical gate or an LVDT reads it: interpolated between points of a characteristic."""

    distances_m: tuple[float, ...] = limited(metadata={"ascending": True})
    readings: tuple[float, ...] = limited(metadata={"like": "distances_m", "monotone": True})
    unit: str = "V"  # V, or m where the reading is the distance itself
    kind: Literal["position"] = "position"


@dataclass(frozen=True, kw_only=True)
class PickupCoil(Sensor):
    """A winding without current: the voltage that its flux linkage induces, in V."""

    vertices_m: tuple[tuple[float, float], ...]
    turns: float
    moves: bool = False
    kind: Literal["pickup_coil"] = "pickup_coil"


@dataclass(frozen=True, kw_only=True)
class AccelerationSensor(Sensor):
    """The moving part's acceleration along growing distance, in m/s^2."""

    # Whether it reads d'' - g, as accelerometers of silicon do: a body at rest that hangs reads 9.8 towards the magnet
    reads_gravity: bool = False
    kind: Literal["acceleration"] = "acceleration"


@dataclass(frozen=True, kw_only=True)
class ForceSensor(Sensor):
    """The magnetic force on the moving part, positive towards smaller distance, in N."""

    kind: Literal["force"] = "force"


AnySensor: TypeAlias = HallElement | CurrentSensor | PositionSensor | PickupCoil | AccelerationSensor | ForceSensor


REMEDY = "There it says nothing of the distance: take a wider range, or move the element."


def where_clipped(hall: Any, distance: FloatArray, current: FloatArray, field: FloatArray) -> str:
    """Where the output is clipped, as a clause such as ``clipped at 5 V from 1 to 6 mm at 0 A``; empty where nowhere.

    Each end of the range is said at the smallest current that reaches it, and at the current that does so farthest.

    Parameters
    ----------
    hall : HallElement or HallSensor
        Of a drawing or of a model.
    distance : array, shape (n,)
        In m.
    current : array, shape (n,), or (n, circuits)
        In A.
    field : array, shape (n,)
        In T; points without a field are passed over.
    """
    volts = hall.quiescent_V + hall.sensitivity_V_per_T * field
    ends = ((hall.output_max_V, volts >= hall.output_max_V), (hall.output_min_V, volts <= hall.output_min_V))
    clauses = []
    for end, clipped in ends:
        if not clipped.any():
            continue
        d, i = distance[clipped], current[clipped].reshape(np.count_nonzero(clipped), -1)
        size = np.linalg.norm(i, axis=1)
        chosen = dict.fromkeys(tuple(i[row].tolist()) for row in (np.argmin(size), np.lexsort((size, -d))[0]))
        places = []
        for each in chosen:
            distances, amperes = d[np.all(i == each, axis=1)], " and ".join(amount(current, "A") for current in each)
            places.append(f"from {amount_range(distances.min(), distances.max(), 'm', 3)} at {amperes}")
        clauses.append(f"clipped at {end:g} V {', and '.join(places) if i.shape[1] > 1 else ' and '.join(places)}")
    return ", ".join(clauses)
