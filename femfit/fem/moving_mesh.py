"""One mesh that serves a group of distances."""

from collections.abc import Iterator
from contextlib import contextmanager

from femfit.actuator.parts import Actuator
from femfit.fem.drawing import build_mesh
from femfit.fem.layout import Layout, layout_of_group, mover_outline, reference_distance
from femfit.fem.motion import stretch
from femfit.fem.settings import SolverSettings


class MovingMesh:
    """A mesh made at the group's reference distance and stretched to others.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    group : tuple of float
        Distances that share the mesh, in m, ascending.
    layout : Layout
        Of the whole sweep.
    settings : SolverSettings
        Element sizes.
    """

    def __init__(self, actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> None:
        self.layout = layout_of_group(actuator, group, layout, settings)
        self.reference = reference_distance(group, self.layout)
        self.mesh = build_mesh(actuator, self.reference, self.layout, settings)
        r0, z0, r1, z1 = mover_outline(actuator).bounds
        self._mover_bounds = (r0, z0 + self.reference, r1, z1 + self.reference)

    def move_to(self, distance: float) -> None:
        """Stretch to a distance; ``mesh.UnsetDeformation`` undoes it."""
        shift = distance - self.reference
        if shift:
            self._displacement = stretch(self.mesh, self.layout, self._mover_bounds, shift)  # kept alive while in use
            self.mesh.SetDeformation(self._displacement)

    @contextmanager
    def at(self, distance: float) -> Iterator[None]:
        """Stretched to a distance within the context."""
        self.move_to(distance)
        try:
            yield
        finally:
            self.mesh.UnsetDeformation()
