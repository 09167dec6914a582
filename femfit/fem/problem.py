"""The choice of the solver by the actuator's materials."""

from functools import partial
from typing import TYPE_CHECKING

from femfit.actuator.parts import Actuator, NonlinearMaterial
from femfit.fem.layout import Layout
from femfit.fem.linear_point import LinearActuator
from femfit.fem.settings import SolverSettings
from femfit.fem.tolerance import check_currents, meet_tolerance, on_rung
from femfit.fem.tolerance_problem import RungChoice, ToleranceProblem
from femfit.fem.weak_form import materials

if TYPE_CHECKING:
    from femfit.fem.nonlinear_point import NonlinearActuator

    FieldProblem = LinearActuator | NonlinearActuator | ToleranceProblem


def prepare(
    actuator: Actuator,
    group: tuple[float, ...],
    layout: Layout,
    settings: SolverSettings,
    choice: RungChoice | None = None,
) -> "FieldProblem":
    """Mesh an actuator for a group of distances.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    group : tuple of float
        Distances that share the mesh, in m, ascending.
    layout : Layout
        Of the whole sweep.
    settings : SolverSettings
        Order and element sizes, or the tolerance to meet.
    choice : RungChoice, optional
        How it is met, where the climb was made before.

    Returns
    -------
    LinearActuator, NonlinearActuator or ToleranceProblem
        The last if there is a tolerance; else the second if any part saturates.
    """
    saturates = any(isinstance(material, NonlinearMaterial) for material in materials(actuator).values())

    def build(of: SolverSettings, *, estimate: bool) -> "LinearActuator | NonlinearActuator":
        if not saturates:
            return LinearActuator(actuator, group, layout, of, estimate=estimate)
        from femfit.fem.nonlinear_point import NonlinearActuator  # noqa: PLC0415  loads interpolation and sparse matrices

        return NonlinearActuator(actuator, group, layout, of)

    if settings.tolerance is None:
        return build(settings, estimate=True)
    rung = partial(build, estimate=False)
    if choice is not None:
        return on_rung(rung, choice, settings)
    checked = check_currents(actuator.sweep.currents_A) if saturates else actuator.sweep.currents_A
    return meet_tolerance(rung, group, checked, settings)
