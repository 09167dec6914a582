r"""Patterns of induced currents as further, short-circuited windings, at every distance.

A pattern is a distribution of current that is fixed to the conducting parts; e_k times the k-th one flows. Each is
scaled to a resistance of 1 ohm and is orthogonal to the others in power, so that 0 = e_k + d(flux linkage_k)/dt. The
co-energy is a quadratic form in (1, i_1 .. i_n, e_1 .. e_q) and gives force, flux linkages and Hall field as for wound
circuits: Galerkin's method for the induced currents. Where parts saturate, the form is that of small currents about
the bias (:mod:`femfit.field.biased_system`).
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from ngsolve import H1

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.field.biased_system import BiasedSystem, static_system
from femfit.field.conductor_points import ConductorPoints
from femfit.field.force import weight
from femfit.field.linear_system import Coefficients
from femfit.field.moving_mesh import MovingMesh


class PatternFields:
    """Patterns of the rows (q, points) of :class:`ConductorPoints` of a mesh."""

    def __init__(self, actuator: Actuator, moving: MovingMesh, order: int, rows: FloatArray) -> None:
        self.moving, self.rows = moving, rows
        self._points = ConductorPoints(H1(moving.mesh, order=order), actuator, moving.reference)

    @cached_property
    def _fields(self) -> FloatArray:
        return self._points.fields(self.rows)

    def at(self, points: ConductorPoints) -> FloatArray:
        """The rows at the points of this mesh or of another one."""
        if points.space.mesh is self.moving.mesh:
            return self.rows
        return points.rows_of(self._fields, self._points.space, self.moving.reference)


class EddyActuator:
    """An actuator on a mesh, with patterns."""

    def __init__(self, actuator: Actuator, moving: MovingMesh, patterns: PatternFields, order: int) -> None:
        self._moving = moving

        def loads(space: H1) -> tuple[FloatArray, FloatArray]:
            points = ConductorPoints(space, actuator, moving.reference)
            rows = patterns.at(points)
            return points.loads(rows), points.loads(rows, moving=True)

        self._system = static_system(moving.mesh, actuator, moving.layout, weight(moving.mesh), order, loads)

    def forms(self, distance: float, bias: Sequence[float] = ()) -> Coefficients:
        """Forms in the sources 1, i_1 .. i_n, e_1 .. e_q at a distance of the mesh's group, about a bias in A."""
        if isinstance(self._system, BiasedSystem):
            self._system.bias = np.array(bias)
        with self._moving.at(distance):
            return self._system.evaluate()
