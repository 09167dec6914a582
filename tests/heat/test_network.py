"""The network of a drawing beside closed forms and beside conduction on a fine grid."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.load import actuator_from_toml, read_actuator
from femfit.heat.balance import Loads, settled
from femfit.heat.network import heat_network
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
