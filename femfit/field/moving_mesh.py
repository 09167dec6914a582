"""One mesh that serves a group of distances."""

from collections.abc import Iterator
from contextlib import contextmanager

from femfit.device.parts import Actuator
from femfit.field.drawing import build_mesh
from femfit.field.layout import Layout, layer_outlines, layout_of_group, reference_distance
from femfit.field.motion import stretch, stretch_share
from femfit.field.settings import SolverSettings
from femfit.field.stress import AROUND_FIXED, weight


class MovingMesh:
    """A mesh made at the group's reference distance and stretched to others.

    Parameters
    ----------
    group : tuple of float
        Distances that share the mesh, in m, ascending.
    """

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

    def move_to(self, distance: float) -> None:
        """Stretch to a distance; ``mesh.UnsetDeformation`` undoes it."""
        shift = distance - self.reference
        if shift:
            self._displacement = stretch(self.mesh, self.layout, self._layer_heights, shift)  # kept alive while in use
            self.mesh.SetDeformation(self._displacement)

    @contextmanager
    def at(self, distance: float) -> Iterator[None]:
        """Stretched to a distance within the context."""
        self.move_to(distance)
        try:
            yield
        finally:
            self.mesh.UnsetDeformation()
