"""What is found of a drawing's temperatures, with eddy losses too."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError, UsageError
from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT as ALPHA
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.field.sweep import run_sweep
from femfit.heat.find_temperatures import find_temperatures
from femfit.tables.eddy_table import read_eddy
from support.actuators import GEOMETRY
from support.eddy_pot import POT

RIG = GEOMETRY / "emaws-rig.toml"


def resistance_of_heat(actuator, distance):
    """Rise of the winding's mean in K for each watt in it."""
    found = find_temperatures(actuator, current_A=1e-3, distance_m=distance)
    return float((found.windings_C[0] - 20.0) / found.heat_W.sum())


def test_a_held_voltage_settles_where_the_quadratic_equation_says():
    """(1 + alpha x) x = R_th U^2 / R."""
    actuator = read_actuator(RIG)
    rth, ohm = resistance_of_heat(actuator, 0.022), 2.69
    found = find_temperatures(actuator, voltage_V=3.0)
    rise = (math.sqrt(1.0 + 4.0 * ALPHA * rth * 9.0 / ohm) - 1.0) / (2.0 * ALPHA)
    assert found.windings_C[0] - 20.0 == pytest.approx(rise, rel=1e-5)
    assert found.currents_A[0] == pytest.approx(3.0 / (ohm * (1.0 + ALPHA * rise)), rel=1e-5)


def test_a_held_current_settles_higher_and_runs_away_at_its_limit():
    actuator = read_actuator(RIG)
    rth = resistance_of_heat(actuator, 0.022)
    found = find_temperatures(actuator, current_A=1.0)
    assert found.windings_C[0] - 20.0 == pytest.approx(rth * 2.69 / (1.0 - ALPHA * rth * 2.69), rel=1e-4)
    limit = 1.0 / math.sqrt(ALPHA * rth * 2.69)
    assert find_temperatures(actuator, current_A=0.999 * limit).settles
    gone = find_temperatures(actuator, current_A=1.001 * limit)
    assert not gone.settles
    assert gone.limit_s > 0.0


def test_the_largest_current_brings_the_hottest_strand_to_its_limit():
    found = find_temperatures(RIG, current_A=0.5)
    at = find_temperatures(RIG, current_A=found.allowed_A)
    assert at.hottest_C[0] == pytest.approx(130.0, abs=1e-4)
    assert at.allowed_factor == pytest.approx(1.0, abs=1e-6)
    assert at.lasts
    above = find_temperatures(RIG, current_A=1.05 * found.allowed_A)
    assert not above.lasts
    assert above.at_limit.hottest_C[0] == pytest.approx(130.0, abs=1e-3)


def test_a_magnet_may_be_what_limits_the_current():
    found = find_temperatures(GEOMETRY / "biased-electromagnet.toml", current_A=2.0)
    assert found.limiting == "bias"
    assert found.at_limit.magnets[0].temperature_C == pytest.approx(80.0, abs=1e-3)
    assert found.at_limit.magnets[0].change == pytest.approx(-1.2e-3 * 60.0, rel=1e-4)


def test_an_alternating_current_heats_by_its_rms_value():
    direct = find_temperatures(RIG, current_A=0.5)
    both = find_temperatures(RIG, current_A=0.3, alternating_A=0.4)
    assert both.windings_C == pytest.approx(direct.windings_C)
    assert find_temperatures(RIG, alternating_A=0.5).windings_C == pytest.approx(direct.windings_C)


def test_the_result_goes_into_json():
    found = find_temperatures(GEOMETRY / "pot-magnet.toml", current_A=1.0)
    data = json.loads(json.dumps(found.to_dict()))
    assert data["settles"] is False
    assert data["temperatures_C"] == [None] * 3
    assert data["at_limit"]["settles"] is True


@pytest.mark.parametrize(
    "given",
    [
        {"current_A": 1.0, "voltage_V": 1.0},
        {"current_A": (1.0, 2.0)},
        {"current_A": 1e300},
        {"current_A": 1.0, "distance_m": math.nan},
        {"current_A": 1.0, "distance_m": -1e-3},
        {"frequency_Hz": 100.0},
    ],
)
def test_what_does_not_fit_together_is_refused(given):
    with pytest.raises(UsageError):
        find_temperatures(RIG, **given)


def test_a_drawing_without_a_coil_or_limits_is_refused():
    actuator = read_actuator(RIG)
    with pytest.raises(MissingPartError, match="coil"):
        find_temperatures(GEOMETRY / "magnet-pair.toml")
    with pytest.raises(UsageError):
        find_temperatures(replace(actuator, circuits=(replace(actuator.circuits[0], voltage_max_V=math.inf),)))


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


def test_eddy_currents_heat_the_parts_of_their_material(swept):
    actuator, directory = swept
    found = find_temperatures(actuator, alternating_A=0.3, frequency_Hz=1000.0, sweep=directory, distance_m=1e-3)
    copper = find_temperatures(actuator, alternating_A=0.3, distance_m=1e-3)
    table = read_eddy(directory)
    assert found.eddy_W.sum() == pytest.approx(table.losses(0, np.array([1000.0]), np.array([0.3])).sum())
    assert found.eddy_W[found.names.index("winding")] == 0.0
    assert found.network.outwards @ (found.temperatures_C - 20.0) == pytest.approx(found.heat_W.sum())
    assert (found.temperatures_C > copper.temperatures_C).all()


@pytest.mark.parametrize(
    "given",
    [
        *({"frequency_Hz": one, "distance_m": 1e-3} for one in (0.0, -100.0, np.nan, 1e9)),
        {"frequency_Hz": 100.0, "distance_m": 0.01},  # beyond the sweep
        {"frequency_Hz": 100.0, "distance_m": 1e-3, "alternating_A": 0.0},
    ],
)
def test_what_eddy_heat_cannot_be_told_of_is_refused(swept, given):
    actuator, directory = swept
    with pytest.raises(UsageError):
        find_temperatures(actuator, **{"alternating_A": 0.3, "sweep": directory} | given)


def test_a_frequency_needs_a_sweep_of_the_drawing_with_eddy_currents(swept, tmp_path):
    actuator, directory = swept
    at = {"alternating_A": 0.3, "frequency_Hz": 100.0}
    with pytest.raises(MissingPartError, match="frequency_Hz"):
        find_temperatures(actuator, **at, sweep=tmp_path)
    fixed = tuple(replace(one, material=replace(one.material, name="other")) for one in actuator.fixed)
    other = replace(actuator, fixed=fixed, moving=replace(actuator.moving, regions=()))
    with pytest.raises(UsageError):
        find_temperatures(other, **at, sweep=directory, distance_m=1e-3)
