"""One mesh that serves a group of distances, by a stretch of the air along z.

Vertices of the moving part and its layer shift as one; the air above and the upper part of the gap below stretch
linearly, and the shift fades out with the radius. A mesh that changes smoothly makes errors that change smoothly: F(d)
has no remeshing jumps. The elements at the fixed parts' corners hold most of the energy's error and do not move, so
that it is the same at all distances: else it would show in d(flux linkage)/dd, which is often 1e-4 of the flux a mm.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import ngsolve as ng
import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.field.drawing import build_mesh
from femfit.field.force import AROUND_FIXED, weight
from femfit.field.layout import Layout, layer_outlines, layout_of_group, reference_distance
from femfit.field.settings import SolverSettings

STILL = 0.6  # of the gap above the fixed parts
BISECTIONS = 40  # of the stretch; a step of rounding of it
FADE = 8.0  # the stretch has faded out at this multiple of the actuator's radius


@dataclass(frozen=True, eq=False)
class PointField:
    """A solution and what it was made for."""

    w: ng.GridFunction
    force: float  # On the moving part in N
    self_force: float  # The stress of the moving part's own field on this mesh, as subtracted from the force, in N


class MovingMesh:
    """A mesh made at the reference distance of a group of ascending distances in m, and stretched to the others."""

    def __init__(self, actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> None:
        self.layout = layout_of_group(actuator, group, layout, settings)
        self.reference = reference_distance(group, self.layout)
        self.mesh = build_mesh(actuator, self.reference, self.layout, settings)
        _, low, _, high = layer_outlines(actuator, self.layout)[1].bounds
        self._layer_heights = (low + self.reference, high + self.reference)
        self.reaction_weight = weight(self.mesh, AROUND_FIXED)
        self.work_weight = self.reaction_weight
        if self.layout.stretchable:
            self.work_weight = stretch_share(self.mesh, self.layout, self._layer_heights)

    @property
    def vertex_share(self) -> FloatArray:
        """Part of a small shift of the moving part that each vertex makes, shape (vertices,).

        The stretch's own, or all of it within the mover's layer: neither moves an element at a corner of either part,
        where the energy of each part's own field is in error.
        """
        share = self.work_weight if self.layout.stretchable else weight(self.mesh)
        return np.array(share.vec.FV().NumPy()[: self.mesh.nv])

    def move_to(self, distance: float) -> None:
        """Stretch to a distance; ``mesh.UnsetDeformation`` undoes it.

        Where the mesh serves one distance alone, that is for small steps, which the mover's layer takes up.
        """
        shift = distance - self.reference
        if shift:
            self._displacement = ng.GridFunction(ng.VectorH1(self.mesh, order=1))  # kept alive while in use
            along_z = self._displacement.components[1].vec.FV().NumPy()
            along_z[:] = shift * self.vertex_share
            self.mesh.SetDeformation(self._displacement)

    def unstretched(self, points: FloatArray, distance: float) -> FloatArray:
        """Where points (n, 2) in space lie on the mesh before it was stretched to a distance, by bisection."""
        shift = distance - self.reference
        if not shift:
            return points
        share = stretch_share(self.mesh, self.layout, self._layer_heights)
        radius, height = points[:, 0], points[:, 1]
        low, high = height - max(shift, 0.0), height - min(shift, 0.0)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            above = middle + shift * share(self.mesh(radius, middle))[:, 0] > height
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.column_stack([radius, 0.5 * (low + high)])

    @contextmanager
    def at(self, distance: float) -> Iterator[None]:
        """Stretched to a distance within the context."""
        self.move_to(distance)
        try:
            yield
        finally:
            self.mesh.UnsetDeformation()


def stretch_share(mesh: ng.Mesh, layout: Layout, layer_heights: tuple[float, float]) -> ng.GridFunction:
    """Share of the moving part's shift that each place of the mesh makes: 1 at the part, 0 at the fixed ones."""
    share = ng.GridFunction(ng.H1(mesh, order=1))
    points = np.array([vertex.point for vertex in mesh.vertices])
    share.vec.FV().NumPy()[:] = _profile(points, layout, layer_heights)
    return share


def _profile(points: FloatArray, layout: Layout, layer_heights: tuple[float, float]) -> FloatArray:
    """Share of the shift at points of shape (n, 2), between 0 and 1."""
    low, high = layer_heights
    far = FADE * layout.radius
    still = layout.fixed_top + STILL * (low - layout.fixed_top)
    along = np.interp(points[:, 1], [still, low, high, far], [0.0, 1.0, 1.0, 0.0])
    across = np.interp(points[:, 0], [1.5 * layout.radius, far], [1.0, 0.0])
    return np.asarray(along * across)
