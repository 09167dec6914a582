"""Eddy losses by material beside the impedance that they come from."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError, UsageError
from femfit.device.load import actuator_from_toml
from femfit.field.sweep import run_sweep
from femfit.heat.find_temperatures import find_temperatures
from femfit.tables.eddy_table import read_eddy
from support.eddy_pot import POT


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    directory = tmp_path_factory.mktemp("eddies")
    text = POT.replace("[1, 1.5, 2, 2.5]", "[1, 2.5]").replace(
        "relative_permeability = 1.05", "relative_permeability = 1.05\nconductivity_MS_per_m = 0.7"
    )
    actuator = actuator_from_toml(text)
    run_sweep(actuator, directory, workers=1)
    return actuator, directory


def test_losses_of_all_materials_are_the_real_part_of_the_impedance(swept):
    table, f = read_eddy(swept[1]), np.array([10.0, 100.0, 1000.0])
    losses = table.losses(1, f, np.array([0.3]))
    induced = 2j * np.pi * f * table.transfers(1, f).flux_linkage[:, 0, 0]
    assert losses.sum(axis=1) == pytest.approx(0.3**2 * induced.real, rel=1e-9)
    assert (losses > 0.0).all()
    assert table.materials[int(losses[-1].argmax())] == "iron"


def test_losses_grow_with_the_square_of_a_low_frequency_and_of_the_current(swept):
    table = read_eddy(swept[1])
    low, high = table.losses(0, np.array([0.01, 0.02]), np.array([1.0]))
    assert high == pytest.approx(4.0 * low, rel=1e-4)
    assert table.losses(0, np.array([0.01]), np.array([2.0]))[0] == pytest.approx(4.0 * low)


def test_eddy_currents_heat_the_parts_of_their_material(swept):
    actuator, directory = swept
    found = find_temperatures(actuator, alternating_A=0.3, frequency_Hz=1000.0, sweep=directory, distance_m=1e-3)
    copper = find_temperatures(actuator, alternating_A=0.3, distance_m=1e-3)
    table = read_eddy(directory)
    assert found.eddy_W.sum() == pytest.approx(table.losses(0, np.array([1000.0]), np.array([0.3])).sum())
    assert found.eddy_W[found.names.index("winding")] == 0.0
    assert found.network.outwards @ (found.temperatures_C - 20.0) == pytest.approx(found.heat_W.sum())
    assert (found.temperatures_C > copper.temperatures_C).all()
    assert "by eddy currents" in str(found)


def test_a_frequency_needs_a_sweep_with_eddy_currents(swept, tmp_path):
    with pytest.raises(UsageError, match="both a frequency and a sweep"):
        find_temperatures(swept[0], frequency_Hz=100.0)
    with pytest.raises(MissingPartError, match="frequency_Hz"):
        find_temperatures(swept[0], alternating_A=0.3, frequency_Hz=100.0, sweep=tmp_path)
    with pytest.raises(UsageError, match="must lie within"):
        find_temperatures(swept[0], alternating_A=0.3, frequency_Hz=100.0, sweep=swept[1], distance_m=0.01)


@pytest.mark.parametrize("frequency", [0.0, -100.0, np.nan, 1e9])
def test_a_frequency_beyond_the_sweep_is_refused(swept, frequency):
    actuator, directory = swept
    with pytest.raises(UsageError, match="frequency must be above 0 and within that sweep"):
        find_temperatures(actuator, alternating_A=0.3, frequency_Hz=frequency, sweep=directory, distance_m=1e-3)


def test_eddy_heat_asks_for_an_alternating_current_and_a_sweep_of_the_drawing(swept):
    actuator, directory = swept
    with pytest.raises(UsageError, match="alternating current"):
        find_temperatures(actuator, frequency_Hz=100.0, sweep=directory, distance_m=1e-3)
    fixed = tuple(replace(one, material=replace(one.material, name="other")) for one in actuator.fixed)
    moving = replace(actuator.moving, regions=())
    other = replace(actuator, fixed=fixed, moving=moving)
    with pytest.raises(UsageError, match="must be of this drawing"):
        find_temperatures(other, alternating_A=0.3, frequency_Hz=100.0, sweep=directory, distance_m=1e-3)
