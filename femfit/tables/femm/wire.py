"""The wire of a FEMM model's windings: the user's, the file's, or an assumption that is called one."""

import math
from dataclasses import dataclass

from femfit.device.winding import smallest_winding_area, wire_resistance
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.winding import PLAIN_WIRE, FemCoil

COPPER_FILL = 0.5
"""Copper in a winding's section, usual for round wire (geometry/plunger-solenoid.toml has 0.53)."""


@dataclass(frozen=True)
class FemWire:
    """What an actuator file says of the wire; a resistance without an origin follows from the diameter, at 20 degC."""

    resistance_ohm: float
    resistance_origin: str = ""
    diameter_mm: float | None = None
    diameter_origin: str = ""


def find_wire(coil: FemCoil, options: FemOptions, notes: Notes) -> FemWire:
    """A winding's wire and resistance."""
    material = coil.material
    diameter, origin = options.wire_diameter_mm, "given"
    round_wire = material.lamination_type == PLAIN_WIRE and material.wire_diameter_mm > 0.0
    if diameter is None and round_wire and _fits(coil, material.wire_diameter_mm):
        diameter, origin = material.wire_diameter_mm, f"WireD of {material.name!r}"
    if options.resistance_ohm is not None:
        return FemWire(options.resistance_ohm, "given", diameter, origin)
    resistance = _wire_resistance(coil)
    if diameter is None and resistance is not None:
        return FemWire(resistance, f"the wire and conductivity of {material.name!r}")
    if diameter is None:
        section = COPPER_FILL * coil.polygon.area / abs(coil.turns)
        diameter = float(f"{2.0 * math.sqrt(section / math.pi):.3g}")
        origin = f"ASSUMED: the file has no wire that fits; {100 * COPPER_FILL:g} % of the winding is copper"
        notes.warn(
            "assumed-wire",
            f"The file says nothing of the wire of {coil.labels[0].place}; {diameter:g} mm is assumed "
            f"({100 * COPPER_FILL:g} % copper).",
            "Give --wire-diameter-mm or --resistance-ohm; force and flux do not depend on it.",
        )
    resistance = wire_resistance(abs(coil.turns), coil.polygon.centroid.x * 1e-3, diameter * 1e-3)
    return FemWire(resistance, "", diameter, origin)


def _wire_resistance(coil: FemCoil) -> float | None:
    """R = N 2 pi r / (sigma s pi d^2 / 4) of wire with s strands; None where the file does not say the wire."""
    material = coil.material
    if material.lamination_type < PLAIN_WIRE or not material.wire_diameter_mm or not material.conductivity:
        return None
    section = max(material.strands, 1) * math.pi * (material.wire_diameter_mm * 1e-3) ** 2 / 4.0
    length = abs(coil.turns) * 2.0 * math.pi * coil.polygon.centroid.x * 1e-3
    return float(length / (material.conductivity * 1e6 * section))


def _fits(coil: FemCoil, diameter: float) -> bool:
    return bool(smallest_winding_area(abs(coil.turns), diameter) <= coil.polygon.area)
