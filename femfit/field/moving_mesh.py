"""One mesh that serves a group of distances, by a stretch along z.

Vertices of the moving part and its layer shift as one; what is above and the upper part of the gap below stretch
linearly, and the shift fades out with the radius. A mesh that changes smoothly makes errors that change smoothly: F(d)
has no remeshing jumps. The elements at the fixed parts' corners hold most of the energy's error and do not move, so
that it is the same at all distances: else it would show in d(flux linkage)/dd, which is often 1e-4 of the flux a mm.

A body that slides past fixed parts, as a plunger in a bore, shifts at the heights of its own edges, and fixed parts
stand still at those of theirs (:meth:`femfit.field.layout.Layout.stack`). Between the two there are vertical edges
alone, which a stretch leaves where they are: the plunger's middle is stretched, and is the same plunger.

The field is evaluated at quadrature points of a whole mesh, where a stretch along z changes what is seen. Coefficients
of w are mapped to (w, dw/dr, dw/dz) once, on the mesh at its reference. A stretch by s moves each vertex by s g along
z; with a = s dg/dr and b = 1 + s dg/dz

    dw/dr -> dw/dr - (a / b) dw/dz,    dw/dz -> dw/dz / b,    weight -> b weight,    r -> r,

so that a field needs no evaluation anew where the mesh is stretched.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, GridFunction, VectorH1, grad

from femfit.core.numerics import MU_0, FloatArray, IntArray
from femfit.device.parts import Actuator
from femfit.field.drawing import build_mesh, layer_outlines
from femfit.field.layout import Layout, layout_of_group
from femfit.field.material_points import QuadraturePoints
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import function_of, weight

STILL = 0.6  # of a gap, beside the fixed part
FADE = 8.0  # the stretch has faded out at this multiple of the actuator's radius


class MovingMesh:
    """A mesh made for a group of ascending distances in m, and moved to each of them.

    It moves about ``reference``. Where a body ``slides`` past others, that is the distance that it was last slid to:
    its parts and theirs are stretched, so that all that is integrated over them is of that distance alone.
    """

    def __init__(self, actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> None:
        shared, self.reference = len(group) > 1, group[0]
        moves = [span[2] for span in layout.stack(group[0])]
        self.slides = shared and moves != sorted(moves)  # else it is above all fixed parts with its layer
        self.layout = layout_of_group(actuator, group, layout, settings)
        if shared:  # the geometric mean of the gap that changes most
            first, last = (self.layout.gaps(distance) for distance in (group[0], group[-1]))
            k = int(np.argmax(np.abs(np.log(last / first))))
            share = (np.sqrt(first[k] * last[k]) - first[k]) / (last[k] - first[k])
            self.reference = float(group[0] + share * (group[-1] - group[0]))
        if self.slides:
            self.layout = replace(self.layout, nearest=self.reference)
        self.mesh = build_mesh(actuator, self.reference, self.layout, settings)
        self.mover_weight, self._refined = weight(self.mesh), bool(settings.skin_frequency_Hz)
        self._made, self._heights = self.reference, self._vertices[:, 1].copy()
        self._reference_heights = self._heights
        # Parts of a shift of the moving part that each vertex makes, shape (vertices,). The layer takes up a small one:
        # that moves no element at a corner of either part, where the energy of each part's own field is in error
        in_layer = self.mover_weight.vec.FV().NumPy()[: self.mesh.nv].copy()
        self._share = self._stretch(actuator) if shared else in_layer
        self.vertex_share = in_layer if self.slides else self._share

    @property
    def _vertices(self) -> FloatArray:
        """Radii and heights of the vertices, shape (vertices, 2); to be written, too."""
        return np.asarray(self.mesh.ngmesh.Coordinates())

    def _stretch(self, actuator: Actuator) -> FloatArray:
        """Part of a shift that each vertex makes: 1 at the moving edges and the layer, and 0 at fixed edges.

        Between these it rises along z, where vertical edges alone pass, and fades out around the actuator.
        """
        stack, far, knots = self.layout.stack(self.reference), FADE * self.layout.radius, list[tuple[float, float]]()
        if stack[0][2]:
            knots += [(-far, 0.0), (stack[0][0], 1.0)]
        for (_, low, moves), (high, _, moves_above) in pairwise(stack):
            if moves_above and not moves:
                knots += [(low + STILL * (high - low), 0.0), (high, 1.0)]
            elif moves and not moves_above:
                knots += [(low, 1.0), (high - STILL * (high - low), 0.0)]
        if stack[-1][2]:
            top = layer_outlines(actuator, self.layout)[1].bounds[3] + self.reference  # wider than the least offset
            knots += [(max(top, stack[-1][1]), 1.0), (far, 0.0)]
        radius, height = self._vertices.T
        across = np.interp(radius, [1.5 * self.layout.radius, far], [1.0, 0.0])
        return np.asarray(np.interp(height, *np.array(knots).T) * across)

    def slide_to(self, distance: float) -> None:
        """Move to a distance that becomes the reference."""
        self._reference_heights = self._heights + (distance - self._made) * self._share
        self.reference = distance
        self.move_to(distance)

    def move_to(self, distance: float) -> None:
        """Move to a distance, one near by where the mesh serves one alone or slides."""
        shift = (distance - self.reference) * self.vertex_share
        if self._refined:  # at skins: its elements are mapped from coarser ones, which do not follow their vertices
            # Kept alive while in use
            self._displacement = function_of(VectorH1(self.mesh, order=1), np.append(np.zeros_like(shift), shift))
            self.mesh.SetDeformation(self._displacement)
        else:
            self._vertices[:, 1] = self._reference_heights + shift
            self.mesh.ngmesh.Update()  # or places would be looked for where elements were

    @contextmanager
    def at(self, distance: float) -> Iterator[None]:
        """Moved to a distance within the context."""
        self.move_to(distance)
        try:
            yield
        finally:
            self.move_to(self.reference)


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
