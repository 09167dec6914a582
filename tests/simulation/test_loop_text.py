"""What a loop says of its margins and of innovations that lie beside their band."""

from dataclasses import replace

import pytest

import femfit as ff
from femfit.estimate.noise import ConsistencyBand, default_noise
from femfit.model.validity import ProcessNoise
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


ONE = {"estimator": "ukf", "runs": 6, "seconds": 0.25, "targets_m": (0.022,), "rng": 1}


@pytest.mark.parametrize(("scale", "below"), [(1e-2, False), (40.0, True)])
def test_errors_that_a_plant_does_not_have_are_named_as_the_cause_of_small_innovations(levitation_model, scale, below):
    """Process noise of forty times the model's own misfit, or none to speak of, in a plant without any."""
    own = default_noise(levitation_model)
    noise = ProcessNoise(own.acceleration_density * scale**2, float(own.voltage_V) * scale)
    loop = ff.close_loop(replace(levitation_model, process_noise=noise), **ONE)
    assert (loop.normalised_innovation_squared < loop.innovation_band.lower) == below
    assert loop.expects_absent_errors == below
    assert not replace(loop, plant="another").expects_absent_errors
    assert len(str(replace(loop, plant="another")).splitlines()) == len(str(loop).splitlines()) - below
