"""``femfit sweep --signatures``: what it says, and what the fit makes of it."""

import json

import pytest

from support.actuators import GEOMETRY
from support.command import femfit
from support.small_drawing import SMALL


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    directory = tmp_path_factory.mktemp("signatures")
    (directory / "small.toml").write_text(SMALL)
    options = ("-o", directory / "run", "--workers", 1, "--signatures")
    return directory, femfit("sweep", directory / "small.toml", *options)


def test_the_sweep_says_what_matters_most_first(swept):
    _, result = swept
    assert result.returncode == 0, result.stderr
    _, _, after = result.stdout.partition("By one standard deviation of each number of the drawing")
    first, *_ = (line.strip() for line in after.splitlines()[1:])
    assert first.startswith("the remanence of hard +- 1.5 %: force ")
    assert "flux linkage" in first
    assert "Hall field" in first


def test_the_fit_keeps_the_numbers_in_the_model(swept):
    directory, _ = swept
    result = femfit("fit", directory / "run", "-o", directory / "model.json")
    assert result.returncode == 0, result.stderr
    assert "numbers of the drawing with what each of them changes" in result.stdout
    numbers = json.loads((directory / "model.json").read_text())["drawn"]
    assert {"key", "also", "subject", "value", "unit", "tolerance", "magnetics"} == set(numbers[0])


def test_a_drawing_that_sweeps_parameters_has_none(tmp_path):
    result = femfit("sweep", GEOMETRY / "emaws-variants.toml", "-o", tmp_path / "run", "--signatures")
    assert result.returncode == 1
    assert "Take one variant's drawing" in result.stderr
