"""What a lab reads of an actuator: sensors as drawn, in SI units.

Every reading is characteristic + noise, kept within a range, rounded to the converter's steps, and late by a delay.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias


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
    noise: float = 0.0  # Standard deviation of white noise on one sample
    minimum: float | None = None  # None: no limit
    maximum: float | None = None
    bits: int = 0  # Resolution of the converter over that range; 0 for none
    delay_s: float = 0.0
    sample_time_s: float | None = None  # None: the controller's


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

    distances_m: tuple[float, ...]  # Ascending
    readings: tuple[float, ...]  # Rising or falling throughout
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
