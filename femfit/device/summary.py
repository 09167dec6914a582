"""The actuator as a sweep's manifest records it: what a model needs beside the table."""

from dataclasses import asdict
from typing import Any

from femfit.device.parts import Actuator


def sweep_manifest_entry(actuator: Actuator) -> dict[str, Any]:
    """The manifest's ``actuator`` entry, as documented in :class:`femfit.tables.sweep_table.SweepTable`.

    Returns
    -------
    dict
        JSON-ready: circuit, motion, sensor, and the coil's turns and wire.
    """
    return {
        "name": actuator.name,
        "description": actuator.description,
        "mass_kg": actuator.moving.mass_kg,
        "resistance_ohm": actuator.coil.resistance_ohm,
        "turns": actuator.coil.turns,
        "wire_diameter_m": actuator.coil.wire_diameter_m,
        "voltage_min_V": actuator.supply.voltage_min_V,
        "voltage_max_V": actuator.supply.voltage_max_V,
        "sample_time_s": actuator.supply.sample_time_s,
        "reference_distances_m": list(actuator.reference_distances_m),
        "hall": None if actuator.hall is None else asdict(actuator.hall),
    }
