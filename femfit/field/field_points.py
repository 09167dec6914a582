r"""The field at quadrature points of a whole mesh, and how a stretch along z changes what is seen there.

Coefficients of w are mapped to (w, dw/dr, dw/dz) once, on the mesh as it was made. A stretch by s moves each vertex by
s g along z; with a = s dg/dr and b = 1 + s dg/dz

    dw/dr -> dw/dr - (a / b) dw/dz,    dw/dz -> dw/dz / b,    weight -> b weight,    r -> r,

so that a field needs no evaluation anew where the mesh is stretched.
"""

from collections.abc import Callable
from typing import Any, TypeAlias

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, LinearForm, dx, grad
from ngsolve.comp import IntegrationRuleSpace
from scipy import sparse

from femfit.core.arrays import FloatArray, IntArray
from femfit.core.constants import MU_0
from femfit.device.bh_curve import BHCurve
from femfit.device.parts import LinearMaterial, Material
from femfit.field.material_points import csr

Law: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""B (2, ..) in T -> H (2, ..) in A/m, and the integral of H dB in J/m^3, both with the remanence's part."""


class FieldPoints:
    """Points of a mesh as it was made, the maps to them, and the vertices' hat functions there."""

    def __init__(self, space: H1, share: FloatArray) -> None:
        mesh = space.mesh
        self._rule = IntegrationRuleSpace(mesh, order=space.globalorder)
        self._measure = dx(intrules=self._rule.GetIntegrationRules())
        self.weight = self._integrated(ng.CF(1.0))
        self.radius = self._integrated(ng.x) / self.weight
        self._map = self._to_points(space)
        self._transposed = self._map.T.tocsr()
        self._hats = self._to_points(H1(mesh, order=1)).T.tocsr()
        names = mesh.GetMaterials()
        numbers = self._integrated(mesh.MaterialCF({name: float(k) for k, name in enumerate(names)})) / self.weight
        self.region: tuple[str, ...] = tuple(names)
        self._region = numbers.round().astype(np.int64)
        _, in_r, in_z = self.split(share @ self._hats)
        self._stretch = in_r, in_z

    def of_region(self, name: str) -> IntArray:
        """The points of a region."""
        return np.flatnonzero(np.isin(self._region, [k for k, one in enumerate(self.region) if one == name]))

    def fields(self, states: FloatArray) -> FloatArray:
        """(w, dw/dr, dw/dz), one after the other, of states of shape (unknowns, k); shape (3 points, k)."""
        return np.asarray(self._map @ states)

    def split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The three of :meth:`fields`."""
        count = len(self.weight)
        return values[:count], values[count : 2 * count], values[2 * count :]

    def stretched(self, stretch: float) -> tuple[FloatArray, FloatArray]:
        """(a / b, b) at the points."""
        b = 1.0 + stretch * self._stretch[1]
        return stretch * self._stretch[0] / b, b

    def nodal(self, values: FloatArray, in_r: FloatArray, in_z: FloatArray) -> FloatArray:
        """Sums over the points, each of shape (points, k), of values phi + in_r dphi/dr + in_z dphi/dz.

        One row a vertex, phi being its hat function; shape (vertices, k).
        """
        return np.asarray(self._hats @ np.concatenate([values, in_r, in_z]))

    def air_residual(self, fields: FloatArray, stretch: float) -> FloatArray:
        """The derivative of the air's energy, as if all were air, by the coefficients; shape (unknowns, k), in J.

        Where the stretch is a shift it does not change, so that differences between stretches are those of the air.
        """
        w, w_r, w_z = self.split(fields)
        shear, b = (one[:, None] for one in self.stretched(stretch))
        r, weight = self.radius[:, None], 2.0 * np.pi / MU_0 * (self.weight * self.radius)[:, None] * b
        b_r, b_z = flux_density_of(r, w, w_r - shear * w_z, w_z / b)
        along_r = weight * r * b_z
        return np.asarray(
            self._transposed @ np.concatenate([2.0 * weight * b_z, along_r, -weight * r * b_r / b - shear * along_r])
        )

    def _integrated(self, function: Any) -> FloatArray:
        q = self._rule.TestFunction()
        return np.array(LinearForm(function * q * self._measure).Assemble().vec.FV().NumPy())

    def _to_points(self, space: H1) -> Any:
        w, q = space.TrialFunction(), self._rule.TestFunction()
        rows = []
        for one in (w, grad(w)[0], grad(w)[1]):
            form = BilinearForm(trialspace=space, testspace=self._rule)
            form += one * q * self._measure
            rows.append(sparse.diags(1.0 / self.weight) @ csr(form.Assemble().mat, space.ndof))
        return sparse.vstack(rows).tocsr()


class PlacedPoints:
    """(w, dw/dr, dw/dz) at some places of a mesh as it was made, for a few states."""

    def __init__(self, space: H1, points: FloatArray, share: FloatArray) -> None:
        self._function, mesh = GridFunction(space), space.mesh
        self._places = mesh(points[:, 0], points[:, 1]) if len(points) else None
        self._density = ng.CF((self._function, *grad(self._function)))
        weight = GridFunction(H1(mesh, order=1))
        weight.vec.FV().NumPy()[:] = share
        slopes = np.array(grad(weight)(self._places)) if len(points) else np.zeros((0, 2))
        self._stretch = slopes[:, 0], slopes[:, 1]

    def numbers_of(self, function: Any) -> FloatArray:
        """Values of a function at the places."""
        return np.zeros(0) if self._places is None else np.array(function(self._places)).ravel()

    def fields(self, states: FloatArray) -> FloatArray:
        """As :meth:`FieldPoints.fields`."""
        if self._places is None:
            return np.zeros((0, states.shape[1]))
        columns = []
        for state in states.T:
            self._function.vec.FV().NumPy()[:] = state
            columns.append(np.array(self._density(self._places)).T.ravel())
        return np.stack(columns, axis=1)

    def flux_density(self, fields: FloatArray, radius: FloatArray, stretch: float) -> FloatArray:
        """(B_r, B_z) of fields at the places; shape (2, n, k)."""
        w, w_r, w_z = fields.reshape(3, -1, fields.shape[1])
        shear, b = (stretch * slope[:, None] for slope in self._stretch)
        b = 1.0 + b
        return flux_density_of(radius[:, None], w, w_r - shear / b * w_z, w_z / b)


def flux_density_of(radius: FloatArray, w: FloatArray, w_r: FloatArray, w_z: FloatArray) -> FloatArray:
    """(B_r, B_z) in T, shape (2, ..)."""
    return np.stack([-radius * w_z, 2.0 * w + radius * w_r])


def law_of(material: Material) -> Law:
    """The law of a material."""
    if isinstance(material, LinearMaterial):
        nu, (r, z) = material.reluctivity, (material.remanence_T * one for one in material.direction)

        def linear(b: FloatArray) -> tuple[FloatArray, FloatArray]:
            h = nu * np.stack([b[0] - r, b[1] - z])
            return h, 0.5 * (b[0] * (h[0] - nu * r) + b[1] * (h[1] - nu * z))

        return linear
    curve = BHCurve(material.flux_density_T, material.field_A_per_m)

    def saturating(b: FloatArray) -> tuple[FloatArray, FloatArray]:
        size = np.hypot(*b)
        return curve.reluctivity(size) * b, curve.energy_density(size)

    return saturating


def in_air(b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The law of air."""
    h = b / MU_0
    return h, 0.5 * (b[0] * h[0] + b[1] * h[1])
