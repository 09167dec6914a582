"""The choice of the solver by the actuator's materials."""

from functools import partial
from typing import TYPE_CHECKING

from femfit.device.parts import Actuator
from femfit.field.currents import current_points, swept_currents
from femfit.field.layout import Layout
from femfit.field.linear_point import LinearActuator
from femfit.field.settings import SolverSettings
from femfit.field.tolerance import LevelChoice, ToleranceProblem, at_level, check_currents, meet_tolerance

if TYPE_CHECKING:
    from femfit.field.nonlinear_point import NonlinearActuator

    FieldProblem = LinearActuator | NonlinearActuator | ToleranceProblem


def prepare(
    actuator: Actuator,
    group: tuple[float, ...],
    layout: Layout,
    settings: SolverSettings,
    choice: LevelChoice | None = None,
) -> "FieldProblem":
    """Mesh an actuator for a group of ascending distances in m that share the mesh."""
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
    points = current_points(swept_currents(actuator.sweep), len(actuator.circuits))
    return meet_tolerance(level, group, points, check_currents(points) if saturates else points, settings)
