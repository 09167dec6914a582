"""Bearings, balls, plungers, magnets of any direction, coils and circuits against closed forms and each other."""

import dataclasses
import math
from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.electrics import Circuit, HallElement
from femfit.device.load import read_actuator
from femfit.device.outlines import circle
from femfit.device.parts import Coil, LinearMaterial, Region
from femfit.field.drawing import build_mesh
from femfit.field.layout import layout_of
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, STEEL, device, linear, magnet, rectangle, swept_at
from support.field import prepared
from support.validation_cases import pair_of_loops, thin_coil


def test_a_hall_element_reads_the_component_along_its_direction():
    actuator = device("magnet", moving=[magnet(1.2, 0.005, 0.004)], distances=(0.02,))
    axial, radial, slanting = (
        prepared(replace(actuator, sensors=(HallElement(0.006, 0.01, direction=direction),)), 0.02).solve(0.02).hall[0]
        for direction in ((0.0, 1.0), (1.0, 0.0), (0.6, 0.8))
    )
    assert radial != 0.0
    assert slanting == pytest.approx(0.6 * radial + 0.8 * axial, rel=1e-9)


def test_a_magnet_that_passes_through_a_ring_is_pushed_evenly_on_both_sides():
    # The force is odd about the middle of the ring, where the body's face stands at its lower face, -6 mm.
    ring = Region("ring", rectangle(0.008, 0.012, -0.006, 0.0), LinearMaterial("ring", 1.05, -1.2))
    distances = (-0.01, -0.006, -0.002)
    actuator = device("pass", fixed=[ring], moving=[magnet(1.2, 0.006, 0.006)], distances=distances)
    low, middle, high = (prepared(actuator, d).rows(d, (0.0,))["force_N"][0] for d in distances)
    assert high == pytest.approx(-low, rel=1e-4)
    assert abs(middle) < 1e-4 * abs(high)
    assert abs(high) > 1.0


def test_a_small_permeable_ball_feels_the_force_on_its_dipole():
    # m = 4 pi a^3 (mu_r - 1) / (mu_r + 2) B / mu_0 and F = m dB/dz; the coil is fifty times larger than the ball.
    radius, coil_radius, turns, height, permeability = 0.002, 0.1, 1000.0, 0.05, 500.0
    side = 0.01 * coil_radius
    section = rectangle(coil_radius - side / 2, coil_radius + side / 2, -side / 2, side / 2)
    corners, bulges = circle((0.0, radius), radius)
    body = Region("ball", tuple(corners), LinearMaterial("iron", permeability), tuple(bulges))
    low = height - radius
    actuator = device(
        "ball", coils=[Coil(section, turns, 1.0)], moving=[body], currents=((0.0, 1.0),), distances=(low,)
    )
    force = prepared(actuator, low).solve(low).force[1, 1]
    square = coil_radius**2 + height**2
    field = 0.5 * MU_0 * turns * coil_radius**2 / square**1.5
    slope = -3.0 * height / square * field
    moment = 4.0 * math.pi * radius**3 * (permeability - 1.0) / (permeability + 2.0) * field / MU_0
    assert force == pytest.approx(-moment * slope, rel=2e-3)


def test_a_ball_is_meshed_round_and_refined_at_no_corner():
    actuator, settings = swept_at(read_actuator(GEOMETRY / "ball.toml"), (8e-3,)), SolverSettings()
    mesh = build_mesh(actuator, 8e-3, layout_of(actuator, settings), settings)
    body = mesh.Materials("moving:ball")
    volume = ng.Integrate(2.0 * math.pi * ng.x, mesh, order=8, definedon=body)
    assert volume == pytest.approx(4.0 / 3.0 * math.pi * 0.0125**3, rel=1e-6)
    assert sum(element.mat == "moving:ball" for element in mesh.Elements()) < 100


def test_a_bearings_stiffness_and_force_per_current_are_those_of_its_gaps():
    # Two gaps in series without fringing: F = N^2 i^2 mu_0 A / (2 g^2) a side, 1 / A = 1 / A_1 + 1 / A_2; fringing of
    # 0.5 mm at poles of 8 mm adds up to a tenth. Bias i_0 in both: k_i = dF/di, k_s = -dF/dd, k_s / k_i = i_0 / g.
    turns, gap, bias, step = 150.0, 0.5e-3, 1.0, 2e-5
    inner, outer = math.pi * (0.018**2 - 0.01**2), math.pi * (0.04**2 - 0.032**2)
    area = inner * outer / (inner + outer)
    force_per_current = 2.0 * turns**2 * MU_0 * area * bias / gap**2
    distances = (gap - step, gap, gap + step)
    bearing = swept_at(read_actuator(GEOMETRY / "bearing.toml"), distances)
    actuator = linear(bearing, LinearMaterial("iron", 1e5))
    sources = np.array([1.0, bias, bias])
    low, middle, high = (prepared(actuator, d, SolverSettings(order=3)).solve(d).force for d in distances)
    control = np.array([0.0, 1.0, -1.0])
    by_current = 2.0 * control @ middle @ sources
    stiffness = (sources @ low @ sources - sources @ high @ sources) / (2.0 * step)
    assert 1.0 < by_current / force_per_current < 1.1
    assert 1.0 < stiffness / (force_per_current * bias / gap) < 1.1
    assert abs(sources @ middle @ sources) < 1e-3 * by_current  # in the middle the sides are even


