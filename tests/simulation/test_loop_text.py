"""What the design of a loop says of its margins."""

import pytest

from femfit.estimate.noise import ConsistencyBand
from femfit.simulation.design import design_loop
from femfit.simulation.loop_text import TOO_CAUTIOUS, consistency_line, observed_lines
from femfit.simulation.study_rows import HoldRow


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
