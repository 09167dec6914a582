"""Field solutions of one actuator, solved once for all tests of the trial."""

from pathlib import Path

import pytest

from femfit.actuator.load import read_actuator
from femfit.trial.truth.families import load_truth

GEOMETRY = Path(__file__).parents[2] / "geometry"


@pytest.fixture(scope="session")
def rig_truth(tmp_path_factory):
    actuator = read_actuator(GEOMETRY / "emaws-rig.toml")
    return load_truth(actuator, tmp_path_factory.mktemp("tables"), {"core", "magnets", "layer", "ring"}, workers=1)
