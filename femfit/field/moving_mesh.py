"""One mesh that serves a group of distances, by a stretch of the air along z.

Vertices of the moving part and its layer shift as one; the air above and the upper part of the gap below stretch
linearly, and the shift fades out with the radius. A mesh that changes smoothly makes errors that change smoothly: F(d)
has no remeshing jumps. The elements at the fixed parts' corners hold most of the energy's error and do not move, so
that it is the same at all distances: else it would show in d(flux linkage)/dd, which is often 1e-4 of the flux a mm.

The field is evaluated at quadrature points of a whole mesh, where a stretch along z changes what is seen. Coefficients
of w are mapped to (w, dw/dr, dw/dz) once, on the mesh as it was made. A stretch by s moves each vertex by s g along z;
with a = s dg/dr and b = 1 + s dg/dz

    dw/dr -> dw/dr - (a / b) dw/dz,    dw/dz -> dw/dz / b,    weight -> b weight,    r -> r,

so that a field needs no evaluation anew where the mesh is stretched.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, GridFunction, grad

from femfit.core.numerics import MU_0, FloatArray, IntArray
from femfit.device.parts import Actuator
from femfit.field.drawing import build_mesh
from femfit.field.layout import Layout, layer_outlines, layout_of_group
from femfit.field.material_points import QuadraturePoints
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import function_of, weight

STILL = 0.6  # of the gap above the fixed parts
BISECTIONS = 40  # of the stretch; a step of rounding of it
FADE = 8.0  # the stretch has faded out at this multiple of the actuator's radius


class MovingMesh:
    """A mesh made at the reference distance of a group of ascending distances in m, and stretched to the others."""

    def __init__(self, actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> None:
        self.layout = layout_of_group(actuator, group, layout, settings)
        self.reference = group[0]
        if len(group) > 1:  # the geometric mean of the gaps
            offset, top = self.layout.outer_offset, self.layout.fixed_top
            low, high = (distance - offset - top for distance in (group[0], group[-1]))
            self.reference = float(np.sqrt(low * high)) + offset + top
        self.mesh = build_mesh(actuator, self.reference, self.layout, settings)
        _, low, _, high = layer_outlines(actuator, self.layout)[1].bounds
        self._layer_heights = (low + self.reference, high + self.reference)
        self.mover_weight = weight(self.mesh)

    @cached_property
    def vertex_share(self) -> FloatArray:
        """Part of a small shift of the moving part that each vertex makes, shape (vertices,).

        The stretch's own, or all of it within the mover's layer: neither moves an element at a corner of either part,
        where the energy of each part's own field is in error.
        """
        return np.array(self._share.vec.FV().NumPy()[: self.mesh.nv])

    @cached_property
    def _share(self) -> ng.GridFunction:
        """The share as a function on the mesh as it was made: 1 at the moving part, 0 at the fixed ones."""
        if not self.layout.stretchable:
            return self.mover_weight
        (low, high), far, top = self._layer_heights, FADE * self.layout.radius, self.layout.fixed_top
        points = np.array([vertex.point for vertex in self.mesh.vertices])
        along = np.interp(points[:, 1], [top + STILL * (low - top), low, high, far], [0.0, 1.0, 1.0, 0.0])
        across = np.interp(points[:, 0], [1.5 * self.layout.radius, far], [1.0, 0.0])
        return function_of(H1(self.mesh, order=1), along * across)

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
        radius, height = points[:, 0], points[:, 1]
        low, high = height - max(shift, 0.0), height - min(shift, 0.0)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            above = middle + shift * self._share(self.mesh(radius, middle))[:, 0] > height
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


class StretchedPoints:
    """Points of a mesh as it was made, with the slopes of the vertices' share in a stretch along z."""

    def __init__(self, radius: FloatArray, slopes: FloatArray) -> None:
        self.radius, self._slopes = radius, slopes

    def seen(self, fields: FloatArray, stretch: float) -> tuple[FloatArray, ...]:
        """(a / b, b, w, dw/dr, dw/dz, B) of fields (3 points, k) on the mesh as it was made, under a stretch in m.

        Each is of shape (points, k), a and b (points, 1), and (B_r, B_z) in T (2, points, k).
        """
        w, w_r, w_z = fields.reshape(3, -1, fields.shape[1])
        b = 1.0 + stretch * self._slopes[1][:, None]
        shear = stretch * self._slopes[0][:, None] / b
        w_r, w_z, r = w_r - shear * w_z, w_z / b, self.radius[:, None]
        return shear, b, w, w_r, w_z, np.stack([-r * w_z, 2.0 * w + r * w_r])


