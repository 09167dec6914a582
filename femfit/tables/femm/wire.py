"""The winding's wire and resistance: the user's, the file's, or an assumption that is called one."""

import math
from dataclasses import dataclass

from femfit.core.finding import Finding
from femfit.device.winding import smallest_winding_area, wire_resistance
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.winding import FemWinding

COPPER_FILL = 0.5
"""Copper in a winding's section, usual for round wire (geometry/plunger-solenoid.toml has 0.53)."""


@dataclass(frozen=True)
class FemWire:
    """What an actuator file says of the wire.

    Parameters
    ----------
    resistance_origin : str
        Where it comes from; empty where it follows from the diameter.
    """

    resistance_ohm: float
    resistance_origin: str = ""
    diameter_mm: float | None = None
    diameter_origin: str = ""


def find_wire(winding: FemWinding, options: FemOptions, findings: list[Finding]) -> FemWire:
    """The winding's wire.

    Returns
    -------
    FemWire
        Its resistance at 20 degC where that follows from the diameter.
    """
    diameter, origin = options.wire_diameter_mm, "given"
    if diameter is None and winding.round_wire and _fits(winding, winding.material.wire_diameter_mm):
        diameter, origin = winding.material.wire_diameter_mm, f"WireD of {winding.material.name!r}"
    if options.resistance_ohm is not None:
        return FemWire(options.resistance_ohm, "given", diameter, origin)
    if diameter is None and winding.wire_resistance_ohm is not None:
        return FemWire(winding.wire_resistance_ohm, f"the wire and conductivity of {winding.material.name!r}")
    if diameter is None:
        section = COPPER_FILL * winding.polygon.area / abs(winding.turns)
        diameter = float(f"{2.0 * math.sqrt(section / math.pi):.3g}")
        origin = f"ASSUMED: the file has no wire that fits; {100 * COPPER_FILL:g} % of the winding is copper"
        findings.append(
            Finding(
                "assumed-wire",
                "warning",
                f"The file says nothing of the wire; {diameter:g} mm is assumed ({100 * COPPER_FILL:g} % copper).",
                "Give --wire-diameter-mm or --resistance-ohm; force and flux do not depend on it.",
            )
        )
    resistance = wire_resistance(abs(winding.turns), winding.polygon.centroid.x * 1e-3, diameter * 1e-3)
    return FemWire(resistance, "", diameter, origin)


def _fits(winding: FemWinding, diameter: float) -> bool:
    return bool(smallest_winding_area(abs(winding.turns), diameter) <= winding.polygon.area)
