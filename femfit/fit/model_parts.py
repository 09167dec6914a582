"""Circuit, motion and sensor of a model: what the magnetics do not hold."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import TypeAdapter, ValidationError

from femfit.core.errors import TableError, UsageError
from femfit.core.numerics import FloatArray
from femfit.device.electrics import AnySensor, Circuit, HallElement, PickupCoil, Sensor
from femfit.device.load import circuit_record, read_actuator, sweep_manifest_entry
from femfit.device.mechanics import Mechanics
from femfit.fit.constants import STOP_ROUNDING_M
from femfit.fit.rows import FitRows
from femfit.fit.sensed_field import SensedFit
from femfit.fit.words import note
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallField, HallSensor, OtherSensor, PickupSensor
from femfit.model.magnetics import Magnetics
from femfit.model.several_magnetics import CoenergyMatrix
from femfit.model.validity import ActuatorKind, ValidityBox


def actuator_entry(
    recorded: Mapping[str, Any] | None,
    actuator: str | Path | Mapping[str, Any] | None,
    mass_kg: float | None,
    resistance_ohm: float | None,
    supply_V: tuple[float, float] | None,
) -> dict[str, Any]:
    """What a manifest records of its actuator, with what was given in its place."""
    if isinstance(actuator, str | Path):
        actuator = sweep_manifest_entry(read_actuator(actuator))
    if supply_V is not None and not supply_V[0] < supply_V[1]:
        raise UsageError(f"The supply's lowest voltage must be below its highest; instead received {supply_V}.")
    low, high = supply_V or (None, None)
    options = {"voltage_min_V": low, "voltage_max_V": high, "mass_kg": mass_kg, "resistance_ohm": resistance_ohm}
    given = {key: value for key, value in options.items() if value is not None}
    return {**(recorded or {}), **(actuator or {}), **given}


def hall_sensor_of(element: Mapping[str, Any], field: HallField) -> HallSensor:
    """The Hall element of a manifest's record with the field that the sweep holds."""
    names = ("sensitivity_V_per_T", "quiescent_V", "output_min_V", "output_max_V", "noise_V")
    return HallSensor(
        field=field,
        **{name: number(element, name) for name in names},
        adc_bits=int(number(element, "adc_bits")),
        delay_s=number(element, "delay_s") if element.get("delay_s") else 0.0,
        sample_time_s=period_of(element),
    )


def circuits_of(
    entry: Mapping[str, Any], names: Sequence[str] = (), flux_linkage: bool = True, inductance_given: bool = True
) -> tuple[tuple[Circuit, ...], tuple[str, ...]]:
    """The circuits of several names, or the only one, of an actuator entry; none where not all is there, and why.

    The only one needs an inductance: from the table's flux linkage, or given.
    """
    records: Sequence[Mapping[str, Any]] = entry.get("circuits") or ()
    if names:
        recorded = {record.get("name"): record for record in records}
        if not set(names) <= set(recorded):
            return (), (note("no_circuits", names),)
        records = [recorded[name] for name in names]
    else:
        keys = ("resistance_ohm", "voltage_min_V", "voltage_max_V")
        missing = [key for key in keys if entry.get(key) is None]
        if not (flux_linkage or inductance_given):
            missing.append("flux_linkage_Wb or an inductance")
        if missing:
            return (), (note("no_circuit", missing, flux_linkage),)
        records = [{**(records[0] if records else {}), **{key: number(entry, key) for key in keys}}]
    circuits = tuple(_recorded(Circuit, "circuit", circuit_record(record)) for record in records)
    without = [circuit.name for circuit in circuits if not np.isfinite(circuit.voltage_max_V - circuit.voltage_min_V)]
    return ((), (note("no_limits", without),)) if without else (circuits, ())


def mechanics_of(entry: Mapping[str, Any]) -> Mechanics | None:
    """The mechanics of a manifest's actuator entry, of an earlier version the mass alone; None without a mass."""
    if entry.get("mass_kg") is None:
        return None
    return _recorded(Mechanics, "mechanics", {**(entry.get("mechanics") or {}), "mass_kg": number(entry, "mass_kg")})


def within_sweep(motion: Mechanics | None, distances: FloatArray) -> tuple[Mechanics | None, tuple[str, ...]]:
    """The mechanics without the stops that lie beyond the swept distances in m, and what is said."""
    if motion is None:
        return None, (note("no_motion"),)
    low, high = float(distances.min()) - STOP_ROUNDING_M, float(distances.max()) + STOP_ROUNDING_M
    near, far = motion.ends
    sides = ("near", near, near < low), ("far", far, far > high)
    beyond = {side: place for side, place, outside in sides if outside and np.isfinite(place)}
    notes = tuple(note("beyond_sweep", side, place) for side, place in beyond.items())
    stops = {f"{side}_stop": None for side in beyond}
    return replace(motion, **cast("dict[str, Any]", stops)), notes


