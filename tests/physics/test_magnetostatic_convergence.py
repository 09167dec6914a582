"""Observed orders of convergence, element order by element order, on a smooth field with a known source; its laws."""

import math

import ngsolve as ng
import numpy as np
import pytest
from netgen.occ import OCCGeometry, WorkPlane
from ngsolve import H1, Integrate, LinearForm, Mesh, dx

from femfit.core.numerics import MU_0
from femfit.field.nonlinear_system import SummedInverse
from femfit.field.weak_form import flux_density, stiffness

RADIUS, WIDTH = 1.0, 0.18  # the Gaussian is 4e-14 on the boundary


def energy_error(order, size):
    """Relative error of B in the energy norm for w = exp(-(r^2 + z^2) / s^2)."""
    half = WorkPlane().MoveTo(0.0, -RADIUS).Arc(RADIUS, 180.0).Close().Face()
    for edge in half.edges:
        edge.name = "outer" if edge.center.x > 0.1 else "axis"
    mesh = Mesh(OCCGeometry(half, dim=2).GenerateMesh(maxh=size))
    mesh.Curve(order)
    space = H1(mesh, order=order)
    r, z = ng.x, ng.y
    exact = ng.exp(-(r**2 + z**2) / WIDTH**2)
    radial, axial = -2.0 * r / WIDTH**2 * exact, -2.0 * z / WIDTH**2 * exact
    # J_phi = -(r w_rr + 3 w_r + r w_zz) / mu_0, from curl (nu curl A) with A = r w.
    laplacian = r * (4.0 * r**2 / WIDTH**4 - 2.0 / WIDTH**2) * exact + 3.0 * radial
    laplacian += r * (4.0 * z**2 / WIDTH**4 - 2.0 / WIDTH**2) * exact
    v = space.TestFunction()
    load = LinearForm(-laplacian / MU_0 * r * v * 2.0 * math.pi * r * dx(bonus_intorder=10)).Assemble()
    form = stiffness(space, ng.CF(1.0 / MU_0), RADIUS).Assemble()
    inverse, w = SummedInverse(space), ng.GridFunction(space)
    inverse.renew((form,))
    w.vec.FV().NumPy()[:] = inverse.solve(load.vec.FV().NumPy())
    b = ng.CF((-r * axial, 2.0 * exact + r * radial))
    difference = flux_density(w) - b
    norm = Integrate(b * b * r, mesh, order=24)
    return math.sqrt(Integrate(difference * difference * r, mesh, order=24) / norm)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_flux_density_converges_with_the_elements_order(order):
    sizes = np.array([0.1, 0.05]) if order < 5 else np.array([0.14, 0.07])
    errors = np.array([energy_error(order, size) for size in sizes])
    observed = np.log(errors[0] / errors[1]) / np.log(sizes[0] / sizes[1])
    # Unstructured meshes are not exactly nested, hence the half order of slack.
    assert order - 0.5 < observed < order + 1.0
