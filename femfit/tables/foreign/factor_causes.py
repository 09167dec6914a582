"""What a factor between flux linkage and force usually means: units, turns, parts of a model."""

import itertools
import math

from femfit.tables.foreign.options import QUANTITIES
from femfit.tables.suspected_units import common_factors

_PARTS = (
    (2 * math.pi, "force of one radian of an axisymmetric model (give --force-unit 6.283185)"),
    (1 / (2 * math.pi), "flux linkage of one radian of an axisymmetric model (give --flux-linkage-unit 6.283185)"),
    (2.0, "force of one half of a symmetric model (give --force-unit 2)"),
)


def _unit_causes() -> list[tuple[float, str]]:
    """Every common unit read as another one.

    factor = (flux linkage as read / true) (current as read / true) / ((force as read / true) (distance as read / true))
    """
    causes = []
    for quantity, power in (("flux_linkage", 1), ("distance", -1), ("current", 1), ("force", -1)):
        column = QUANTITIES[quantity]
        units = {column.rpartition("_")[2]: 1.0, **common_factors(column)}
        for true, read in itertools.permutations(units, 2):
            if quantity == "distance" or 1.0 in (units[true], units[read]):
                option = f"--{quantity.replace('_', '-')}-unit {true}"
                name = quantity.replace("_", " ")
                causes.append(((units[read] / units[true]) ** power, f"{name} in {true} read as {read} ({option})"))
    return causes


def causes_of(factor: float, tolerance: float) -> list[str]:
    """Name the likely causes of a positive factor, flux side over force side; empty if nothing usual makes it."""
    known = [*_unit_causes(), *_PARTS]
    causes = [cause for value, cause in known if abs(math.log(factor / value)) < tolerance]
    turns = 1 / factor
    if turns > 1.5:
        causes.append(
            f"flux of one turn instead of the linkage of about {turns:.4g} turns (give --flux-linkage-unit {turns:.4g} "
            "with the exact number of turns)"
        )
    elif factor > 1.5:
        causes.append(
            f"current in ampere-turns of a coil of about {factor:.4g} turns (give --current-unit {turns:.4g}, one over "
            "the exact number of turns)"
        )
    return causes
