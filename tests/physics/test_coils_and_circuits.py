"""Several coils, moving coils and circuits against closed forms and the Lorentz force."""

import dataclasses
import math

import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.electrics import Circuit, HallElement
from femfit.device.parts import Coil
from support.actuators import device, magnet, rectangle
from support.field import prepared
from support.validation_cases import pair_of_loops, thin_coil


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
