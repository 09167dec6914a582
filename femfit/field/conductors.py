r"""Eddy currents in the parts that conduct: their form, and where they crowd.

An electric field -r dw/dt along phi drives sigma r^2 dw/dt in a solid part, so that the field's equations are
K w + M dw/dt = sources with

    M = integral sigma r^2 w v 2 pi r            of solid parts,
    M = integral (sigma b^2 / 12) B(w) . B(v) 2 pi r   of stacks of sheets of the thickness b along B.

The second is the first term of homogenisation: no current crosses from sheet to sheet, and within a sheet B is taken as
even, which holds where b is not above the skin depth. Windings are of thin strands, without eddy currents of their own.

References
----------
R. L. Stoll, The Analysis of Eddy Currents (Clarendon, 1974), chapters 2 (skin depth) and 4 (sheets).
J. Gyselinck, L. Vandevelde, J. Melkebeek and P. Dular, IEEE Trans. Magn. 38 (2002) 1133: homogenised sheets.
"""

import math
from collections.abc import Mapping
from typing import Any

import ngsolve as ng
import shapely
from ngsolve import BilinearForm, InnerProduct, dx

from femfit.device.parts import Actuator, Material, Region
from femfit.device.skin import skin_depth
from femfit.field.outline import polygon
from femfit.field.weak_form import RADIAL_WEIGHT_ORDER, flux_density, materials

LAYER_DEPTHS = 2.0
"""Numerical: of the outermost layer of elements over the skin depth, at most."""

LAYER_FACTOR = 0.25
"""Numerical: of one layer's thickness over the next one's. At order 4 the impedances beside a plate, a rod and a ball
of steel are met to 0.08 % at any frequency; with 0.15 to 0.6 %, for a tenth fewer unknowns, since what lies below the
outermost layer is then one element of up to six skin depths."""

MOST_LAYERS = 6


def conductors(actuator: Actuator) -> dict[str, Material]:
    """Material of each of the mesh's region names that conducts."""
    return {name: one for name, one in materials(actuator).items() if one.conductivity_S_per_m}


def add_eddy_form(form: BilinearForm, named: Mapping[str, Material], factor: Any = 1.0) -> None:
    """Add M of the named conductors, times a factor, to a form that is not assembled yet."""
    w, v = form.space.TnT()
    for name, material in named.items():
        measure = dx(name, bonus_intorder=RADIAL_WEIGHT_ORDER)
        form += factor * _density(material, w, v) * 2.0 * math.pi * ng.x * measure


def _density(material: Material, w: Any, v: Any) -> Any:
    conductivity, sheet = material.conductivity_S_per_m, material.lamination_m
    if sheet:
        return conductivity * sheet**2 / 12.0 * InnerProduct(flux_density(w), flux_density(v))
    return conductivity * ng.x**2 * w * v


def skin_layers(region: Region, largest_element: float, frequency_Hz: float) -> int:
    """How often the elements at a part's surface are to be split so that the field's decay is resolved."""
    material = region.material
    if not material.conductivity_S_per_m or material.lamination_m or not frequency_Hz:
        return 0
    outline = polygon(region)
    element = min(largest_element, 2.0 * outline.area / shapely.length(outline))
    ratio = LAYER_DEPTHS * skin_depth(material, frequency_Hz) / element
    return min(MOST_LAYERS, max(0, math.ceil(math.log(ratio) / math.log(LAYER_FACTOR))))
