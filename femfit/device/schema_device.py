"""The tables of schema 2 that say how an actuator is wired, moves and is read; as in :mod:`femfit.device.schema`."""

from typing import Annotated, Any, Literal

from pydantic import Field

from femfit.device.schema import CoilEntry, Electrical, Entry, Interval, Length, OutlineEntry

Force = Annotated[float, Field(ge=-1e6, le=1e6)]
Time = Annotated[float, Field(ge=0, le=1e6)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Points = Annotated[list[float], Field(min_length=2, max_length=1000)]


class WindingEntry(CoilEntry):
    """``[coils.NAME]``."""

    moves: bool = Field(False, description="Give true for a coil that belongs to the moving part.")


class CircuitEntry(Entry):
    """``[circuits.NAME]``."""

    coils: Annotated[list[str], Field(min_length=1, max_length=100)] = Field(
        description='Give the coils in series as a list of names, "-NAME" for one that is connected the other way.'
    )
    external_resistance_ohm: float = Field(0.0, ge=0, le=1e9, description="Give the resistance in series in ohm.")
    external_inductance_mH: float = Field(0.0, ge=0, le=1e9, description="Give the inductance in series in mH.")
    drive: Literal["voltage", "current"] = Field(
        "voltage", description='Give "voltage" for a bridge or a switch, "current" for a current amplifier.'
    )
    voltage_min_V: Electrical | None = Field(None, description="Give the lowest voltage, or have it from [supply].")
    voltage_max_V: Electrical | None = Field(None, description="Give the highest voltage, or have it from [supply].")
    diode_V: float | None = Field(
        None, ge=0, le=100, description="Give the forward voltage of the freewheel diode of a one-sided driver."
    )
    current_min_A: Electrical | None = Field(None, description="Give the lowest current of a current amplifier.")
    current_max_A: Electrical | None = Field(None, description="Give the highest current of a current amplifier.")
    bandwidth_Hz: float | None = Field(None, gt=0, le=1e9, description="Give the bandwidth of a current amplifier.")


class SpringEntry(Entry):
    """``[mechanics.springs.NAME]``: a stiffness with a preload, or a measured table of forces."""

    stiffness_N_per_mm: Force | None = Field(None, description="Give the stiffness in N/mm.")
    preload_N: Force = Field(0.0, description="Give the force at preload_at_mm; positive pushes the parts apart.")
    preload_at_mm: Length | None = Field(None, description="Give the distance at which the spring has its preload.")
    distance_mm: Annotated[list[Length], Field(min_length=2, max_length=1000)] | None = Field(
        None, description="Give ascending distances of a measured force, instead of stiffness_N_per_mm."
    )
    force_N: Points | None = Field(None, description="Give the forces at distance_mm; positive pushes the parts apart.")


class StopEntry(Entry):
    """``[mechanics.near_stop]`` and ``[mechanics.far_stop]``."""

    distance_mm: Length = Field(description="Give the distance at which the body meets the stop.")
    restitution: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="Give the velocity after an impact over that before, 0 for one that does not bounce.",
    )
    stiffness_N_per_mm: float | None = Field(
        None, gt=0, le=1e9, description="Give the stop's stiffness, or leave it out for a rigid one."
    )


class MechanicsEntry(Entry):
    """``[mechanics]``."""

    mass_g: float = Field(ge=1e-6, le=1e9, description="Give the mass of the whole moving body in grams.")
    gravity: Literal["hanging", "standing", "horizontal", "off"] | None = Field(
        None,
        description='Give "hanging" where weight pulls the parts apart, "standing" where it pulls them together, '
        '"horizontal" or "off".',
    )
    gravity_deg: float | None = Field(
        None, ge=-360, le=360, description="Give the angle between the downward vertical and growing distance instead."
    )
    viscous_N_s_per_m: float = Field(0.0, ge=0, le=1e9, description="Give the viscous friction in N s/m.")
    coulomb_N: float = Field(0.0, ge=0, le=1e6, description="Give the dry friction in N.")
    load_N: Force = Field(0.0, description="Give a constant force; positive pulls the parts apart.")
    travel_mm: Interval | None = Field(
        None, description="Give [least, largest] distance between two rigid stops, or near_stop and far_stop."
    )
    springs: dict[str, Any] = Field({}, description="Give each spring as a table [mechanics.springs.NAME].")
    near_stop: dict[str, Any] | None = Field(None, description="Give the stop at the least distance as a table.")
    far_stop: dict[str, Any] | None = Field(None, description="Give the stop at the largest distance as a table.")


