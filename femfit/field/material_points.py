r"""The material laws at the quadrature points of all parts that are not air.

B at the points is a fixed linear map of the unknowns, since parts move as rigid bodies: B = D w. With the points'
weights (2 pi r included) the energy is sum weight e(B), its derivative D^T weight H(B), and its second derivative
D^T weight nu_d D with the tensor nu_d = (H / B) 1 + (dH/dB - H / B) b b^T, b the direction of B.

References
----------
C. Pechstein and B. Juettler, J. Comput. Appl. Math. 196 (2006) 45, for nu_d.
"""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, InnerProduct, LinearForm, Mesh, dx
from ngsolve.comp import IntegrationRuleSpace
from scipy import sparse

from femfit.core.numerics import MU_0, BoolArray, FloatArray, IntArray
from femfit.device.materials import BHCurve
from femfit.device.parts import LinearMaterial, Material
from femfit.field.newton import inner
from femfit.field.weak_form import csr, flux_density

BEYOND_SHARE = 0.01

EXACT_TO_ODD = 4
"""From this order on rules are products of Gauss's with p + 1 points each, which are exact to 2 p + 1."""

TINY_FLUX_DENSITY = 1e-12
"""In T; below it the direction of B does not matter, for there H / B is dH/dB."""


Tensor: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Components rr, rz, zz of nu_d in m/H, each of shape (points)."""


NOWHERE = "-"
"""A pattern that no region's name has."""


class QuadraturePoints:
    """Points of a rule on some regions of a mesh, whose weights have a density: values there, and maps to them."""

    def __init__(self, mesh: Mesh, order: int, regions: str = ".*", density: Any = 1.0) -> None:
        self.space = IntegrationRuleSpace(mesh, order=order, definedon=mesh.Materials(regions))
        self.measure = dx(regions, intrules=self.space.GetIntegrationRules())
        self._density = density
        self.weight = self.integrals(ng.CF(1.0))

    def integrals(self, function: Any) -> FloatArray:
        """What each point contributes to the integral of a function, shape (points,)."""
        form = LinearForm(function * self.space.TestFunction() * self._density * self.measure)
        return np.array(form.Assemble().vec.FV().NumPy())

    def values(self, function: Any) -> FloatArray:
        """A function at the points, shape (points,)."""
        interpolated = GridFunction(self.space)
        interpolated.Interpolate(function)
        return np.array(interpolated.vec.FV().NumPy())

    def map_of(self, space: H1, *components: Any) -> Any:
        """The map of a space's unknowns to components of its trial function, sparse, (components points, unknowns)."""
        rows = []
        for component in components:
            form = BilinearForm(trialspace=space, testspace=self.space)
            form += component * self.space.TestFunction() * self._density * self.measure
            rows.append(sparse.diags(1.0 / self.weight) @ csr(form.Assemble().mat, space.ndof))
        return sparse.vstack(rows).tocsr()


class Medium:
    """A material's law, with its remanence; sigma where it is solid, and sigma b^2 / 12 where it is of sheets."""

    def __init__(self, material: Material) -> None:
        self.curve, self.reluctivity, self.coercive = None, 0.0, np.zeros(2)
        if isinstance(material, LinearMaterial):
            self.reluctivity = material.reluctivity
            self.coercive = material.reluctivity * material.remanence_T * np.array(material.direction)  # nu B_r
        else:
            self.curve = BHCurve(material.flux_density_T, material.field_A_per_m)
            self.last_T = material.flux_density_T[-1]  # Of the curve's points
        sigma, sheet = material.conductivity_S_per_m, material.lamination_m
        self._solid, self._sheets = 0.0 if sheet else sigma, sigma * sheet**2 / 12.0

    def respond(self, b: FloatArray, rw: FloatArray, s: complex) -> tuple[Any, Any, Any]:
        """H in A/m, u in J/m^3 and what ring currents add to it, at s, where B is b (2, ..) and r w is rw."""
        if self.curve is not None:
            size = np.hypot(*b)
            h, u = self.curve.reluctivity(size) * b, self.curve.energy_density(size)
        else:
            h, (r, z) = self.reluctivity * b, self.coercive
            u = 0.5 * (b[0] * h[0] + b[1] * h[1])
            if r or z:
                h, u = np.stack([h[0] - r, h[1] - z]), u - r * b[0] - z * b[1]
        if not s:
            return h, u, 0.0
        h, u = h + s * self._sheets * b, u + 0.5 * s * self._sheets * (b * b).sum(axis=0)
        return h, u, 0.5 * s * self._solid * rw**2