@pytest.mark.nightly
def test_a_saturating_bearings_circuits_are_reciprocal():
    # dF/di_k = -d(flux linkage_k)/dd and dlambda_1/di_2 = dlambda_2/di_1, by differences between meshes of their own.
    step, change = 2e-5, 0.2
    distances = (0.45e-3 - step, 0.45e-3, 0.45e-3 + step)
    actuator = linear(swept_at(read_actuator(GEOMETRY / "bearing.toml"), distances), STEEL)
    points = np.array([(4.0, 4.0), (4.0 - change, 4.0), (4.0 + change, 4.0)])
    low, middle, high = (
        prepared(swept_at(actuator, (d,)), d, SolverSettings(order=3)).rows(d, points[:n])
        for d, n in zip(distances, (1, 3, 1), strict=True)
    )
    slope = -(high["flux_linkage_lower_Wb"][0] - low["flux_linkage_lower_Wb"][0]) / (2.0 * step)
    by_current = (middle["force_N"][2] - middle["force_N"][1]) / (2.0 * change)
    assert by_current == pytest.approx(slope, rel=1e-2)
    for column, of in (("inductance_lower_H", "lower"), ("inductance_lower_upper_H", "upper")):
        flux = middle[f"flux_linkage_{of}_Wb"]
        assert (flux[2] - flux[1]) / (2.0 * change) == pytest.approx(middle[column][0], rel=1e-2)


def test_a_coils_own_current_does_not_move_it():
    actuator = pair_of_loops(0.02, 0.015, 0.01)
    (distance,) = actuator.sweep.distances_m
    solution = prepared(actuator, distance).solve(distance)
    assert abs(solution.force[2, 2]) < 1e-9 * abs(solution.force[1, 2])
    assert abs(solution.force[1, 1]) < 1e-9 * abs(solution.force[1, 2])


def test_a_maxwell_pair_in_one_circuit_makes_a_uniform_gradient():
    # Two loops of opposite current, sqrt(3) radii apart: B_z = 48 / 49 sqrt(3 / 7) mu_0 i z / R^2, but for z^5.
    radius = 0.1
    half = 0.5 * math.sqrt(3.0) * radius
    upper, lower = thin_coil(radius, half, name="upper"), thin_coil(radius, -half, name="lower")
    coils = [dataclasses.replace(upper, circuit="pair"), dataclasses.replace(lower, circuit="pair", sign=-1.0)]
    gradient = 48.0 / 49.0 * math.sqrt(3.0 / 7.0) * MU_0 / radius**2
    for height in (0.01, 0.02):
        actuator = device(
            "maxwell-pair",
            coils=coils,
            circuits=(Circuit(1.0, name="pair"),),
            moving=[magnet(1e-6, 0.005, 0.005)],
            currents=((0.0, 1.0),),
            distances=(0.3,),
            sensors=[HallElement(0.0, height)],
        )
        assert prepared(actuator, 0.3).solve(0.3).hall[1] == pytest.approx(gradient * height, rel=2e-3)


def test_coils_in_series_are_one_coil_of_all_their_turns():
    whole = Coil(rectangle(0.01, 0.02, -0.02, 0.0), 300.0, 1.0)
    halves = [
        Coil(rectangle(0.01, 0.02, -0.01, 0.0), 150.0, 1.0, name="upper", circuit="both"),
        Coil(rectangle(0.01, 0.02, -0.02, -0.01), 150.0, 1.0, name="lower", circuit="both"),
    ]
    series = (Circuit(2.0, name="both"),)
    body = [magnet(1.3, 0.006, 0.005)]
    one = device("one", coils=[whole], moving=body, currents=((0.0, 1.0),), distances=(0.01,))
    two = device("two", coils=halves, circuits=series, moving=body, currents=((0.0, 1.0),), distances=(0.01,))
    first, second = (prepared(actuator, 0.01).solve(0.01) for actuator in (one, two))
    np.testing.assert_allclose(second.force[0], first.force[0], rtol=2e-4, atol=1e-9)
    np.testing.assert_allclose(second.flux_linkage, first.flux_linkage, rtol=5e-4)
