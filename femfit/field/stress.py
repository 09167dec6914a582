"""The force by Maxwell's stress tensor, weighted over a layer of air around the moving part.

With g = 1 on the moving part and 0 outside of the layer, F_z = -integral T_z . grad g 2 pi r with
T_z = (B_z B_r, B_z^2 - B^2 / 2) / mu_0: the average of the surface integral over all surfaces in the layer. F is a
quadratic form in w; its matrix lives in the layer alone, which moves as a rigid body, so that one matrix serves all
distances of a mesh.

References
----------
F. Henrotte, G. Deliege and K. Hameyer, COMPEL 23 (2004) 496: the eggshell method; S. McFee, J. P. Webb and
D. A. Lowther, IEEE Trans. Magn. 24 (1988) 439: weight functions and their equality with virtual work.
"""

import math
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, InnerProduct, Mesh, dx, grad

from femfit.core.arrays import BoolArray
from femfit.core.constants import MU_0
from femfit.field.weak_form import RADIAL_WEIGHT_ORDER, flux_density


@dataclass(frozen=True)
class Layer:
    """A layer of air with a body on its inner side."""

    region: str
    inner: str
    outer: str


AROUND_MOVER = Layer("layer", inner="halo|moving:.*", outer="air|coil|fixed:.*")
"""The mesh's own layer, which touches no corner: the force on the moving part."""

AROUND_FIXED = Layer("air", inner="halo|layer|moving:.*", outer="coil|fixed:.*")
"""All air between the moving part's layer and the fixed parts: the reaction on the fixed parts, with the sign of the
force on the moving one."""


def weight(mesh: Mesh, layer: Layer = AROUND_MOVER) -> GridFunction:
    """The weight g: 1 up to the layer's inner outline, 0 from its outer outline on, harmonic between."""
    space = H1(mesh, order=2)
    g = GridFunction(space)
    inner = _dofs(space, mesh.Materials(layer.inner))
    outer = _dofs(space, mesh.Materials(layer.outer)) | _dofs(space, mesh.Boundaries("outer"))
    vertices = np.arange(space.ndof) < mesh.nv
    g.vec.FV().NumPy()[:] = inner & vertices
    free = ng.BitArray((_dofs(space, mesh.Materials(layer.region)) & ~inner & ~outer).tolist())
    u, v = space.TnT()
    laplace = BilinearForm(grad(u) * grad(v) * dx(layer.region)).Assemble()
    residual = laplace.mat.CreateColVector()
    residual.data = -laplace.mat * g.vec
    g.vec.data += laplace.mat.Inverse(free, inverse="sparsecholesky") * residual
    return g


def _dofs(space: H1, region: ng.Region) -> BoolArray:
    return np.array(list(space.GetDofs(region)), dtype=np.bool_)


def stress_density(b: Any, c: Any, slope: Any) -> Any:
    """The weighted stress of two flux densities, bilinear and symmetric, in N/m^2, positive towards the electromagnet.

    Its integral over (r, z) is the force; ``slope`` is the gradient of the weight in 1/m.
    """
    radial = 0.5 * (b[0] * c[1] + b[1] * c[0])
    axial = 0.5 * (b[1] * c[1] - b[0] * c[0])
    return (slope[0] * radial + slope[1] * axial) / MU_0 * 2.0 * math.pi * ng.x


class LayerForce:
    """The force as a quadratic form of solutions on one mesh."""

    def __init__(self, space: H1, g: GridFunction, layer: Layer = AROUND_MOVER) -> None:
        w, v = space.TnT()
        form = BilinearForm(space, symmetric=True)
        region = dx(layer.region, bonus_intorder=RADIAL_WEIGHT_ORDER + 1)
        form += stress_density(flux_density(w), flux_density(v), grad(g)) * region
        self._form = form.Assemble()

    def between(self, first: GridFunction, second: GridFunction) -> float:
        """The bilinear force of two solutions w in N: that of their sum is f(1, 1) + 2 f(1, 2) + f(2, 2)."""
        image = first.vec.CreateVector()
        image.data = self._form.mat * second.vec
        return float(InnerProduct(first.vec, image))
