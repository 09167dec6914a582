"""The paper's experiment at 1 kS/s."""

import numpy as np
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise


@pytest.fixture(scope="session")
def experiment():
    """Three cycles at 100 A/s."""
    return synthesise(ExperimentInputs(ramp_rate=100.0), np.random.default_rng(1))
