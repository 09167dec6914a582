"""How deep a field enters a part that conducts."""

import math
from collections.abc import Iterator

from femfit.core.amount import amount
from femfit.core.constants import MU_0
from femfit.device.parts import Actuator, Material


def skin_depth(material: Material, frequency_Hz: float) -> float:
    """sqrt(2 / (omega mu sigma)) in m."""
    permeability = MU_0 * material.relative_permeability
    return math.sqrt(1.0 / (math.pi * frequency_Hz * permeability * material.conductivity_S_per_m))


def thick_sheets(actuator: Actuator) -> Iterator[str]:
    """A remark on each material whose sheets are thicker than the skin depth, of which homogenised ones are not."""
    if not actuator.frequencies_Hz:
        return
    highest = actuator.frequencies_Hz[-1]
    for material in {one.material.name: one.material for one in (*actuator.fixed, *actuator.moving.regions)}.values():
        sheet = material.lamination_m
        if material.conductivity_S_per_m and sheet > skin_depth(material, highest):
            up_to = highest * (skin_depth(material, highest) / sheet) ** 2
            yield (
                f"Material {material.name}: its sheets of {amount(sheet, 'm')} are thicker than the skin depth of "
                f"{amount(skin_depth(material, highest), 'm')} at {amount(highest, 'Hz')}, which the stated error "
                f"leaves out. Results hold up to {amount(up_to, 'Hz')}: give lower frequencies, thinner sheets, or, of "
                "a solid part, no lamination_mm."
            )
