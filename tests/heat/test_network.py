"""Networks of nodes, windings and faces beside closed forms and conduction on a fine grid."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.integrate import quad

from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT as ALPHA
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.device.parts import Coil
from femfit.heat.balance import Loads, largest_factor, settled, slowest_s, time_until
from femfit.heat.network import DENSEST, NOTHING, OPEN, HeatNetwork, faces_of, heat_network, stars, winding_heat
from support.actuators import GEOMETRY
from support.heat_grid import rises

AIR_COIL = """
schema = 2
name = "air-coil"
[coils.coil]
r_mm = [20, 22]
z_mm = [-2, 0]
turns = 50
wire_diameter_mm = 0.2
[moving.regions.body]
material = "low_carbon_steel"
r_mm = [0, 1]
z_mm = [0, 1]
[mechanics]
mass_g = 1
[supply]
voltage_min_V = 0
voltage_max_V = 1
[sweep]
current_A = [0, 1]
distance_mm = [30, 40]
"""


def of_coils(network, watts=1.0):
    heat = np.zeros(len(network.names))
    heat[: len(network.windings)] = watts
    return Loads(0.0 * heat, heat)


def test_a_ring_in_the_open_gives_off_its_heat_by_its_faces():
    actuator = actuator_from_toml(AIR_COIL)
    network = heat_network(replace(actuator, thermal=replace(actuator.thermal, insulation_W_per_m_K=100.0)), 0.03)
    surface = 2.0 * np.pi * (0.022 + 0.020) * (0.002 + 0.002)
    assert settled(network, 0.0, of_coils(network))[0] == pytest.approx(1.0 / (10.0 * surface), rel=2e-3)


@pytest.mark.parametrize("name", ["pot-magnet", "solenoid", "emaws-rig", "voice-coil", "bearing", "ball"])
def test_what_is_put_in_comes_out(name):
    actuator = read_actuator(GEOMETRY / f"{name}.toml")
    network = heat_network(actuator, actuator.sweep.distances_m[0])
    rise = settled(network, 0.0, of_coils(network))
    assert network.outwards @ rise == pytest.approx(len(network.windings))
    assert np.allclose(network.between, network.between.T)
    assert np.linalg.eigvalsh(network.laplacian)[0] > 0.0
    assert np.allclose(network.inside.sum(axis=1), 0.0)


CASES = {
    ("pot-magnet", 0.5e-3): 0.06,
    ("plunger-solenoid", 0.5e-3): 0.02,
    ("plunger-solenoid", 10e-3): 0.02,
    ("emaws-rig", 22e-3): 0.02,
    ("voice-coil", -6e-3): 0.09,
    ("bearing", 0.5e-3): 0.03,
}


@pytest.mark.parametrize(("name", "distance"), CASES)
def test_the_network_is_near_conduction_on_a_fine_grid(name, distance):
    """The parts' rises within a share of the winding's; the howto says by how much."""
    actuator = read_actuator(GEOMETRY / f"{name}.toml")
    network = heat_network(actuator, distance)
    rise, count = settled(network, 0.0, of_coils(network)), len(actuator.coils)
    exact = np.array(rises(actuator, distance, [1.0] * count))
    assert rise[:count] == pytest.approx(exact[:count, 0], rel=CASES[name, distance])
    assert np.abs(rise - exact[:, 0]).max() < max(CASES[name, distance], 0.045) * exact[0, 0]
    hottest = rise[:count] + network.inside @ np.append(rise, 0.0)
    assert hottest == pytest.approx(exact[:count, 1], rel=0.05)


def test_a_mounting_cools_the_heaviest_fixed_part():
    actuator = read_actuator(GEOMETRY / "pot-magnet.toml")
    cooled = replace(actuator, thermal=replace(actuator.thermal, mounting_W_per_K=1e6))
    network = heat_network(cooled, 1e-3)
    assert settled(network, 20.0, of_coils(network))[network.names.index("pot")] == pytest.approx(20.0, abs=1e-4)


G, C = 0.1, 50.0


def one_node():
    return HeatNetwork(
        (),
        (None,),
        (),
        np.array([C]),
        np.array([1e-6]),
        np.zeros((1, 1)),
        np.array([G]),
        np.zeros((0, 2)),
    )


def watts(power, other=0.0):
    return Loads(np.array([power]), np.array([other]))


def test_one_node_settles_at_heat_over_conductance_less_the_slope_of_the_heat():
    (found,) = settled(one_node(), 20.0, watts(3.0, 0.5))
    assert found == pytest.approx(20.0 + 3.5 / (G - ALPHA * 3.0))


def test_one_node_runs_away_where_its_heat_grows_as_fast_as_it_flows_off():
    limit = G / ALPHA
    assert largest_factor(one_node(), watts(1.0)) == pytest.approx(limit)
    assert np.isfinite(settled(one_node(), 20.0, watts(0.999 * limit)))
    assert np.isnan(settled(one_node(), 20.0, watts(1.001 * limit)))
    assert largest_factor(one_node(), watts(0.0, 1.0)) == math.inf


def test_one_node_warms_up_along_an_exponential_that_its_own_heat_slows_down():
    loads, final = watts(3.0), 20.0 + 3.0 / (G - ALPHA * 3.0)
    reached = 20.0 + (1.0 - math.exp(-1.0)) * (final - 20.0)
    found = time_until(one_node(), 20.0, loads.at, lambda now: now[0] - reached)
    assert found == pytest.approx(C / (G - ALPHA * 3.0), rel=1e-5)
    assert slowest_s(one_node()) == pytest.approx(C / G)


def test_one_node_that_runs_away_passes_a_temperature_in_time():
    power = 2.0 * G / ALPHA
    rate = (ALPHA * power - G) / C
    exact = math.log1p(110.0 * rate * C / power) / rate  # T - 20 = P / (alpha P - G) (exp(rate t) - 1)
    assert time_until(one_node(), 20.0, watts(power).at, lambda now: now[0] - 130.0) == pytest.approx(exact, rel=1e-5)


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


def test_a_varnished_winding_conducts_as_it_was_measured():
    """A. A. Wereszczak and others, J. Thermal Science and Engineering Applications: 0.5 to 1 W/(m K) at 50 % copper."""
    area = (OUTER - INNER) * HEIGHT
    half = coil(turns=0.5 * area / (0.25 * math.pi * 7e-4**2), wire_diameter_m=7e-4)
    found = winding_heat(half, 0.25)
    assert found.copper_share == pytest.approx(0.5)
    assert 0.5 < found.conductivity_W_per_m_K < 1.0


def test_an_unknown_wire_follows_from_the_resistance():
    given = 200 * 2 * math.pi * 0.0085 * 1.7241e-8 / (0.25 * math.pi * 4e-4**2)
    known = winding_heat(coil(resistance_ohm=given), 0.1)
    unknown = winding_heat(coil(resistance_ohm=given, wire_diameter_m=None), 0.1)
    assert unknown.copper_share == pytest.approx(known.copper_share)
    assert winding_heat(coil(resistance_ohm=1e-4, wire_diameter_m=None), 0.1).copper_share == DENSEST


def test_the_drawings_resistance_holds_at_the_drawings_temperature():
    assert winding_heat(coil(temperature_C=100.0), 0.1).cold_ohm == pytest.approx(1.0 / (1.0 + 0.00393 * 80.0))
    assert np.isclose(winding_heat(coil(), 0.1).cold_ohm, 1.0)


def conductance(faces, one, other):
    """Area over gap, of all rays from one part to another."""
    met = (faces.part == one) & (faces.facing == other)
    return np.sum(faces.area[met] / faces.gap[met])


def test_a_cylindrical_gap_conducts_as_its_closed_form():
    parts = [shapely.box(0.0, 0.0, 0.005, 0.02), shapely.box(0.007, 0.0, 0.009, 0.02)]
    exact = 2.0 * np.pi * 0.02 / np.log(7.0 / 5.0)
    faces = faces_of(parts, 0.003)
    assert conductance(faces, 0, 1) == pytest.approx(exact, rel=1e-6)
    assert conductance(faces, 1, 0) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(("mouth", "found"), [(0.002, NOTHING), (0.006, OPEN)])
def test_a_pocket_is_open_where_a_disc_as_wide_as_the_widest_gap_gets_in(mouth, found):
    """A ring-shaped pocket of 10 mm by 10 mm in a block, with a slit to the outside."""
    block = shapely.box(0.005, 0.0, 0.03, 0.02) - shapely.box(0.01, 0.005, 0.02, 0.015)
    block -= shapely.box(0.02, 0.01 - 0.5 * mouth, 0.03, 0.01 + 0.5 * mouth)
    faces = faces_of([block], 0.005)
    inner = 2.0 * np.pi * 0.01 * 0.01  # the pocket's wall next to the axis
    outer = 2.0 * np.pi * (0.03**2 - 0.005**2 + 0.03 * (0.02 - mouth) + 0.005 * 0.02)
    free = faces.area[faces.facing == OPEN].sum()
    assert (free > outer + 0.9 * inner) == (found == OPEN)
    if found == NOTHING:
        seen = 2.0 * np.pi * 0.01 * mouth  # of the pocket's wall, which looks out through the slit
        assert free == pytest.approx(outer + seen, rel=2e-3)
