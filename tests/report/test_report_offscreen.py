"""Drawing without a screen: a child that dies costs one picture."""

import re

import pytest

from femfit.report.cutaway import draw_off_screen

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
        (HANGING, r"no picture within 0.5 s", 0.5),
    ],
    ids=["segmentation fault", "import error", "endless"],
)
def test_a_child_that_fails_leaves_a_reason_and_this_process_alive(
    rig_content, monkeypatch, tmp_path, source, reason, timeout
):
    child_imports(monkeypatch, tmp_path, source)
    image, why = draw_off_screen(rig_content.actuator, rig_content.field, timeout=timeout)
    assert image is None
    assert re.search(reason, why)


@pytest.mark.nightly
def test_where_vtk_can_draw_the_picture_is_cropped_and_in_colour(rig_content, tmp_path):
    drawn, why = draw_off_screen(rig_content.actuator, rig_content.field)
    if drawn is None:
        pytest.skip(why)
    from matplotlib.image import imread

    (tmp_path / "picture.png").write_bytes(drawn)
    image = imread(tmp_path / "picture.png")[..., :3]
    assert min(image.shape[:2]) > 300
    assert (image.max(axis=2) - image.min(axis=2) > 0.3).mean() > 0.01  # the magnet and |B| are coloured
