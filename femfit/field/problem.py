"""The choice of the solver by the actuator's materials."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from femfit.device.parts import Actuator
from femfit.field.currents import CurrentsLike, current_points, swept_currents, weakest
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
