"""One point of a sweep, solved for its pictures."""

from dataclasses import dataclass
from typing import Any

from femfit.device.parts import Actuator
from femfit.field.layout import layout_of
from femfit.field.problem import prepare
from femfit.field.settings import SolverSettings, settings_for


@dataclass(frozen=True, eq=False)
class SolvedPoint:
    """A solution with its mesh.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Made at this very distance, so that it is not stretched and points are found where they are.
    w : ngsolve.GridFunction
        A_phi = r w in T m.
    self_force_N : float
        What the stress of the moving part's own field integrates to on this mesh, taken away from the force.
    """

    actuator: Actuator
    distance_m: float
    current_A: float
    mesh: Any
    w: Any
    force_N: float
    self_force_N: float
    unknowns: int


def solve_point(
    actuator: Actuator, distance: float, current: float, settings: SolverSettings | None = None
) -> SolvedPoint:
    """Solve at one point.

    Parameters
    ----------
    settings : SolverSettings, optional
        As those of the sweep; the actuator's own otherwise.
    """
    settings = settings or settings_for(actuator)
    problem = prepare(actuator, (distance,), layout_of(actuator, settings), settings)
    field = problem.field(distance, current)
    return SolvedPoint(
        actuator=actuator,
        distance_m=distance,
        current_A=current,
        mesh=problem.mesh,
        w=field.w,
        force_N=field.force,
        self_force_N=field.self_force,
        unknowns=problem.unknowns,
    )
