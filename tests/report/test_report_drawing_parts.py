"""Drawings of actuators of schema 2: moving coils, balls, radial magnets, no coil at all."""

import numpy as np
import pytest

from femfit.device.load import actuator_from_toml, starter_names, starter_text
from femfit.report.drawing import actuator_figure
from femfit.report.parts import half_sections, moving_corners


@pytest.mark.parametrize("name", starter_names())
def test_every_starter_is_drawn_with_all_its_parts(name):
    actuator = actuator_from_toml(starter_text(name))
    distance = actuator.sweep.distances_m[0]
    figure = actuator_figure(actuator, distance)
    parts = len(actuator.fixed) + len(actuator.coils) + len(actuator.moving.regions)
    assert len(half_sections(actuator, distance)) == parts
    assert figure.axes[0].patches


def test_a_moving_coil_is_drawn_where_it_stands():
    actuator = actuator_from_toml(starter_text("voice-coil"))
    assert moving_corners(actuator, -0.006)[:, 1].min() == pytest.approx(-0.006)
    (winding,) = [shift for _, shift, kind in half_sections(actuator, -0.006) if kind == "winding"]
    assert winding == -0.006


def test_a_ball_is_drawn_round():
    actuator = actuator_from_toml(starter_text("ball"))
    corners = moving_corners(actuator, 0.0)
    np.testing.assert_allclose(np.hypot(corners[:, 0], corners[:, 1] - 0.0125), 0.0125, rtol=1e-9)


def test_a_radial_magnet_points_outwards_on_both_sides():
    text = (
        starter_text("magnet-pair")
        .replace('"+z" # "-z" here, and they repel', '"+r"')
        .replace("[0, 22.5]\nz_mm = [-30", "[10, 22.5]\nz_mm = [-30")
    )
    figure = actuator_figure(actuator_from_toml(text), 0.01)
    arrows = [
        note for note in figure.axes[0].texts if getattr(note, "arrow_patch", None) is not None and not note.get_text()
    ]
    ends = [(note.xyann[0], note.xy[0]) for note in arrows if note.arrow_patch.get_edgecolor()[:3] == (1.0, 1.0, 1.0)]
    assert any(start < end for start, end in ends if start > 0)
    assert any(start > end for start, end in ends if start < 0)
