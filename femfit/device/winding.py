"""What follows from a winding's wire: its resistance, and whether it fits."""

import math

from femfit.core.constants import COPPER_RESISTIVITY_20C, COPPER_TEMPERATURE_COEFFICIENT


def wire_resistance(turns: float, mean_radius: float, wire_diameter: float, temperature: float = 20.0) -> float:
    """Resistance of a copper winding, R = rho(T) N 2 pi r_mean / (pi d^2 / 4), all in SI units but T in degC.

    The mean turn length is 2 pi times the radius of the section's centroid (Pappus).

    References
    ----------
    IEC 60028 for the resistivity of annealed copper and its temperature coefficient.
    """
    resistivity = COPPER_RESISTIVITY_20C * (1.0 + COPPER_TEMPERATURE_COEFFICIENT * (temperature - 20.0))
    return resistivity * turns * 2.0 * math.pi * mean_radius / (math.pi * wire_diameter**2 / 4.0)


def smallest_winding_area(turns: float, wire_diameter: float) -> float:
    """Area that round wires need at least, N d^2 sqrt(3)/2: the densest packing of circles fills 90.7 %.

    References
    ----------
    L. Fejes Toth, Regular Figures (1964): no packing of equal circles in a convex domain is denser.
    """
    return turns * wire_diameter**2 * math.sqrt(3.0) / 2.0
