"""The choice of the solver by the actuator's materials, and the field of a drawing as a probe would read it."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from netgen.libngpy._meshing import NgException

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator
from femfit.field.currents import CurrentsLike, current_points, swept_currents, weakest
from femfit.field.layout import Layout, layout_of
from femfit.field.linear_point import LinearActuator
from femfit.field.tolerance import (
    LevelChoice,
    SolverSettings,
    ToleranceProblem,
    at_level,
    check_currents,
    meet_tolerance,
    settings_for,
)
from femfit.field.weak_form import flux_density

if TYPE_CHECKING:
    from femfit.field.nonlinear_point import NonlinearActuator

    FieldProblem = LinearActuator | NonlinearActuator | ToleranceProblem


def prepare(
    actuator: Actuator,
    group: tuple[float, ...],
    layout: Layout,
    settings: SolverSettings,
    choice: LevelChoice | None = None,
    currents: CurrentsLike | None = None,
) -> "FieldProblem":
    """Mesh an actuator for a group of ascending distances in m that share the mesh.

    Parameters
    ----------
    currents : array
        Those that alone are wanted, and at which the tolerance is met; all that are swept where None. Materials that do
        not saturate are solved for all of them at once.
    """
    saturates = actuator.saturates

    def build(of: SolverSettings, *, estimate: bool) -> "LinearActuator | NonlinearActuator":
        if not saturates:
            return LinearActuator(actuator, group, layout, of, estimate=estimate)
        from femfit.field.nonlinear_point import NonlinearActuator  # noqa: PLC0415  loads interpolation and sparse matrices

        return NonlinearActuator(actuator, group, layout, of, estimate=estimate)

    if settings.tolerance is None:
        return build(settings, estimate=True)
    level = partial(build, estimate=False)
    if choice is not None:
        return at_level(level, choice, settings)
    circuits = len(actuator.circuits)
    swept = current_points(swept_currents(actuator.sweep), circuits)
    ends = check_currents(swept) if saturates else swept
    if currents is None or not saturates:
        return meet_tolerance(level, group, swept, ends, settings)
    wanted = np.unique([*current_points(currents, circuits), swept[weakest(swept)]], axis=0)
    return meet_tolerance(level, group, wanted, wanted, settings, np.unique([*wanted, *ends], axis=0))


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
