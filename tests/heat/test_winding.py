"""A winding's conduction beside closed forms and a published measurement."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from femfit.device.parts import Coil
from femfit.heat.walls import DENSEST, stars, winding_heat

INNER, OUTER, HEIGHT, K = 0.006, 0.011, 0.03, 0.3


def coil(**changes):
    corners = ((INNER, 0.0), (OUTER, 0.0), (OUTER, HEIGHT), (INNER, HEIGHT))
    return Coil(**{"vertices_m": corners, "turns": 200.0, "resistance_ohm": 1.0, "wire_diameter_m": 4e-4} | changes)


def shell(inner_C, outer_C, watts):
    """Mean of T(r) = A + B ln r - q r^2 / (4 k) in a shell, and the heat through its outer face."""
    q = watts / (math.pi * (OUTER**2 - INNER**2) * HEIGHT)
    slope = (outer_C - inner_C + q * (OUTER**2 - INNER**2) / (4.0 * K)) / math.log(OUTER / INNER)

    def temperature(r):
        return inner_C + slope * math.log(r / INNER) - q * (r**2 - INNER**2) / (4.0 * K)

    mean = quad(lambda r: temperature(r) * r, INNER, OUTER)[0] / (0.5 * (OUTER**2 - INNER**2))
    return mean, -2.0 * math.pi * HEIGHT * K * (slope - q * OUTER**2 / (2.0 * K))


@pytest.mark.parametrize(("inner", "outer"), [(20.0, 20.0), (50.0, 20.0), (20.0, 70.0)])
def test_the_radial_star_has_the_mean_and_the_flow_of_a_heated_shell(inner, outer):
    watts, (to_inner, to_outer, to_mean) = 5.0, stars(coil(), K)[0]
    mean, flow = shell(inner, outer, watts)
    centre = (inner / to_inner + outer / to_outer + watts) / (1.0 / to_inner + 1.0 / to_outer)
    assert centre + watts * to_mean == pytest.approx(mean, abs=1e-9)
    assert (centre - outer) / to_outer == pytest.approx(flow, abs=1e-9)


def test_the_axial_star_has_the_mean_of_a_heated_slab():
    low, high, to_mean = stars(coil(), K)[1]
    area = math.pi * (OUTER**2 - INNER**2)
    assert 1.0 / (1.0 / low + 1.0 / high) + to_mean == pytest.approx(HEIGHT / (12.0 * K * area))  # q t^2 / (12 k)


def test_a_varnished_winding_conducts_as_it_was_measured():
    """A. A. Wereszczak and others, J. Thermal Science and Engineering Applications: 0.5 to 1 W/(m K) at 50 % copper."""
    area = (OUTER - INNER) * HEIGHT
    half = coil(turns=0.5 * area / (0.25 * math.pi * 7e-4**2), wire_diameter_m=7e-4)
    found = winding_heat(half, 0.25)
    assert found.copper_share == pytest.approx(0.5)
    assert 0.5 < found.conductivity_W_per_m_K < 1.0


def test_no_copper_leaves_the_filler():
    assert winding_heat(coil(turns=1.0, wire_diameter_m=1e-5), 0.1).conductivity_W_per_m_K == pytest.approx(
        0.1, rel=1e-4
    )


def test_an_unknown_wire_follows_from_the_resistance():
    given = 200 * 2 * math.pi * 0.0085 * 1.7241e-8 / (0.25 * math.pi * 4e-4**2)
    known = winding_heat(coil(resistance_ohm=given), 0.1)
    unknown = winding_heat(coil(resistance_ohm=given, wire_diameter_m=None), 0.1)
    assert unknown.copper_share == pytest.approx(known.copper_share)
    assert winding_heat(coil(resistance_ohm=1e-4, wire_diameter_m=None), 0.1).copper_share == DENSEST


def test_the_drawings_resistance_holds_at_the_drawings_temperature():
    assert winding_heat(coil(temperature_C=100.0), 0.1).cold_ohm == pytest.approx(1.0 / (1.0 + 0.00393 * 80.0))
    assert np.isclose(winding_heat(coil(), 0.1).cold_ohm, 1.0)
