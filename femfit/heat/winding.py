"""A winding's heat: how strands and what is between them conduct, and the way from the middle to the faces.

A winding counts as a ring of rectangular section with the same heat everywhere. Its faces and its mean temperature are
then joined by two stars, one for each direction, which are exact where heat leaves in that direction alone; where it
leaves in both, the rise inside is up to a fifth too large.

References
----------
P. H. Mellor, D. Roberts and D. R. Turner, IEE Proceedings B 138 (1991) 205: the stars of a ring.
N. Simpson, R. Wrobel and P. H. Mellor, IEEE Trans. Industry Applications 49 (2013) 2505: round wires in a filler.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from femfit.core.arrays import FloatArray
from femfit.core.constants import COPPER_RESISTIVITY_20C, COPPER_TEMPERATURE_COEFFICIENT
from femfit.device.parts import REFERENCE_TEMPERATURE, Coil
from femfit.device.thermal import LORENZ_NUMBER, METAL_CAPACITY, ROOM_K

FILLER_CAPACITY = 1e6
"""Assumed: in J/(m^3 K), of enamel (2e6) and air between strands."""

DENSEST = math.pi / math.sqrt(12.0)
"""The largest share that round wires fill."""


@dataclass(frozen=True)
class WindingHeat:
    """What a winding's wire makes of its section."""

    copper_share: float
    conductivity_W_per_m_K: float  # Across the strands
    heat_capacity_J_per_K: float
    cold_ohm: float  # Resistance at 20 degC


def cold_resistance(coil: Coil) -> float:
    """Resistance in ohm at 20 degC."""
    return float(coil.resistance_ohm / growth(coil.temperature_C))


def growth(celsius: FloatArray | float) -> FloatArray | float:
    """Copper's resistance over that at 20 degC."""
    return 1.0 + COPPER_TEMPERATURE_COEFFICIENT * (celsius - REFERENCE_TEMPERATURE)


def winding_heat(coil: Coil, insulation: float) -> WindingHeat:
    """Follow a winding from its wire, or from its resistance where the wire is not known.

    With a share f of copper, k = k_i ((1 + f) k_c + (1 - f) k_i) / ((1 - f) k_c + (1 + f) k_i).
    """
    section = shapely.Polygon(coil.vertices_m)
    turn, cold = 2.0 * math.pi * section.centroid.x, cold_resistance(coil)
    wire = 0.25 * math.pi * coil.wire_diameter_m**2 if coil.wire_diameter_m is not None else None
    copper = coil.turns * (wire or COPPER_RESISTIVITY_20C * coil.turns * turn / cold)
    share = min(copper / section.area, DENSEST)
    metal = LORENZ_NUMBER * ROOM_K / COPPER_RESISTIVITY_20C
    across = insulation * ((1.0 + share) * metal + (1.0 - share) * insulation)
    across /= (1.0 - share) * metal + (1.0 + share) * insulation
    capacity = (share * METAL_CAPACITY + (1.0 - share) * FILLER_CAPACITY) * section.area * turn
    return WindingHeat(share, across, capacity, cold)


def stars(coil: Coil, conductivity: float) -> FloatArray:
    """Resistances in K/W, rows (to the lower face, to the upper, to the mean) of the radial and the axial star."""
    inner, low, outer, high = shapely.Polygon(coil.vertices_m).bounds
    height, square, ratio = high - low, outer**2 - inner**2, math.log(outer / inner)
    unit = 1.0 / (4.0 * math.pi * conductivity * height)
    bent = 2.0 * ratio / square
    radial = (
        unit * (outer**2 * bent - 1.0),
        unit * (1.0 - inner**2 * bent),
        -0.5 * unit * (outer**2 + inner**2 - 2.0 * outer**2 * inner**2 * bent) / square,
    )
    along = height / (2.0 * math.pi * conductivity * square)
    return np.array([radial, (along, along, -along / 3.0)])