class FieldPoints(StretchedPoints):
    """The quadrature points of a whole mesh, the maps to them, and the vertices' hat functions there."""

    def __init__(self, space: H1, share: FloatArray) -> None:
        mesh = space.mesh
        points, names = QuadraturePoints(mesh, space.globalorder), mesh.GetMaterials()
        self.weight = points.weight
        self._map, hats = (
            points.map_of(unknowns, w, *grad(w))
            for unknowns, w in ((of, of.TrialFunction()) for of in (space, H1(mesh, order=1)))
        )
        self._transposed, self._hats = self._map.T.tocsr(), hats.T.tocsr()
        numbers = points.integrals(mesh.MaterialCF({name: float(k) for k, name in enumerate(names)})) / self.weight
        self._regions = np.array(names)[numbers.round().astype(np.int64)]
        super().__init__(points.integrals(ng.x) / self.weight, (share @ self._hats).reshape(3, -1)[1:])

    def of_region(self, name: str) -> IntArray:
        """The points of a region."""
        return np.flatnonzero(self._regions == name)

    def fields(self, states: FloatArray) -> FloatArray:
        """(w, dw/dr, dw/dz), one after the other, of states of shape (unknowns, k); shape (3 points, k)."""
        return np.asarray(self._map @ states)

    def nodal(self, values: FloatArray, in_r: FloatArray, in_z: FloatArray) -> FloatArray:
        """Sums over the points, each of shape (points, k), of values phi + in_r dphi/dr + in_z dphi/dz.

        One row a vertex, phi being its hat function; shape (vertices, k).
        """
        return np.asarray(self._hats @ np.concatenate([values, in_r, in_z]))

    def air_residual(self, fields: FloatArray, stretch: float) -> FloatArray:
        """The derivative of the air's energy, as if all were air, by the coefficients; shape (unknowns, k), in J.

        Where the stretch is a shift it does not change, so that differences between stretches are those of the air.
        """
        shear, b, *_, (b_r, b_z) = self.seen(fields, stretch)
        r, weight = self.radius[:, None], 2.0 * np.pi / MU_0 * (self.weight * self.radius)[:, None] * b
        along_r = weight * r * b_z
        return np.asarray(
            self._transposed @ np.concatenate([2.0 * weight * b_z, along_r, -weight * r * b_r / b - shear * along_r])
        )


class PlacedPoints(StretchedPoints):
    """Some places of a mesh, one at least, for a few states; B there counts with radii that may be others."""

    def __init__(self, space: H1, points: FloatArray, radius: FloatArray, share: FloatArray) -> None:
        self._function = GridFunction(space)
        self._places = space.mesh(points[:, 0], points[:, 1])
        self._density = ng.CF((self._function, *grad(self._function)))
        weight = function_of(H1(space.mesh, order=1), share)
        super().__init__(radius, np.array(grad(weight)(self._places)).T)

    def numbers_of(self, function: Any) -> FloatArray:
        """Values of a function at the places."""
        return np.array(function(self._places)).ravel()

    def fields(self, states: FloatArray) -> FloatArray:
        """As :meth:`FieldPoints.fields`."""
        columns = []
        for state in states.T:
            self._function.vec.FV().NumPy()[:] = state
            columns.append(np.array(self._density(self._places)).T.ravel())
        return np.stack(columns, axis=1)