class MaterialPoints:
    """Points and laws of an actuator's parts on one mesh and space."""

    def __init__(self, space: H1, named: Mapping[str, Material]) -> None:
        self.space = space
        self.regions = "|".join(named) or NOWHERE
        # B is of the space's order p and r multiplies B squared: the rule has to be exact to 2 p + 1.
        rule = space.globalorder + (space.globalorder < EXACT_TO_ODD)
        self._points = QuadraturePoints(space.mesh, rule, self.regions, 2.0 * math.pi * ng.x)
        self.weight = self._points.weight
        b = flux_density(space.TrialFunction())
        self._to_flux_density = self._points.map_of(space, b[0], b[1])
        self._to_load = self._to_flux_density.T.tocsr()
        self._curves: list[tuple[IntArray, BHCurve, float]] = []  # With the last point's flux density
        self._reluctivity = np.zeros(len(self.weight))
        self.coercive_field = np.zeros((2, len(self.weight)))
        for name, material in named.items():
            points = np.flatnonzero(self._named_points(name))
            medium = Medium(material)
            self._reluctivity[points] = medium.reluctivity
            self.coercive_field[:, points] = medium.coercive[:, None]
            if medium.curve is not None:
                self._curves.append((points, medium.curve, medium.last_T))
        self.saturates = bool(self._curves)
        self.moving = self._named_points("moving:.*")
        self._tensor = tuple(GridFunction(self._points.space) for _ in range(3))
        self.tangent_form = self.tangent_on(space)
        self.set_tangent(np.zeros_like(self.coercive_field))

    def flux_density(self, state: FloatArray) -> FloatArray:
        """(B_r, B_z) in T, shape (2, points), of a state of the unknowns."""
        return np.asarray((self._to_flux_density @ state).reshape(2, -1))

    def respond(self, b: FloatArray) -> tuple[FloatArray, float]:
        """H in A/m, shape (2, points), and the integral of H dB from 0 in J, both without the remanence's part."""
        size = np.hypot(*b)
        reluctivity = self._reluctivity.copy()
        density = 0.5 * reluctivity * size**2
        for points, curve, _ in self._curves:
            reluctivity[points] = curve.reluctivity(size[points])
            density[points] = curve.energy_density(size[points])
        return reluctivity * b, inner(self.weight, density)

    def magnetisation(self, b: FloatArray) -> FloatArray:
        """M = B / mu_0 - H in A/m, permanent and induced, at B of shape (2, points)."""
        return b / MU_0 - self.respond(b)[0] + self.coercive_field

    def beyond_curve(self, b: FloatArray) -> bool:
        """Whether B exceeds a curve's last point in more than a hundredth of the volume that has the curve.

        At corners B has no bound, so single points say nothing.
        """
        size = np.hypot(*b)
        return any(
            self.weight[points] @ (size[points] > last) > BEYOND_SHARE * self.weight[points].sum()
            for points, _, last in self._curves
        )

    def load(self, h: FloatArray) -> FloatArray:
        """The integral of h . B(v) over the parts, for all test functions v: the derivative of the energy for h = H."""
        return np.asarray(self._to_load @ (self.weight * h).ravel())

    def tensor(self, b: FloatArray) -> Tensor:
        """The tensor nu_d at B of shape (2, points)."""
        size = np.hypot(*b)
        along, across = self._reluctivity.copy(), self._reluctivity.copy()
        for points, curve, _ in self._curves:
            along[points] = curve.differential_reluctivity(size[points])
            across[points] = curve.reluctivity(size[points])
        r, z = b / np.maximum(size, TINY_FLUX_DENSITY)
        extra = along - across
        return across + extra * r * r, extra * r * z, across + extra * z * z

    def set_tangent(self, b: FloatArray) -> None:
        """Assemble the second derivative of the energy at B of shape (2, points) into ``tangent_form``."""
        for function, values in zip(self._tensor, self.tensor(b), strict=True):
            function.vec.FV().NumPy()[:] = values
        self.tangent_form.Assemble()

    def _named_points(self, pattern: str) -> BoolArray:
        return self._points.values(self.space.mesh.MaterialCF({pattern: 1.0}, default=0.0)) > 0.5

    def tangent_on(self, space: H1) -> BilinearForm:
        """The form of ``tangent_form`` on a space of the same mesh, real or complex; not assembled."""
        w, v = space.TnT()
        b, c = flux_density(w), flux_density(v)
        rr, rz, zz = self._tensor
        form = BilinearForm(space, symmetric=True, condense=True)
        h = ng.CF((rr * b[0] + rz * b[1], rz * b[0] + zz * b[1]))
        form += InnerProduct(h, c) * 2.0 * math.pi * ng.x * self._points.measure
        return form
