"""``femfit new``."""

import tomllib
from typing import get_args

import pytest

from femfit.cli.new import Kind
from femfit.device.load import read_actuator
from femfit.device.starters import starter_names
from support.command import femfit


def test_every_drawing_can_be_asked_for():
    assert get_args(Kind) == starter_names()


@pytest.mark.parametrize("kind", starter_names())
def test_a_drawing_is_read_under_the_name_of_its_file(kind, tmp_path):
    path = tmp_path / "mine.toml"
    done = femfit("new", kind, "-o", path)
    assert done.returncode == 0, done.stderr
    assert "femfit run" in done.stdout
    assert read_actuator(path).name == "mine"
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    assert tables["schema"] == 2
    assert not {"electromagnet", "coil", "hall"} & set(tables)  # the tables of schema 1
    assert "mass_g" not in tables.get("moving", {})


def test_a_file_that_is_there_is_kept(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("mine")
    done = femfit("new", "ball", "-o", path)
    assert done.returncode == 1
    assert path.read_text() == "mine"


def changed(path, numbers):
    """Make a drawing a quick one."""
    text = path.read_text()
    for old, new in numbers.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text + "\n[solver]\ntolerance = 0.1\n")


def test_a_pair_of_magnets_runs_from_its_drawing_to_its_report(tmp_path):
    path = tmp_path / "pair.toml"
    assert femfit("new", "magnet-pair", "-o", path).returncode == 0
    changed(path, {"[0.1, 0.5, 1, 2, 5, 10, 15, 20, 30, 40]": "[1, 2, 5, 10, 15, 20, 40]"})
    done = femfit("run", path, "-o", tmp_path / "run", "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert "the drawing has no coil" in done.stdout
    assert "There is no coil" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_bearing_of_two_coils_runs_from_its_drawing_to_its_report_and_pictures(tmp_path):
    path = tmp_path / "bearing.toml"
    assert femfit("new", "bearing", "-o", path).returncode == 0
    # Six distances, and an eighth of the loops' steps
    changed(path, {"step = 0.05": "step = 0.12", "sample_time_ms = 0.1": "sample_time_ms = 0.8"})
    done = femfit("run", path, "-o", tmp_path / "run", "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert "several circuits" in done.stdout
    assert "The circuits together" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    picture = ("view", tmp_path / "run", "--what", "flux-density", "-o", tmp_path / "field.png")
    done = femfit(*picture, "--current-A", 1, "--current-A", -1)
    assert done.returncode == 0, done.stderr
    assert "i = 1 and −1 A" in done.stdout
    refused = femfit(*picture, "--current-A", 1)
    assert refused.returncode != 0
    assert "lower, upper" in refused.stderr
