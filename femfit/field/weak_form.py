r"""The axisymmetric magnetostatic problem in its weak form.

With A_phi = r w(r, z), w smooth and even in r, the flux density is B_r = -r dw/dz, B_z = 2 w + r dw/dr. Find w with

    integral nu B(w) . B(v) 2 pi r  +  boundary  =  integral nu B_rem . B(v) 2 pi r  +  integral J r v 2 pi r

for all v, B_rem along any direction in (r, z): no 1/r anywhere and no condition on the axis. The boundary, a sphere of
radius R, carries the energy of the field outside of it for a dipole, (nu_0 / R) r^2 w v 2 pi r, which is exact for the
leading term of any closed source.

The force by Maxwell's stress tensor, weighted over a layer of air around the moving part.

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
K. Meeker, FEMM 4.2 manual, section A.3 (asymptotic boundary); J. Gopalakrishnan and S. Reitzinger, Numer. Linear
Algebra Appl. 16 (2009), for unknowns A/r in axisymmetric spaces.
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
import shapely
from ngsolve import CF, H1, BilinearForm, GridFunction, InnerProduct, LinearForm, Mesh, ds, dx, grad

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import MU_0, BoolArray, FloatArray
from femfit.device.electrics import HallElement
from femfit.device.parts import Actuator, Coil, LinearMaterial, Material, NonlinearMaterial
from femfit.field.layout import FIXED, MOVING, coil_region

RADIAL_WEIGHT_ORDER = 3  # r^3 at most multiplies the polynomials; added to the quadrature's order


def flux_density(w: Any) -> Any:
    """(B_r, B_z) of w."""
    r = ng.x
    slope = grad(w)
    return CF((-r * slope[1], 2.0 * w + r * slope[0]))


def function_of(space: H1, coefficients: FloatArray) -> GridFunction:
    """The function of a space that has these coefficients, shape (unknowns,)."""
    function = GridFunction(space)
    function.vec.FV().NumPy()[:] = coefficients
    return function


def hall_field(hall: HallElement, mesh: Mesh, w: GridFunction) -> float:
    """The component of B in T that a Hall element measures."""
    b = flux_density(w)(mesh(hall.radius_m, hall.height_m))
    return float(hall.direction[0] * b[0] + hall.direction[1] * b[1])


def materials(actuator: Actuator) -> dict[str, Material]:
    """Material of each of the mesh's region names that is not air."""
    named = {f"fixed:{region.name}": region.material for region in actuator.fixed}
    return named | {f"moving:{region.name}": region.material for region in actuator.moving.regions}


def linear_materials(actuator: Actuator) -> dict[str, LinearMaterial]:
    """The same for an actuator without saturating parts."""
    linear: dict[str, LinearMaterial] = {}
    for name, material in materials(actuator).items():
        if isinstance(material, NonlinearMaterial):
            raise FieldSolverError(f"{name} is of {material.name}, which saturates. Use the nonlinear solver for it.")
        linear[name] = material
    return linear


def stiffness(
    space: H1, reluctivity: Any, outer_radius: float | None, *, regions: str = ".*", condense: bool = True
) -> BilinearForm:
    """The energy form for nu in m/H, with an open boundary of radius R in m; None leaves the boundary out."""
    w, v = space.TnT()
    r = ng.x
    form = BilinearForm(space, symmetric=condense, condense=condense)
    volume = dx(regions, bonus_intorder=RADIAL_WEIGHT_ORDER)
    form += reluctivity * InnerProduct(flux_density(w), flux_density(v)) * 2.0 * math.pi * r * volume
    if outer_radius is not None:
        boundary = ds("outer", bonus_intorder=RADIAL_WEIGHT_ORDER)
        form += r**2 * w * v * 2.0 * math.pi * r / (MU_0 * outer_radius) * boundary
    return form


def source_loads(space: H1, actuator: Actuator, *, moving: bool = False) -> FloatArray:
    """The right-hand sides of the magnets and of 1 A in each circuit, or of what of them moves.

    Returns
    -------
    array, shape (1 + circuits, unknowns)
        The product of a circuit's row with a solution is that solution's flux linkage.
    """
    loads = [_magnet_load(space, actuator, "moving:" if moving else "")]
    coils = [(coil, _coil_load(space, coil)) for coil in actuator.coils if coil.moves or not moving]
    for circuit in actuator.circuits:
        signed = [coil.sign * load for coil, load in coils if coil.circuit == circuit.name]
        loads.append(np.sum(signed, axis=0) if signed else np.zeros(space.ndof))
    return np.array(loads)


def _magnet_load(space: H1, actuator: Actuator, prefix: str) -> FloatArray:
    v = space.TestFunction()
    form = LinearForm(space)
    for name, material in materials(actuator).items():
        if material.remanence_T and isinstance(material, LinearMaterial) and name.startswith(prefix):
            source = material.reluctivity * material.remanence_T
            along = InnerProduct(CF(material.direction), flux_density(v))
            form += source * along * 2.0 * math.pi * ng.x * dx(name, bonus_intorder=RADIAL_WEIGHT_ORDER)
    return np.array(form.Assemble().vec.FV().NumPy())


def _coil_load(space: H1, coil: Coil) -> FloatArray:
    v = space.TestFunction()
    r = ng.x
    density = coil.turns / shapely.Polygon(coil.vertices_m).area
    form = LinearForm(space)
    form += density * r * v * 2.0 * math.pi * r * dx(coil_region(coil), bonus_intorder=RADIAL_WEIGHT_ORDER)
    return np.array(form.Assemble().vec.FV().NumPy())


def reluctivity(mesh: Mesh, named: dict[str, LinearMaterial]) -> Any:
    """Nu on the mesh: of the named materials, of air elsewhere."""
    return mesh.MaterialCF({name: material.reluctivity for name, material in named.items()}, default=1.0 / MU_0)


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
