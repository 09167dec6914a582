"""Field solutions of one actuator, solved once for all tests of the study of the diagnosis."""

from pathlib import Path

import pytest

from femfit.device.load import read_actuator
from support.trial import FAMILIES
from support.trial_study.truth.families import load_truth


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """The study's own truths take two minutes of field solutions; the command's bench is tested without them."""
    for item in items:
        if "rig_truth" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.long)


@pytest.fixture(scope="session")
def trial_directory(tmp_path_factory):
    """Of a small trial, with the rig's drawing: fewer points in its sweep, which is smooth."""
    directory = tmp_path_factory.mktemp("trial")
    text = (Path(__file__).parents[2] / "geometry" / "emaws-rig.toml").read_text()
    for old, new in (("step = 0.2 }", "step = 0.7 }"), ("step = 0.5 }", "step = 1.5 }")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (directory / "rig.toml").write_text(text)
    return directory


@pytest.fixture(scope="session")
def rig_truth(trial_directory):
    return load_truth(read_actuator(trial_directory / "rig.toml"), trial_directory / "tables", FAMILIES, workers=1)
