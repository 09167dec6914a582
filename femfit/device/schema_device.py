"""Tables of the actuator file beside the drawing: wiring, motion, sensors, materials, ``[solver]`` and ``[thermal]``.

They are read as those of :mod:`femfit.device.schema`; defaults of ``[thermal]`` are those of
:mod:`femfit.device.thermal`.
"""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from femfit.device.schema import AXIS_KINDS, CoilEntry, Electrical, Entry, Interval, Length, OutlineEntry, axis_kind
from femfit.device.thermal import STILL_AIR as USUAL

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


class ConductorEntry(Entry):
    """How a material of either kind conducts."""

    conductivity_MS_per_m: float = Field(
        0.0,
        ge=0,
        le=1e4,
        description="Give the electrical conductivity in MS/m (10^6 S/m): copper 58, mild steel 5 to 9, 0 for what "
        "does not conduct.",
    )
    lamination_mm: float = Field(
        0.0,
        ge=0,
        le=100,
        description="Give the thickness in mm of insulated sheets that stand radially around the axis, so that no "
        "current flows around it; 0 for a solid part and for discs.",
    )
    thermal_conductivity_W_per_m_K: float | None = Field(
        None, gt=0, le=5e3, description="Give the thermal conductivity, or leave it to what is usual for its kind."
    )
    heat_capacity_MJ_per_m3_K: float | None = Field(
        None,
        gt=0,
        le=100,
        description="Give density times specific heat (steel 3.4, aluminium 2.4), or leave it to what is usual.",
    )


class MaterialEntry(ConductorEntry):
    """``[materials.NAME]``: a linear material."""

    relative_permeability: float = Field(
        ge=1e-6, le=1e7, description="Give mu_r, 1 for everything non-magnetic; the recoil permeability of a magnet."
    )
    remanence_T: float = Field(
        0.0, ge=0, le=3, description="Give B_r in tesla (1 T = 10 kG); the direction is the region's magnetization."
    )
    remanence_coefficient_per_K: float = Field(
        0.0, ge=-0.02, le=0.02, description="Give the relative change of B_r per kelvin: -0.0012 for -0.12 %/K."
    )
    working_temperature_C: float | None = Field(
        None, ge=-273, le=1000, description="Give a magnet's largest working temperature in degC, where it is known."
    )


CurveValues = Annotated[list[float], Field(max_length=1000)]


class CurveEntry(ConductorEntry):
    """``[materials.NAME]``: a soft material with a magnetisation curve, from a file or from two lists."""

    bh_curve: str | None = Field(
        None, min_length=1, description="Give a steel of the library, or a CSV file with the columns B_T,H_A_per_m."
    )
    B_T: CurveValues | None = Field(None, description="Give ascending flux densities in tesla as a list, from 0.")
    H_A_per_m: CurveValues | None = Field(None, description="Give ascending fields in A/m as a list, from 0.")


CURVE_KEYS = CurveEntry.model_fields.keys() - ConductorEntry.model_fields.keys()


def has_curve(table: object) -> bool:
    """Whether a table of a material gives a magnetisation curve."""
    return isinstance(table, dict) and bool(table.keys() & CURVE_KEYS)


MAX_FREQUENCIES = 1000

Frequency = Annotated[float, Field(gt=0, le=1e9)]


class FrequencyRangeEntry(Entry):
    """``{ start = ..., stop = ..., per_decade = ... }``, both ends included."""

    start: Frequency = Field(description="Give the lowest frequency in Hz.")
    stop: Frequency = Field(description="Give the highest frequency in Hz; it belongs to the list.")
    per_decade: int = Field(ge=1, le=100, description="Give how many frequencies there are in each decade.")


FrequencyAxis = Annotated[
    Annotated[FrequencyRangeEntry, Tag(AXIS_KINDS[0])]
    | Annotated[list[Frequency], Field(min_length=1, max_length=MAX_FREQUENCIES), Tag(AXIS_KINDS[1])],
    Discriminator(
        axis_kind,
        custom_error_type="axis",
        custom_error_message="Input should be a list of frequencies or a table { start, stop, per_decade }",
    ),
]


class SolverEntry(Entry):
    """``[solver]``: how accurate the field solver has to be, and at which frequencies."""

    tolerance: float | None = Field(
        None, ge=1e-5, le=0.1, description="Give the relative accuracy of force and flux linkage, as 1e-3 for 0.1 %."
    )
    frequency_Hz: FrequencyAxis | None = Field(
        None,
        description="Give the frequencies of the impedance as an ascending list or as { start, stop, per_decade }.",
    )
    eddy_error: float = Field(
        0.01,
        ge=1e-4,
        le=0.2,
        description="Give the relative error of impedance, force and Hall field that the reduced model of the eddy "
        "currents has to meet.",
    )
    eddy_bias_A: float | list[float] | None = Field(
        None,
        description="Give the current in A about which the eddy currents of saturating parts are linearised, or a list "
        "with one for each circuit.",
    )


class ThermalEntry(Entry):
    """``[thermal]``: what temperatures depend on beside the drawing."""

    ambient_C: float = Field(USUAL.ambient_C, ge=-200, le=500, description="Give the temperature around the actuator.")
    film_W_per_m2_K: float = Field(
        USUAL.film_W_per_m2_K,
        gt=0,
        le=1e5,
        description="Give what a free face gives off for each kelvin: 5 to 15 in still air with radiation, 20 to 100 "
        "with a fan.",
    )
    joint_mm: float = Field(
        0.01, ge=1e-4, le=10, description="Give the air that is left where two parts touch; a press fit 0.005."
    )
    winding_joint_mm: float = Field(
        0.1, ge=1e-4, le=10, description="Give the same between a winding and what it is drawn to touch."
    )
    insulation_W_per_m_K: float = Field(
        USUAL.insulation_W_per_m_K,
        gt=0,
        le=100,
        description="Give the thermal conductivity between a winding's strands: 0.1 dry, 0.25 in resin.",
    )
    mounting_W_per_K: float = Field(
        USUAL.mounting_W_per_K,
        ge=0,
        le=1e6,
        description="Give what the heaviest fixed part conducts into what it is fastened to, for each kelvin.",
    )
    winding_limit_C: float = Field(
        USUAL.winding_limit_C,
        ge=-200,
        le=1000,
        description="Give the largest temperature of a winding: 105, 120, 130, 155, 180 for the classes A, E, B, F, H.",
    )
