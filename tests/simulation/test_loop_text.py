"""What the design of a loop says of its margins."""

from dataclasses import replace

import pytest

from femfit.device.sensors import PositionSensor
from femfit.simulation.constants import WANTED_MODULUS
from femfit.simulation.design import design_loop
from femfit.simulation.loop_text import design_lines

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
