"""The actuator as a sweep's manifest records it: what a model needs beside the table, and the actuator again."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from pydantic import TypeAdapter, ValidationError

from femfit.core.errors import ActuatorFileError
from femfit.core.files import json_ready
from femfit.device.electrics import HallElement
from femfit.device.parts import Actuator, NonlinearMaterial, Region, thick_sheets
from femfit.device.schema import NAME_PATTERN

IRON_FROM = 1.5
"""Relative permeability from which a material without remanence counts as iron; magnets recoil with 1.05."""


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
        "coils": [{"name": one.name, "turns": one.turns, "moves": one.moves} for one in actuator.coils],
        "mechanics": asdict(actuator.mechanics),
        "sensors": [asdict(sensor) for sensor in actuator.sensors],
        "kind": {
            "fixed_magnet": any(map(is_magnet, actuator.fixed)),
            "moving_magnet": any(map(is_magnet, actuator.moving.regions)),
            "fixed_iron": any(map(is_iron, actuator.fixed)),
            "moving_iron": any(map(is_iron, actuator.moving.regions)),
            "coil": bool(actuator.coils),
            "saturates": any(
                isinstance(region.material, NonlinearMaterial) for region in (*actuator.fixed, *actuator.moving.regions)
            ),
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
    materials = {region.material for region in (*actuator.fixed, *actuator.moving.regions)}
    said = sorted(
        f"Material {material.name}: {material.remark}."
        for material in materials
        if isinstance(material, NonlinearMaterial) and material.remark
    )
    said += thick_sheets(actuator)
    hall = actuator.hall
    if hall is not None and hall == HallElement(hall.radius_m, hall.height_m):
        said.append(
            f"Hall element: taken with {hall.sensitivity_V_per_T:g} V/T, {hall.quiescent_V:g} V without field, an "
            f"output of {hall.output_min_V:g} to {hall.output_max_V:g} V, {hall.adc_bits} bits and no noise. Give "
            "[sensors.hall] your own sensor's values."
        )
    return said


def is_magnet(region: Region) -> bool:
    """Whether a region has a remanence."""
    return region.material.remanence_T != 0.0


def is_iron(region: Region) -> bool:
    """Whether a region is soft iron, ferrite or steel rather than a magnet or something not magnetic."""
    return not is_magnet(region) and region.material.relative_permeability >= IRON_FROM


def actuator_from_record(record: Mapping[str, Any], source: str) -> Actuator:
    """Build the actuator again that ``dataclasses.asdict`` made a record of, here or in an earlier version."""
    try:
        actuator = TypeAdapter(Actuator).validate_python(_of_this_version(dict(record)))
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}." for fault in error.errors()]
        raise ActuatorFileError(source, [*problems, "Sweep again, or give the actuator file."]) from error
    if re.fullmatch(NAME_PATTERN, actuator.name) is None:  # directories are named after it
        given = f"instead received {actuator.name[:64]!r}. Sweep again."
        raise ActuatorFileError(source, [f"name: must begin with a letter and hold letters, digits, - and _; {given}"])
    return actuator


def _of_this_version(record: dict[str, Any]) -> dict[str, Any]:
    """Records in which a circuit named its coils, and those of one coil, one Hall element and a mass alone."""
    if isinstance(record.get("coil"), Mapping):
        record = _of_one_coil(record)
    circuits, coils, supply = record.get("circuits") or (), record.get("coils") or (), record.pop("supply", None) or {}
    if not all(isinstance(one, Mapping) for one in (*circuits, *coils, supply)):
        return record
    own = {name: {"circuit": one.get("name"), "sign": sign} for one in circuits for name, sign in one.get("coils", ())}
    limits = (supply["voltage_min_V"], supply["voltage_max_V"]) if supply else None
    return record | {
        "sample_time_s": supply.get("sample_time_s", record.get("sample_time_s")),
        "coils": [{**coil, **own.get(coil.get("name"), {})} for coil in coils],
        "circuits": [circuit_of_this_version(one, limits) for one in circuits],
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
    known = {**limits, **record, "drive": drive}
    return {key: value for key, value in known.items() if value is not None and key != "coils"}


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
