"""Drawings: half section to full section, and every part of actuators of schema 2."""

from importlib.resources import files

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from femfit.device.load import actuator_from_toml, starter_text
from femfit.report.drawing import actuator_figure, drawn_parts, full_section
from support.actuators import rectangle

STARTERS = sorted(path.stem for path in (files("femfit.device") / "examples").iterdir())


def test_a_half_section_across_the_axis_becomes_one_outline():
    tee = ((0.0, -0.02), (0.015, -0.02), (0.015, -0.015), (0.005, -0.015), (0.005, 0.0), (0.0, 0.0))
    (outline,) = full_section(np.add(tee, (0.0, 0.01)))
    assert shapely.Polygon(outline).area == pytest.approx(2.0 * shapely.Polygon(tee).area)
    np.testing.assert_allclose([outline.min(axis=0), outline.max(axis=0)], [[-0.015, -0.01], [0.015, 0.01]])


@given(
    inner=st.just(0.0) | st.floats(1e-6, 0.01),
    width=st.floats(1e-3, 0.02),
    low=st.floats(-0.03, 0.03),
    height=st.floats(1e-3, 0.03),
)
def test_the_full_section_is_symmetric_and_twice_as_large(inner, width, low, height):
    parts = [shapely.Polygon(p) for p in full_section(np.array(rectangle(inner, inner + width, low, low + height)))]
    whole = shapely.union_all(parts)
    other = shapely.affinity.scale(whole, xfact=-1.0, yfact=1.0, origin=(0.0, 0.0))
    assert whole.area == pytest.approx(2.0 * width * height)
    assert whole.symmetric_difference(other).area < 1e-9 * whole.area


@pytest.mark.parametrize("name", STARTERS)
def test_every_starter_is_drawn_with_all_its_parts(name):
    actuator = actuator_from_toml(starter_text(name))
    distance = actuator.sweep.distances_m[0]
    figure = actuator_figure(actuator, distance, "name: geometry\nd = 1 mm, i = 1 A, F = 1 N, attracted")
    figure.draw_without_rendering()
    assert figure.axes[0].yaxis.label.get_window_extent().x0 > 0.0  # within the picture, under two lines of title
    parts = len(actuator.fixed) + len(actuator.coils) + len(actuator.moving.regions)
    assert len(drawn_parts(actuator, distance)) == parts
    assert figure.axes[0].patches


def test_a_radial_magnet_points_outwards_on_both_sides():
    text = starter_text("magnet-pair").replace('"+z" # "-z" here, and they repel', '"+r"')
    text = text.replace("[0, 22.5]\nz_mm = [-30", "[10, 22.5]\nz_mm = [-30")
    notes = actuator_figure(actuator_from_toml(text), 0.01).axes[0].texts
    arrows = [note for note in notes if getattr(note, "arrow_patch", None) is not None and not note.get_text()]
    white = [note for note in arrows if note.arrow_patch.get_edgecolor()[:3] == (1.0, 1.0, 1.0)]
    outwards = {np.sign(note.xyann[0]) for note in white if abs(note.xyann[0]) < abs(note.xy[0])}
    assert outwards == {1.0, -1.0}
