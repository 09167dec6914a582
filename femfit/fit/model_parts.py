"""Circuit, motion and sensor of a model: what the magnetics do not tell."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from femfit.fit.hall import HallFit
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import Circuit, HallSensor, Motion


@dataclass(frozen=True, eq=False)
class ModelParts:
    """Circuit, motion and sensor as far as they are known.

    Parameters
    ----------
    circuit : Circuit or None
        Needs resistance, supply and an inductance.
    sensor : HallSensor or None
        Needs a Hall field in the table, and the element.
    notes : tuple of str
        What is missing, and how to give it.
    """

    circuit: Circuit | None
    motion: Motion | None
    sensor: HallSensor | None
    notes: tuple[str, ...]


def model_parts(entry: Mapping[str, Any], rows: FitRows, hall: HallFit | None, inductance_given: bool) -> ModelParts:
    """What an actuator's entry makes of a model beside its magnetics.

    Parameters
    ----------
    entry : mapping
        Of the manifest, as in :class:`femfit.tables.sweep_table.SweepTable`.
    inductance_given : bool
        Whether an inductance stands in for a missing flux linkage.

    Returns
    -------
    ModelParts
        With a note for each that is missing.
    """
    notes = []
    circuit = None
    keys = ("resistance_ohm", "voltage_min_V", "voltage_max_V")
    missing = [key for key in keys if entry.get(key) is None]
    if rows.flux_linkage is None and not inductance_given:
        missing.append("flux_linkage_Wb or an inductance")
    if missing:
        notes.append(
            f"No circuit in the model: {', '.join(missing)} unknown. Give --actuator ACTUATOR.toml"
            + (", and --inductance-H since the table has no flux linkage." if rows.flux_linkage is None else ".")
        )
    else:
        circuit = Circuit(*(float(entry[key]) for key in keys))
    motion = None
    if entry.get("mass_kg") is None:
        notes.append("No motion in the model: mass unknown. Give --actuator ACTUATOR.toml or --mass-g.")
    else:
        motion = Motion(float(entry["mass_kg"]))
    sensor = None
    element = entry.get("hall")
    if hall is None or not element:
        notes.append("No sensor in the model: it needs hall_T in the table and [hall] in the actuator file.")
    else:
        values = {key: value for key, value in element.items() if key not in {"radius_m", "height_m"}}
        sensor = HallSensor(field=hall.field, **values)
    return ModelParts(circuit, motion, sensor, tuple(notes))