class SensorTiming(Entry):
    """What every sensor of schema 2 may have."""

    bits: int = Field(0, ge=0, le=32, description="Give the converter's bits over the range, 0 for none.")
    delay_ms: Time = Field(0.0, description="Give how late a reading is in ms.")
    sample_time_ms: float | None = Field(
        None,
        ge=1e-6,
        le=1e6,
        description="Give the time from one reading to the next, or leave it to the controller's.",
    )


class CurrentSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "current"``."""

    kind: Literal["current"] = Field(description='Give "current" for a sensor of a circuit\'s current.')
    circuit: str | None = Field(None, description="Name the circuit; it may be left out where there is one alone.")
    noise_A: float = Field(0.0, ge=0, le=1e6, description="Give the standard deviation of one sample in A.")
    range_A: Pair | None = Field(None, description="Give [lowest, highest] reading in A.")


class PositionSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "position"``."""

    kind: Literal["position"] = Field(description='Give "position" for a laser, an optical gate, an LVDT.')
    gain_V_per_mm: Electrical | None = Field(None, description="Give the slope of a linear sensor in V/mm.")
    offset_V: Electrical = Field(0.0, description="Give the output of a linear sensor at distance zero.")
    distance_mm: Annotated[list[Length], Field(min_length=2, max_length=1000)] | None = Field(
        None, description="Give ascending distances of the characteristic, instead of gain_V_per_mm."
    )
    output_V: Points | None = Field(None, description="Give the outputs at distance_mm, rising or falling throughout.")
    noise_V: float = Field(0.0, ge=0, le=1e6, description="Give the standard deviation of one sample in V.")
    range_V: Pair | None = Field(None, description="Give [lowest, highest] output in V.")
    noise_mm: float = Field(0.0, ge=0, le=1e6, description="Give the noise of a sensor that reads the distance itself.")
    range_mm: Pair | None = Field(None, description="Give the range of a sensor that reads the distance itself.")


class PickupCoilEntry(OutlineEntry, SensorTiming):
    """``[sensors.NAME]`` with ``kind = "pickup_coil"``."""

    kind: Literal["pickup_coil"] = Field(description='Give "pickup_coil" for a winding without current.')
    turns: float = Field(ge=1, le=1e7, description="Give the number of turns.")
    moves: bool = Field(False, description="Give true for a coil that belongs to the moving part.")
    noise_V: float = Field(0.0, ge=0, le=1e6, description="Give the standard deviation of one sample in V.")
    range_V: Pair | None = Field(None, description="Give [lowest, highest] output in V.")


class AccelerationSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "acceleration"``."""

    kind: Literal["acceleration"] = Field(description='Give "acceleration" for an accelerometer on the body.')
    reads_gravity: bool = Field(
        False, description="Give true for one that reads gravity too at rest, as MEMS accelerometers do."
    )
    noise_m_per_s2: float = Field(0.0, ge=0, le=1e9, description="Give the standard deviation of one sample in m/s^2.")
    range_m_per_s2: Pair | None = Field(None, description="Give [lowest, highest] reading in m/s^2.")


class ForceSensorEntry(SensorTiming):
    """``[sensors.NAME]`` with ``kind = "force"``."""

    kind: Literal["force"] = Field(description='Give "force" for a load cell that holds the body.')
    noise_N: float = Field(0.0, ge=0, le=1e6, description="Give the standard deviation of one sample in N.")
    range_N: Pair | None = Field(None, description="Give [lowest, highest] reading in N.")
