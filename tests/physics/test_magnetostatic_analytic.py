"""The field solver against closed forms: magnets, coils, loops, images."""

import math

import magpylib
import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.parts import LinearMaterial, Region
from femfit.field.weak_form import flux_density
from support.actuators import assembly, magnet, rectangle
from support.field import prepared, solved
from support.validation_cases import magnet_pair

# Published once, cited so that the test also runs where the reference data are absent: force between two coaxial
# cylinder magnets J = 1.3 T, R = 20 mm, h = 40 mm, centres 50 mm apart (magcode repository, Apache-2.0).
MAGCODE_FORCE = 265.537


def axis_field_of_thick_coil(turns, r1, r2, z1, z2, z):
    """B_z on the axis of a coil of rectangular section with 1 A."""

    def primitive(s):
        return s * math.log((r2 + math.hypot(r2, s)) / (r1 + math.hypot(r1, s)))

    return MU_0 * turns / (2.0 * (r2 - r1) * (z2 - z1)) * (primitive(z - z1) - primitive(z - z2))


@pytest.mark.parametrize("height", [-0.0125, 0.0, 0.02])
def test_axis_field_of_a_thick_coil_is_exact(height):
    coil = (0.01, 0.02, -0.02, -0.005)
    actuator = assembly(
        moving=[magnet(1.0, 0.005, 0.005)], distances=(0.06,), coil=rectangle(*coil), turns=308, hall=(0.0, height)
    )
    assert solved(actuator).hall[1] == pytest.approx(axis_field_of_thick_coil(308, *coil, height), rel=1e-4)


def test_opposed_magnets_repel_by_the_same_force():
    assert magnet_pair(-1.3, (0.02, 0.04), (0.02, 0.04), 0.01) == pytest.approx(-MAGCODE_FORCE, rel=2e-4)


@pytest.mark.parametrize("permeability", [5.0, 1000.0])
def test_force_above_a_wide_thick_plate_is_that_of_the_image(permeability):
    # A half-space of mu_r mirrors the magnet with strength (mu_r - 1) / (mu_r + 1); from 5 mm the image is 10 mm away.
    plate = Region("plate", rectangle(0.0, 1.0, -0.8, 0.0), LinearMaterial("iron", permeability))
    coil = rectangle(1.2, 1.25, -0.1, -0.05)
    actuator = assembly(fixed=[plate], moving=[magnet(1.3, 0.02, 0.04)], distances=(0.005,), coil=coil)
    image = (permeability - 1.0) / (permeability + 1.0)
    assert solved(actuator).force[0] == pytest.approx(image * MAGCODE_FORCE, rel=5e-4)


@pytest.mark.parametrize("distance", [0.002, 0.01, 0.03])
def test_force_between_coil_and_magnet_is_that_of_the_lorentz_force(distance):
    # Oracle: magpylib's exact field of the magnet, integrated over the coil; action equals reaction.
    r1, r2, z1, z2, turns = 0.01, 0.02, -0.02, -0.005, 308.0
    body = magnet(1.3, 0.0055, 0.005)
    actuator = assembly(moving=[body], distances=(distance,), coil=rectangle(r1, r2, z1, z2), turns=turns)
    source = magpylib.magnet.Cylinder(
        polarization=(0, 0, 1.3), dimension=(0.011, 0.005), position=(0, 0, distance + 0.0025)
    )
    nodes, weights = np.polynomial.legendre.leggauss(24)
    r = 0.5 * (r1 + r2) + 0.5 * (r2 - r1) * nodes
    z = 0.5 * (z1 + z2) + 0.5 * (z2 - z1) * nodes
    grid_r, grid_z = np.meshgrid(r, z)
    field = source.getB(np.stack([grid_r, 0 * grid_r, grid_z], axis=-1).reshape(-1, 3))[:, 0].reshape(grid_r.shape)
    # On the coil F_z = -int J B_r 2 pi r; positive towards the electromagnet on the magnet is the coil's pull upwards.
    expected = -2.0 * math.pi * turns * np.einsum("ij,i,j->", field * grid_r, weights, weights) / 4.0
    assert solved(actuator).force[1] == pytest.approx(expected, rel=2e-4)


def test_field_of_a_recoil_magnet_is_weaker_on_its_own_axis():
    hall = (0.0, 0.02)
    fields = [
        solved(assembly(moving=[magnet(1.45, 0.0055, 0.005, permeability=mu)], distances=(0.04,), hall=hall)).hall[0]
        for mu in (1.0, 1.05)
    ]
    assert 0.94 < fields[1] / fields[0] < 1.0


def test_flux_density_is_free_of_divergence():
    # Flux through closed cylinders vanishes: B_z through the faces against B_r through the mantle.
    actuator = assembly(moving=[magnet(1.3, 0.0055, 0.005)], distances=(0.02,))
    problem = prepared(actuator, 0.02)
    w = problem.field(0.02, 0.0).w
    nodes, weights = np.polynomial.legendre.leggauss(300)  # B jumps from element to element
    radius, low, high = 0.012, -0.001, 0.011
    b = flux_density(w)
    r = 0.5 * radius * (nodes + 1.0)
    faces = sum(
        sign * np.sum(weights * 0.5 * radius * 2.0 * math.pi * r * [b(problem.mesh(x, z))[1] for x in r])
        for sign, z in ((1.0, high), (-1.0, low))
    )
    z = 0.5 * (low + high) + 0.5 * (high - low) * nodes
    mantle = np.sum(weights * 0.5 * (high - low) * 2.0 * math.pi * radius * [b(problem.mesh(radius, y))[0] for y in z])
    assert abs(faces + mantle) < 1e-4 * abs(mantle)
