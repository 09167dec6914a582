r"""The axisymmetric magnetostatic problem in its weak form.

With A_phi = r w(r, z), w smooth and even in r, the flux density is B_r = -r dw/dz, B_z = 2 w + r dw/dr. Find w with

    integral nu B(w) . B(v) 2 pi r  +  boundary  =  integral nu B_rem . B(v) 2 pi r  +  integral J r v 2 pi r

for all v, B_rem along any direction in (r, z): no 1/r anywhere and no condition on the axis. The boundary, a sphere of
radius R, carries the energy of the field outside of it for a dipole, (nu_0 / R) r^2 w v 2 pi r, which is exact for the
leading term of any closed source.

References
----------
K. Meeker, FEMM 4.2 manual, section A.3 (asymptotic boundary); J. Gopalakrishnan and S. Reitzinger, Numer. Linear
Algebra Appl. 16 (2009), for unknowns A/r in axisymmetric spaces.
"""

import math
from typing import Any

import ngsolve as ng
import numpy as np
import shapely
from ngsolve import CF, H1, BilinearForm, GridFunction, InnerProduct, LinearForm, Mesh, ds, dx, grad

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import MU_0, FloatArray
from femfit.device.electrics import HallElement
from femfit.device.parts import Actuator, Coil, LinearMaterial, Material, NonlinearMaterial
from femfit.field.layout import coil_region

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
