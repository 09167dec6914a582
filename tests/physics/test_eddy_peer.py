"""A pot of solid iron against scikit-fem: r A_phi as the unknown, quadratic elements of its own."""

import math

import numpy as np
import pytest
import shapely
from scipy.sparse.linalg import splu

from femfit.core.numerics import MU_0
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.weak_form import materials
from support.eddy_transient import mesh_for
from support.small_drawing import POT


def inductance(actuator, moving, frequency, refinements):
    """Of the circuit in H at a frequency in Hz, on the corners of a mesh that is split so often.

    With u = r A_phi, integral (nu / r) grad u . grad v + (j omega sigma / r) u v = integral J v; beyond the outer
    sphere the field is taken as a dipole's, as femfit takes it.
    """
    import skfem

    points = np.array([point.p[:2] for point in moving.mesh.ngmesh.Points()])
    elements = list(moving.mesh.ngmesh.Elements2D())
    halves = [(one.index, [one.vertices[k].nr - 1 for k in half]) for one in elements for half in _halves(one)]
    corners = np.array([half for _, half in halves]).T
    names = [moving.mesh.GetMaterials()[index - 1] for index, _ in halves]
    split = skfem.MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(corners))
    region = np.arange(len(names))
    for _ in range(refinements):
        split, region = split.refined(1), np.tile(region, 4)
    middle = split.p[:, split.t].mean(axis=1)
    basis = skfem.Basis(split, skfem.ElementTriP2(), intorder=6)
    named = materials(actuator)
    nu, sigma = np.full(len(names), 1.0 / MU_0), np.zeros(len(names))
    for k, name in enumerate(names):
        if name in named:
            nu[k], sigma[k] = named[name].reluctivity, named[name].conductivity_S_per_m
    (coil,) = actuator.coils
    winding = shapely.Polygon(coil.vertices_m)
    density = np.where(shapely.contains_xy(winding, *middle), coil.turns / winding.area, 0.0)
    nu, sigma = (np.tile(one[region][:, None], basis.X.shape[-1]) for one in (nu, sigma))
    density = np.tile(density[:, None], basis.X.shape[-1])
    radius = np.hypot(*points.T).max()

    @skfem.BilinearForm
    def stiffness(u, v, w):
        return w.nu / w.x[0] * (u.grad[0] * v.grad[0] + u.grad[1] * v.grad[1])

    @skfem.BilinearForm
    def mass(u, v, w):
        return w.sigma / w.x[0] * u * v

    @skfem.BilinearForm
    def outside(u, v, w):
        return u * v / (MU_0 * radius * w.x[0])

    @skfem.LinearForm
    def load(v, w):
        return w.density * v

    sphere = split.facets_satisfying(lambda x: np.hypot(*x) > 0.98 * radius, boundaries_only=True)
    edge = skfem.FacetBasis(split, skfem.ElementTriP2(), facets=sphere, intorder=6)
    system = stiffness.assemble(basis, nu=nu) + outside.assemble(edge)
    system = (system + 2j * math.pi * frequency * mass.assemble(basis, sigma=sigma)).tocsc()
    right = load.assemble(basis, density=density)
    axis = basis.get_dofs(split.facets_satisfying(lambda x: x[0] < 1e-9, boundaries_only=True)).flatten()
    free = basis.complement_dofs(axis)
    solved = splu(system[free][:, free]).solve(right[free].astype(complex))
    return complex(2.0 * math.pi * right[free] @ solved)


def _halves(element):
    """Corners of the triangles of an element; those of the layers have four corners."""
    return [(0, 1, 2), (0, 2, 3)] if len(element.vertices) == 4 else [(0, 1, 2)]


DISTANCE = 1.5e-3


def test_inductance_and_loss_are_those_of_another_program():
    pytest.importorskip("skfem")
    actuator, frequencies = actuator_from_toml(POT), np.array([30.0, 1000.0])
    moving = mesh_for(actuator, DISTANCE, frequencies[-1])
    found, _ = EddyProbe(actuator, moving, DISTANCE, ORDER).transfers(frequencies)
    ours = found.flux_linkage[:, 0, 0]
    coarse, fine = (np.array([inductance(actuator, moving, one, splits) for one in frequencies]) for splits in (0, 1))
    assert np.abs(fine / ours - 1.0).max() < 6e-4  # of the peer's quadratic elements: 3e-5 if split once more
    assert (np.abs(fine / ours - 1.0) < 0.3 * np.abs(coarse / ours - 1.0)).all()
    assert fine.imag == pytest.approx(ours.imag, rel=2e-3)
