"""The field of a drawing at places, as a probe would read it."""

from collections.abc import Callable
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

AxialField = Callable[[FloatArray, FloatArray], FloatArray]
"""Radii and heights of readings in m, shapes (n,) each -> B_z in T there; a radius across the axis may be negative."""


def axial_field(actuator: Actuator, distance: FloatArray, current: FloatArray) -> AxialField:
    """Solve the drawing at every distance and current that occurs, once for all places.

    Parameters
    ----------
    distance, current : array, shape (n,)
        Of each reading, in m and A.

    Raises
    ------
    DomainError
        If a place lies outside of the solved domain, once the field is evaluated there.
    """
    settings = settings_for(actuator)
    layout, solved = layout_of(actuator, settings), []
    for d in np.unique(distance):
        currents = np.unique(current[distance == d])
        problem = prepare(actuator, (float(d),), layout, settings, currents=currents)
        for i in currents:
            here = np.flatnonzero((distance == d) & (current == i))
            solved.append((here, problem.mesh, flux_density(problem.field(float(d), float(i)).w)))

    def evaluate(radius: FloatArray, height: FloatArray) -> FloatArray:
        result = np.zeros(len(distance))
        for here, mesh, density in solved:
            for k in here:
                result[k] = _at(density, mesh, abs(float(radius[k])), float(height[k]))
        return result

    return evaluate


def _at(density: Any, mesh: Any, radius: float, height: float) -> float:
    try:
        return float(density(mesh(radius, height))[1])
    except NgException as error:
        raise DomainError(
            f"A probe must lie within the solved domain; it is at r = {1e3 * radius:g} mm, z = {1e3 * height:g} mm. "
            "Check the unit of the places, and that z counts from the drawing's zero."
        ) from error
