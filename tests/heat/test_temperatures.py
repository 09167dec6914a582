"""What is found of a drawing's temperatures."""

import math
from dataclasses import replace

import pytest

from femfit.core.errors import MissingPartError, UsageError
from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT as ALPHA
from femfit.device.load import read_actuator
from femfit.heat.find_temperatures import find_temperatures
from support.actuators import GEOMETRY

RIG = GEOMETRY / "emaws-rig.toml"


@pytest.fixture(scope="module")
def rth():
    """Rise of the winding's mean in K for each watt in it."""
    found = find_temperatures(RIG, current_A=1e-3, distance_m=0.022)
    return float((found.windings_C[0] - 20.0) / found.heat_W.sum())


def test_a_held_voltage_settles_where_the_quadratic_equation_says(rth):
    """(1 + alpha x) x = R_th U^2 / R."""
    ohm, found = 2.69, find_temperatures(RIG, voltage_V=3.0)
    rise = (math.sqrt(1.0 + 4.0 * ALPHA * rth * 9.0 / ohm) - 1.0) / (2.0 * ALPHA)
    assert found.windings_C[0] - 20.0 == pytest.approx(rise, rel=1e-5)
    assert found.currents_A[0] == pytest.approx(3.0 / (ohm * (1.0 + ALPHA * rise)), rel=1e-5)


def test_a_held_current_settles_higher_and_runs_away_at_its_limit(rth):
    found = find_temperatures(RIG, current_A=1.0)
    assert found.windings_C[0] - 20.0 == pytest.approx(rth * 2.69 / (1.0 - ALPHA * rth * 2.69), rel=1e-4)
    limit = 1.0 / math.sqrt(ALPHA * rth * 2.69)
    assert find_temperatures(RIG, current_A=0.999 * limit).settles
    gone = find_temperatures(RIG, current_A=1.001 * limit)
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


@pytest.mark.parametrize(
    "given",
    [
        {"current_A": 1.0, "voltage_V": 1.0},
        {"current_A": (1.0, 2.0)},
        {"current_A": 1e300},
        {"current_A": 1.0, "distance_m": math.nan},
        {"current_A": 1.0, "distance_m": -1e-3},
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
