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

The force of the moving part's own field integrates to zero, but not on a mesh: it is subtracted
(:mod:`femfit.field.source_fields`).

References
----------
K. Meeker, FEMM 4.2 manual, section A.3 (asymptotic boundary); J. Gopalakrishnan and S. Reitzinger, Numer. Linear
Algebra Appl. 16 (2009), for unknowns A/r in axisymmetric spaces.
F. Henrotte, G. Deliege and K. Hameyer, COMPEL 23 (2004) 496: the eggshell method.
"""

import math
from typing import Any

import ngsolve as ng
import numpy as np
import shapely
from ngsolve import CF, H1, BilinearForm, GridFunction, InnerProduct, LinearForm, Mesh, ds, dx, grad
from numpy.typing import NDArray
from scipy import sparse

from femfit.core.numerics import MU_0, BoolArray, FloatArray
from femfit.device.electrics import HallElement
from femfit.device.parts import Actuator, Material, Region
from femfit.field.layout import FIXED, MOVING, coil_region, parts_of

LAYER = "layer"
"""The region of the mesh's own layer round the moving part, which touches no corner."""

RADIAL_WEIGHT_ORDER = 3  # r^3 at most multiplies the polynomials; added to the quadrature's order


FieldArray = NDArray[Any]
"""Coefficients of fields, complex where eddy currents flow at a frequency."""


def csr(matrix: Any, columns: int) -> Any:
    """A copy of an NGSolve matrix for scipy."""
    values, indices, starts = (np.array(array) for array in matrix.CSR())
    return sparse.csr_matrix((values, indices.astype(np.int32), starts.astype(np.int32)), (len(starts) - 1, columns))


def inner_products(first: FieldArray, second: FieldArray) -> FieldArray:
    """Of each row (j, unknowns) with each (k, unknowns), shape (j, k); in one thread, as :func:`newton.inner`."""
    return np.asarray(np.einsum("jn,kn->jk", first, second))


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


def hall_fields(hall: HallElement, space: H1, fields: FieldArray) -> FieldArray:
    """The component of B in T that a Hall element measures of each field (k, unknowns) of a real space."""
    if np.iscomplexobj(fields):
        return hall_fields(hall, space, fields.real) + 1j * hall_fields(hall, space, fields.imag)
    place = space.mesh(hall.radius_m, hall.height_m)
    b = [flux_density(function_of(space, field))(place) for field in fields]
    return np.array(b).reshape(-1, 2) @ np.array(hall.direction)


def materials(actuator: Actuator) -> dict[str, Material]:
    """Material of each of the mesh's region names that is not air."""
    return {name: part.material for name, part in parts_of(actuator).items() if isinstance(part, Region)}


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
    """The right-hand sides of 1 A in each circuit, or in its moving coils alone.

    Returns
    -------
    array, shape (circuits, unknowns)
        The product of a circuit's row with a solution is that solution's flux linkage.
    """
    v, r = space.TestFunction(), ng.x
    forms = {circuit.name: LinearForm(space) for circuit in actuator.circuits}
    for coil in (coil for coil in actuator.coils if coil.moves or not moving):
        density = coil.sign * coil.turns / shapely.Polygon(coil.vertices_m).area
        over = dx(coil_region(coil), bonus_intorder=RADIAL_WEIGHT_ORDER)
        forms[coil.circuit] += density * r * v * 2.0 * math.pi * r * over
    return np.array([form.Assemble().vec.FV().NumPy() for form in forms.values()]).reshape(-1, space.ndof)


def weight(mesh: Mesh) -> GridFunction:
    """The weight g: 1 up to the layer's inner outline, 0 from its outer outline on, harmonic between."""
    space = H1(mesh, order=2)
    g = GridFunction(space)
    inner = _dofs(space, mesh.Materials(f"halo|{MOVING}"))
    outer = _dofs(space, mesh.Materials(f"air|{FIXED}"))
    vertices = np.arange(space.ndof) < mesh.nv
    g.vec.FV().NumPy()[:] = inner & vertices
    free = ng.BitArray((_dofs(space, mesh.Materials(LAYER)) & ~inner & ~outer).tolist())
    u, v = space.TnT()
    laplace = BilinearForm(grad(u) * grad(v) * dx(LAYER)).Assemble()
    residual = laplace.mat.CreateColVector()
    residual.data = -laplace.mat * g.vec
    g.vec.data += laplace.mat.Inverse(free, inverse="sparsecholesky") * residual
    return g


def _dofs(space: H1, region: ng.Region) -> BoolArray:
    return np.array(list(space.GetDofs(region)), dtype=np.bool_)


class LayerForce:
    """The force as a quadratic form of solutions on one mesh: the weighted stress, symmetrised, over the layer."""

    def __init__(self, space: H1, g: GridFunction) -> None:
        (b, c), slope = map(flux_density, space.TnT()), grad(g)
        radial, axial = 0.5 * (b[0] * c[1] + b[1] * c[0]), 0.5 * (b[1] * c[1] - b[0] * c[0])
        density = (slope[0] * radial + slope[1] * axial) / MU_0 * 2.0 * math.pi * ng.x
        form = BilinearForm(density * dx(LAYER, bonus_intorder=RADIAL_WEIGHT_ORDER + 1))
        self._form = csr(form.Assemble().mat, space.ndof)

    def between(self, first: FieldArray, second: FieldArray) -> FieldArray:
        """The bilinear force of fields w with others in N: that of a sum is f(1, 1) + 2 f(1, 2) + f(2, 2)."""
        return inner_products(first, (self._form @ second.T).T)

    def of_sum(self, fields: FloatArray) -> FloatArray:
        """The force of a sum of fields as a quadratic form in their factors: symmetric, in N."""
        whole = self.between(fields, fields)
        return np.asarray(0.5 * (whole + whole.T))
