"""Designs and devices that the tests of loops share."""

from dataclasses import replace

import pytest

from femfit.simulation.design import design_loop
from support.readings import LASER_10_V


@pytest.fixture(scope="session")
def design(levitation_model):
    return design_loop(levitation_model)


@pytest.fixture(scope="session")
def optical(levitation_model):
    """The rig with a position sensor of 20 um, at 22 mm where its body runs away with 33 1/s."""
    return replace(levitation_model, sensor=None, other_sensors=(LASER_10_V,), reference_distances_m=(0.022,))
