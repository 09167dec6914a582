"""The choice of the solver by the actuator's materials."""

from femfit.actuator.parts import Actuator, NonlinearMaterial
from femfit.fem.layout import Layout
from femfit.fem.linear_point import LinearActuator
from femfit.fem.nonlinear_point import NonlinearActuator
from femfit.fem.settings import SolverSettings
from femfit.fem.tolerance import ToleranceProblem, check_currents, meet_tolerance
from femfit.fem.weak_form import materials

FieldProblem = LinearActuator | NonlinearActuator | ToleranceProblem


def prepare(actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> FieldProblem:
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

    Returns
    -------
    LinearActuator, NonlinearActuator or ToleranceProblem
        The last if there is a tolerance; else the second if any part saturates.
    """
    saturates = any(isinstance(material, NonlinearMaterial) for material in materials(actuator).values())
    if settings.tolerance is not None:

        def build(rung: SolverSettings) -> LinearActuator | NonlinearActuator:
            if saturates:
                return NonlinearActuator(actuator, group, layout, rung)
            return LinearActuator(actuator, group, layout, rung, estimate=False)

        checked = check_currents(actuator.sweep.currents_A) if saturates else actuator.sweep.currents_A
        return meet_tolerance(build, group, checked, settings)
    return (NonlinearActuator if saturates else LinearActuator)(actuator, group, layout, settings)
