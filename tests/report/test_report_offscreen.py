"""Drawing without a screen: a child that dies costs one picture."""

import re

import pytest

from femfit.report.cutaway import VARIABLE, cropped, draw_off_screen

DYING = "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n"
RAISING = "raise ImportError('libGL.so.1')\n"
HANGING = "import time\ntime.sleep(60)\n"


def child_imports(monkeypatch, tmp_path, source):
    """Let the child, and only it, import this instead of pyvista."""
    (tmp_path / "pyvista.py").write_text(source)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


@pytest.mark.parametrize(
    ("source", "reason", "timeout"),
    [
        (DYING, "killed by signal 11", 60.0),
        (RAISING, "ended with code 1", 60.0),
        (HANGING, r"no picture within 2 s", 2.0),
    ],
    ids=["segmentation fault", "import error", "endless"],
)
def test_a_child_that_fails_leaves_a_reason_and_this_process_alive(
    rig_content, monkeypatch, tmp_path, source, reason, timeout
):
    child_imports(monkeypatch, tmp_path, source)
    monkeypatch.setenv(VARIABLE, "vtkEGLRenderWindow")
    result = draw_off_screen(rig_content.actuator, rig_content.field, timeout=timeout)
    assert result.image is None
    assert re.search(reason, result.how)


def test_each_window_is_tried_when_none_is_asked_for(rig_content, monkeypatch, tmp_path):
    child_imports(monkeypatch, tmp_path, DYING)
    monkeypatch.delenv(VARIABLE, raising=False)
    result = draw_off_screen(rig_content.actuator, rig_content.field)
    assert result.how.count("killed by signal 11") == 2


def test_the_window_of_the_environment_is_the_only_one_tried(rig_content, monkeypatch, tmp_path):
    child_imports(monkeypatch, tmp_path, DYING)
    monkeypatch.setenv(VARIABLE, "vtkMyRenderWindow")
    result = draw_off_screen(rig_content.actuator, rig_content.field)
    assert result.how.count("killed by signal") == 1
    assert "vtkMyRenderWindow" in result.how


def test_a_window_that_works_gives_a_picture_in_colour(rig_content, monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    result = draw_off_screen(rig_content.actuator, rig_content.field)
    if result.image is None:
        pytest.skip(result.how)
    from matplotlib.image import imread

    (tmp_path / "picture.png").write_bytes(result.image)
    image = imread(tmp_path / "picture.png")[..., :3]
    assert min(image.shape[:2]) > 300
    assert (image.max(axis=2) - image.min(axis=2) > 0.3).mean() > 0.01  # the magnet and |B| are coloured


def test_margins_are_cropped_to_what_is_drawn():
    import numpy as np

    image = np.full((100, 120, 3), 255, dtype=np.uint8)
    image[40:50, 60:80] = 10
    assert cropped(image).shape == (26, 36, 3)  # 10 x 20 pixels and 8 on each side
