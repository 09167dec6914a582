"""The force by Maxwell's stress tensor, weighted over a layer of air around the moving part.

With g = 1 on the moving part and 0 outside of the layer, F_z = -integral T_z . grad g 2 pi r with
T_z = (B_z B_r, B_z^2 - B^2 / 2) / mu_0: the average of the surface integral over all surfaces in the layer. F is a
quadratic form in w; its matrix lives in the layer alone, which moves as a rigid body, so that one matrix serves all
distances of a mesh.

The force is held against two others, by the reaction on the fixed parts and by virtual work. With the total field u + v
(u of the moving part's magnetisation alone, v of all the rest; :mod:`femfit.field.linear_system`) the force is the
mutual stress 2 T(u, v), weighted by any function g that is 1 on the moving part and 0 on the fixed ones. The stress of
either field with itself integrates to zero and is left out. On a mesh it does not: round the corners of a core it was
found up to fifty times the error of the mover's force, whose layer touches no corner. That is why the plain reaction is
the worse number, and no measure of the better one.

**Reaction.** g is harmonic in all air, down to the surfaces of the fixed parts.

**Virtual work.** Weighted by g, the stress is the derivative of the discrete co-energy as the mesh moves by g. With the
sweep's own stretch as g, 2 T(u, v) is the slope of the fields' mutual co-energy along the table's distances: what
differences of neighbouring rows would give, without their rounding, and without the slope of each field's own energy,
which is error. Where each distance has a mesh of its own, all air moves with the part as for the reaction.

Neither has its weight in the layer of the mover's force. All three share the error of the magnetisation, which only the
change between two orders measures; the disagreement says what is left beside it.

References
----------
F. Henrotte, G. Deliege and K. Hameyer, COMPEL 23 (2004) 496: the eggshell method, and virtual work as weighted stress;
J. L. Coulomb, IEEE Trans. Magn. 19 (1983) 2514: virtual work on a mesh; S. McFee, J. P. Webb and D. A. Lowther, IEEE
Trans. Magn. 24 (1988) 439: weight functions and their equality with virtual work.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, InnerProduct, Mesh, dx, grad

from femfit.core.numerics import MU_0, BoolArray, FloatArray
from femfit.field.layout import FIXED, MOVING
from femfit.field.weak_form import RADIAL_WEIGHT_ORDER, flux_density


@dataclass(frozen=True)
class Layer:
    """A layer of air with a body on its inner side."""

    region: str
    inner: str
    outer: str


AROUND_MOVER = Layer("layer", inner=f"halo|{MOVING}", outer=f"air|{FIXED}")
"""The mesh's own layer, which touches no corner: the force on the moving part."""

AROUND_FIXED = Layer("air", inner=f"halo|layer|{MOVING}", outer=FIXED)
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
        return float(InnerProduct(first.vec, self.image(second)))

    def image(self, function: GridFunction) -> Any:
        """The vector whose product with a solution is its bilinear force with this one."""
        image = function.vec.CreateVector()
        image.data = self._form.mat * function.vec
        return image


class OtherForces:
    """Reaction and virtual work of the sources' fields w and u, as they are when :meth:`evaluate` is called.

    The two are integrated for the products of the sources alone; to assemble their matrices at each distance would take
    four times as long. Both weights vary in the air outside of the mover's layer alone.
    """

    def __init__(
        self,
        total: Sequence[GridFunction],
        alone: Sequence[GridFunction],
        reaction_weight: GridFunction,
        work_weight: GridFunction,
    ) -> None:
        space = total[0].space
        self._mesh = space.mesh
        self._order = 2 * space.globalorder + 2  # B, B, r and the slope of a weight of order 2
        w, u = ([flux_density(function) for function in functions] for functions in (total, alone))
        v = [b - own_b for b, own_b in zip(w, u, strict=True)]
        slopes = grad(reaction_weight), grad(work_weight)
        terms = [2.0 * stress_density(b, c, slope) for slope in slopes for b in u for c in v]
        self._shape = (2, len(w), len(w))
        self._density = ng.CF(tuple(terms)).Compile()  # each field is evaluated once, not in every term

    def evaluate(self) -> tuple[FloatArray, FloatArray]:
        """The reaction and virtual work as quadratic forms in the sources, signed as the force."""
        air = self._mesh.Materials(AROUND_FIXED.region)
        terms = np.array(ng.Integrate(self._density, self._mesh, order=self._order, definedon=air)).reshape(self._shape)
        reaction, work = 0.5 * (terms + terms.swapaxes(1, 2))
        return reaction, work


def quadratic(form: LayerForce, functions: Sequence[GridFunction]) -> FloatArray:
    """The force of a sum of solutions as a quadratic form in their factors: symmetric, in N."""
    count = len(functions)
    matrix = np.zeros((count, count))
    for j in range(count):
        image = form.image(functions[j])
        for k in range(j + 1):
            matrix[j, k] = matrix[k, j] = InnerProduct(functions[k].vec, image)
    return matrix
