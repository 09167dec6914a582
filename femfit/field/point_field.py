"""The field at one point of a sweep, for pictures."""

from dataclasses import dataclass

import ngsolve as ng


@dataclass(frozen=True, eq=False)
class PointField:
    """A solution and what it was made for.

    Parameters
    ----------
    force : float
        On the moving part in N.
    self_force : float
        The stress of the moving part's own field on this mesh, as subtracted from the force, in N.
    """

    w: ng.GridFunction
    force: float
    self_force: float
