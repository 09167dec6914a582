"""The actuator as a sweep's manifest records it: what a model needs beside the table, and the actuator again."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from pydantic import TypeAdapter, ValidationError

from femfit.core.errors import ActuatorFileError
from femfit.core.files import json_ready
from femfit.device.electrics import HallElement
from femfit.device.parts import Actuator, NonlinearMaterial, is_iron, thick_sheets
from femfit.device.schema import NAME_PATTERN


def sweep_manifest_entry(actuator: Actuator) -> dict[str, Any]:
    """The manifest's ``actuator`` entry: circuit, motion, sensor, turns and wire, and what kind of actuator it is."""
    return {
        "name": actuator.name,
        "description": actuator.description,
        "mass_kg": actuator.mechanics.mass_kg,
        **_of_one_circuit(actuator),
        "sample_time_s": actuator.sample_time_s,
        "reference_distances_m": list(actuator.reference_distances_m),
        "hall": None if actuator.hall is None else asdict(actuator.hall),
        "circuits": [json_ready(asdict(circuit)) for circuit in actuator.circuits],
        "coils": [{"name": coil.name, "turns": coil.turns, "moves": coil.moves} for coil in actuator.coils],
        "mechanics": asdict(actuator.mechanics),
        "sensors": [asdict(sensor) for sensor in actuator.sensors],
        "kind": {
            "fixed_magnet": any(region.material.remanence_T for region in actuator.fixed),
            "moving_magnet": any(region.material.remanence_T for region in actuator.moving.regions),
            "fixed_iron": any(is_iron(region.material) for region in actuator.fixed),
            "moving_iron": any(is_iron(region.material) for region in actuator.moving.regions),
            "coil": bool(actuator.coils),
            "saturates": actuator.saturates,
        },
    }


def _of_one_circuit(actuator: Actuator) -> dict[str, Any]:
    """The numbers of an actuator with one circuit whose driver's voltages are known; nothing for others."""
    if len(actuator.circuits) != 1:
        return {}
    (circuit,) = actuator.circuits
    if not actuator.supplies_V:
        return {}
    of_coil = {}
    if len(actuator.coils) == 1:
        of_coil = {"turns": actuator.coil.turns, "wire_diameter_m": actuator.coil.wire_diameter_m}
    return {
        "resistance_ohm": circuit.resistance_ohm,
        **of_coil,
        "voltage_min_V": circuit.voltage_min_V,
        "voltage_max_V": circuit.voltage_max_V,
    }


def remarks(actuator: Actuator) -> list[str]:
    """What was left out of a drawing's materials, too thick sheets, and a Hall element of which the place is known."""
    materials = {region.material for region in actuator.regions}
    problems = sorted(
        f"Material {material.name}: {material.remark}."
        for material in materials
        if isinstance(material, NonlinearMaterial) and material.remark
    )
    problems += thick_sheets(actuator)
    hall = actuator.hall
    if hall is not None and hall == HallElement(hall.radius_m, hall.height_m):
        problems.append(
            f"Hall element: taken with {hall.sensitivity_V_per_T:g} V/T, {hall.quiescent_V:g} V without field, an "
            f"output of {hall.output_min_V:g} to {hall.output_max_V:g} V, {hall.adc_bits} bits and no noise. Give "
            "[sensors.hall] your own sensor's values."
        )
    return problems


def actuator_from_record(record: Mapping[str, Any], source: str) -> Actuator:
    """Build the actuator again that ``dataclasses.asdict`` made a record of, here or in an earlier version."""
    try:
        actuator = TypeAdapter(Actuator).validate_python(_of_this_version(dict(record)))
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}." for fault in error.errors()]
        raise ActuatorFileError(source, [*problems, "Sweep again, or give the actuator file."]) from error
    if re.fullmatch(NAME_PATTERN, actuator.name) is None:  # directories are named after it
        received = f"instead received {actuator.name[:64]!r}. Sweep again."
        raise ActuatorFileError(
            source, [f"name: must begin with a letter and hold letters, digits, - and _; {received}"]
        )
    return actuator


def _of_this_version(record: dict[str, Any]) -> dict[str, Any]:
    """Records in which a circuit named its coils, and those of one coil, one Hall element and a mass alone."""
    if isinstance(record.get("coil"), Mapping):
        record = _of_one_coil(record)
    circuits, coils, supply = record.get("circuits") or (), record.get("coils") or (), record.pop("supply", None) or {}
    if not all(isinstance(circuit, Mapping) for circuit in (*circuits, *coils, supply)):
        return record
    connections = {
        name: {"circuit": circuit.get("name"), "sign": sign}
        for circuit in circuits
        for name, sign in circuit.get("coils", ())
    }
    limits = (supply["voltage_min_V"], supply["voltage_max_V"]) if supply else None
    return record | {
        "sample_time_s": supply.get("sample_time_s", record.get("sample_time_s")),
        "coils": [{**coil, **connections.get(coil.get("name"), {})} for coil in coils],
        "circuits": [circuit_of_this_version(circuit, limits) for circuit in circuits],
    }


def circuit_of_this_version(record: Mapping[str, Any], supply_V: Sequence[float] | None) -> dict[str, Any]:
    """A circuit's record without what is null; its drive held the limits in earlier versions, and it named its coils.

    Parameters
    ----------
    supply_V : sequence of float or None
        Lowest and highest voltage behind the current amplifiers of earlier versions.
    """
    drive, limits = dict(record.get("drive") or {}), {}
    if "minimum" in drive:
        low, high = drive.pop("minimum"), drive.pop("maximum")
        if drive.get("kind") == "current":
            drive |= {"current_min_A": low, "current_max_A": high}
            low, high = supply_V or (None, None)
        limits = {"voltage_min_V": low, "voltage_max_V": high}
    circuit = {**limits, **record, "drive": drive}
    return {key: value for key, value in circuit.items() if value is not None and key != "coils"}


def _of_one_coil(record: dict[str, Any]) -> dict[str, Any]:
    coil, hall, supply = record.pop("coil"), record.pop("hall", None), record.get("supply") or {}
    moving = dict(record.get("moving") or {})
    limits = {key: supply.get(key, 0.0) for key in ("voltage_min_V", "voltage_max_V")}
    return record | {
        "coils": [coil],
        "circuits": [{"resistance_ohm": coil.get("resistance_ohm"), **limits}],
        "sensors": [] if hall is None else [hall],
        "mechanics": {"mass_kg": moving.pop("mass_kg", None)},
        "moving": moving,
    }
