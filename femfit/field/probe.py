"""The field of a drawing at places, as a probe would read it."""

from typing import Any

import numpy as np
from netgen.libngpy._meshing import NgException

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.device.parts import Actuator
from femfit.field.layout import layout_of
from femfit.field.problem import prepare
from femfit.field.settings import settings_for
from femfit.field.weak_form import flux_density


def axial_field(
    actuator: Actuator, distance: FloatArray, current: FloatArray, radius: FloatArray, height: FloatArray
) -> FloatArray:
    """Solve the drawing at every distance and current that occurs, and return B_z in T at the places.

    Parameters
    ----------
    distance, current, radius, height : array, shape (n,)
        In m and A; the radius of a scan across the axis may be negative.

    Raises
    ------
    DomainError
        If a place lies outside of the solved domain.
    """
    settings, result = settings_for(actuator), np.zeros(len(distance))
    layout = layout_of(actuator, settings)
    for d in np.unique(distance):
        currents = np.unique(current[distance == d])
        problem = prepare(actuator, (float(d),), layout, settings, currents=currents)
        for i in currents:
            here = np.flatnonzero((distance == d) & (current == i))
            density = flux_density(problem.field(float(d), float(i)).w)
            for k in here:
                result[k] = _at(density, problem.mesh, abs(float(radius[k])), float(height[k]))
    return result


def _at(density: Any, mesh: Any, radius: float, height: float) -> float:
    try:
        return float(density(mesh(radius, height))[1])
    except NgException as error:
        raise DomainError(
            f"A probe must lie within the solved domain; it is at r = {1e3 * radius:g} mm, z = {1e3 * height:g} mm. "
            "Check the unit of the places, and that z counts from the drawing's zero."
        ) from error
