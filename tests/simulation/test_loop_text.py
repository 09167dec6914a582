"""What the design of a loop says of its margins."""

from dataclasses import replace

import pytest

from femfit.device.sensors import PositionSensor
from femfit.filters.theory import ConsistencyBand
from femfit.simulation.constants import WANTED_MODULUS
from femfit.simulation.design import design_loop
from femfit.simulation.loop_text import TOO_CAUTIOUS, consistency_line, design_lines, observed_lines
from femfit.simulation.study_rows import HoldRow

LASER = PositionSensor(name="laser", noise=4e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")


@pytest.mark.parametrize(("sensor", "short"), [("hall", False), ("laser", True)])
def test_backstepping_says_where_it_keeps_less_margin_than_others_are_tuned_for(levitation_model, sensor, short):
    """With a laser the filter trusts its model more and leaves less."""
    model = replace(levitation_model, other_sensors=(LASER,), reference_distances_m=(0.026,))
    design = design_loop(model, sensors=(sensor,))
    least = min(one.modulus for one in design.margins("backstepping", "ekf"))
    assert (least < WANTED_MODULUS) == short
    given = replace(design, given={"backstepping": design.backstepping})
    lines, without = (len(design_lines(one, [("backstepping", "ekf")])) for one in (design, given))
    # Gains that were given are the user's own
    assert lines - without == short


def hold(quality):
    """A row of a filter at rest whose predictions are this far from what it expects."""
    nan = float("nan")
    return HoldRow("pid", "ukf", 0.02, nan, 1e-5, nan, nan, quality, ConsistencyBand(0.95, 1.05), 16, 16)


@pytest.mark.parametrize(
    ("qualities", "praised", "cautious"),
    [((1.0, 0.99), True, False), ((0.66, 0.69), False, True), ((1.5, 1.6), False, False), ((1.0, 0.9), False, False)],
)
def test_innovations_below_their_band_are_called_those_of_a_cautious_filter(qualities, praised, cautious):
    said = consistency_line([hold(each) for each in qualities])
    assert ("knows its own error" in said) == praised
    assert (TOO_CAUTIOUS in said) == cautious


def test_the_filters_own_expectation_is_no_bound_of_what_sensors_allow(levitation_model):
    (line,) = observed_lines(design_loop(levitation_model))
    assert "at best" not in line
    assert "process noises" in line
