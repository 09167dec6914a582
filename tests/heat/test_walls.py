"""What the faces of parts look at."""

import numpy as np
import pytest
import shapely

from femfit.heat.walls import NOTHING, OPEN, faces_of


def conductance(faces, one, other):
    """Area over gap, of all rays from one part to another."""
    met = (faces.part == one) & (faces.facing == other)
    return np.sum(faces.area[met] / faces.gap[met])


def test_a_cylindrical_gap_conducts_as_its_closed_form():
    parts = [shapely.box(0.0, 0.0, 0.005, 0.02), shapely.box(0.007, 0.0, 0.009, 0.02)]
    exact = 2.0 * np.pi * 0.02 / np.log(7.0 / 5.0)
    faces = faces_of(parts, 0.003)
    assert conductance(faces, 0, 1) == pytest.approx(exact, rel=1e-6)
    assert conductance(faces, 1, 0) == pytest.approx(exact, rel=1e-6)


def test_parts_that_touch_face_each_other_without_a_gap():
    parts = [shapely.box(0.0, 0.0, 0.005, 0.02), shapely.box(0.005, 0.0, 0.009, 0.02)]
    faces = faces_of(parts, 0.003)
    met = (faces.part == 0) & (faces.facing == 1)
    assert not faces.gap[met].any()
    assert faces.area[met].sum() == pytest.approx(2.0 * np.pi * 0.005 * 0.02, rel=1e-6)


def test_a_ball_is_free_all_round():
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    ball = shapely.Polygon(0.01 * np.column_stack([np.cos(angle), np.sin(angle)]))
    faces = faces_of([ball], 0.005)
    assert (faces.facing == OPEN).all()
    assert faces.area.sum() == pytest.approx(4.0 * np.pi * 0.01**2, rel=1e-3)  # chords of 1 degree, and the pole's hole


@pytest.mark.parametrize(("mouth", "found"), [(0.002, NOTHING), (0.006, OPEN)])
def test_a_pocket_is_open_where_a_disc_as_wide_as_the_widest_gap_gets_in(mouth, found):
    """A ring-shaped pocket of 10 mm by 10 mm in a block, with a slit to the outside."""
    block = shapely.box(0.005, 0.0, 0.03, 0.02) - shapely.box(0.01, 0.005, 0.02, 0.015)
    block -= shapely.box(0.02, 0.01 - 0.5 * mouth, 0.03, 0.01 + 0.5 * mouth)
    faces = faces_of([block], 0.005)
    inner = 2.0 * np.pi * 0.01 * 0.01  # the pocket's wall next to the axis
    outer = 2.0 * np.pi * (0.03**2 - 0.005**2 + 0.03 * (0.02 - mouth) + 0.005 * 0.02)
    free = faces.area[faces.facing == OPEN].sum()
    assert (free > outer + 0.9 * inner) == (found == OPEN)
    if found == NOTHING:
        seen = 2.0 * np.pi * 0.01 * mouth  # of the pocket's wall, which looks out through the slit
        assert free == pytest.approx(outer + seen, rel=2e-3)


def test_a_wide_pocket_that_is_closed_counts_as_the_widest_gap():
    lid, pot = (
        shapely.box(0.0, 0.02, 0.02, 0.022),
        shapely.box(0.0, -0.002, 0.02, 0.02) - shapely.box(0, 0, 0.018, 0.02),
    )
    faces = faces_of([lid, pot], 0.005)
    down = (faces.part == 0) & (faces.side == 2) & (faces.gap > 0.0)
    assert set(faces.gap[down]) == {0.005}
    assert (faces.facing[down] == 1).all()
