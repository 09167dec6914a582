"""What a loop says of innovations that lie beside their band."""

from dataclasses import replace

import pytest

import femfit as ff
from femfit.estimate.noise import default_noise
from femfit.model.validity import ProcessNoise

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