def validity_of(magnetics: Magnetics, rows: FitRows, winding: bool = True) -> ValidityBox:
    """The distances and currents that a model holds for.

    A quadratic form holds for currents of either sign. A spline of several holds where it was swept and, without a
    magnet, where all of these currents flow the other way, which is a box again where all circuits but one were swept
    to both sides.
    """
    low, high = rows.circuit_currents.min(axis=0), rows.circuit_currents.max(axis=0)
    even = rows.several and not (rows.magnet or isinstance(magnetics, CoenergyMatrix))
    lopsided = int((low != -high).sum())
    mirrored = even and lopsided > 1
    if isinstance(magnetics, CoenergyMatrix) or (even and lopsided == 1 and np.all(low * high <= 0.0)):
        low, high = np.minimum(low, -high), np.maximum(high, -low)
    limits = zip(low.tolist(), high.tolist(), strict=True)
    ends = float(rows.distances[0]), float(rows.distances[-1])
    return ValidityBox.of_currents(ends, *limits, winding=winding, mirrored=mirrored)


def other_sensors_of(
    entry: Mapping[str, Any], linked: Mapping[str, SensedFit | str]
) -> tuple[tuple[OtherSensor, ...], tuple[str, ...]]:
    """Sensors beside the Hall element of a manifest's actuator entry; which are not in the model, and misfits.

    Parameters
    ----------
    linked : mapping of str to SensedFit or str
        Flux linkage of each pickup coil that the sweep holds, or why it has none.
    """
    sensors: list[OtherSensor] = []
    notes, halls = [], 0
    for record in entry.get("sensors") or ():
        sensor: AnySensor = _recorded(AnySensor, "sensor", record)
        if isinstance(sensor, PickupCoil):
            flux, what = linked.get(sensor.name, "no flux"), f"Pickup coil {sensor.name!r}"
            notes.append(note("sensed", flux, what, "Wb"))
            if isinstance(flux, SensedFit):
                shared = {f.name: getattr(sensor, f.name) for f in fields(Sensor)}
                sensors.append(PickupSensor(**shared, flux=flux.field))
        elif isinstance(sensor, HallElement):
            halls += 1
            if halls > 1:
                notes.append(note("not_in_the_model", f"Hall element {sensor.name!r}", "second"))
        else:
            sensors.append(sensor)
    return tuple(sensors), tuple(notes)


def _recorded(kind: Any, name: str, record: Mapping[str, Any]) -> Any:
    try:
        return TypeAdapter(kind).validate_python(record)
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors())
        raise TableError(f"The manifest's {name} is damaged: {faults}. Give --actuator ACTUATOR.toml.") from error


def period_of(entry: Mapping[str, Any]) -> float | None:
    """The controller's period in s of a manifest's actuator entry, where it has one."""
    return number(entry, "sample_time_s") if entry.get("sample_time_s") else None


def sample_time(model: ActuatorModel) -> float:
    """The controller's period in s where no file gives it; the model's own where it has neither circuit nor motion.

    A tenth of the smallest L/R, of several circuits the least eigenvalue of R^-1 L, or of the body's smallest
    sqrt(m / |dF/dd|), whichever is shorter, rounded down to 1, 2 or 5 times a power of ten.

    References
    ----------
    K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), section 2.9: 4 to 10 samples a
    rise time.
    """
    d, i = model.validity.grid(15, 15, several=5)
    constants = []
    if model.circuits:
        inductance = model.magnetics.inductance(d, i) + model.series_inductances_H
        constants.append(float(np.linalg.eigvals(inductance / model.resistances_ohm[:, None]).real.min()))
    if model.motion is not None:
        steepest = float(np.max(np.abs(model.magnetics.force_gradient(d, i))))
        constants.append(float(np.sqrt(model.motion.mass_kg / steepest)) if steepest > 0.0 else np.inf)
    shortest = 0.1 * min((constant for constant in constants if constant > 0.0), default=np.inf)
    if not np.isfinite(shortest):
        return model.sample_time_s
    decade = 10.0 ** np.floor(np.log10(shortest) + 1e-9)
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step <= shortest / decade * (1.0 + 1e-9)))


def kind_of(entry: Mapping[str, Any]) -> ActuatorKind | None:
    """What the drawing is made of; None where the manifest does not say."""
    return _recorded(ActuatorKind, "kind of actuator", entry["kind"]) if entry.get("kind") else None


def number(entry: Mapping[str, Any], key: str) -> float:
    """A finite number of a manifest, which users edit and which may be damaged."""
    value = entry.get(key) if isinstance(entry, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < sys.float_info.max:
        raise TableError(
            f"The table's manifest must give {key} of its actuator as a finite number; instead received "
            f"{str(value)[:60]!r}. Sweep or import again, or give --actuator ACTUATOR.toml."
        )
    return float(value)
