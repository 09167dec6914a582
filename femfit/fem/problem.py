"""The choice of the solver by the actuator's materials."""

from femfit.actuator.parts import Actuator, NonlinearMaterial
from femfit.fem.layout import Layout
from femfit.fem.linear_point import LinearActuator
from femfit.fem.nonlinear_point import NonlinearActuator
from femfit.fem.settings import SolverSettings
from femfit.fem.weak_form import materials

FieldProblem = LinearActuator | NonlinearActuator


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
        Order and element sizes.

    Returns
    -------
    LinearActuator or NonlinearActuator
        The latter if any part saturates.
    """
    saturates = any(isinstance(material, NonlinearMaterial) for material in materials(actuator).values())
    return (NonlinearActuator if saturates else LinearActuator)(actuator, group, layout, settings)
