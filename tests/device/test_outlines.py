"""Outlines of straight edges and arcs."""

import math

import pytest
import shapely

from femfit.device.outlines import arc_circle, arc_points, circle, flattened, reversed_outline


@pytest.mark.parametrize(("centre", "area"), [((0.0, 3.0), 2.0 * math.pi), ((5.0, 1.0), 4.0 * math.pi)])
def test_a_circle_has_its_area_and_turns_counter_clockwise(centre, area):
    polygon = shapely.Polygon(flattened(*circle(centre, 2.0)))
    assert polygon.exterior.is_ccw
    assert polygon.area == pytest.approx(area, rel=3e-4)
    assert polygon.bounds[0] >= 0.0


def test_the_other_sense_is_the_same_outline():
    corners, bulges = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)], [0.3, 0.0, -0.2, 0.0]
    there = shapely.Polygon(flattened(corners, bulges))
    back = shapely.Polygon(flattened(*reversed_outline(corners, bulges)))
    assert not back.exterior.is_ccw
    assert there.symmetric_difference(back).area < 1e-12


def test_neighbours_share_the_points_of_an_arc():
    there = arc_points((1.0, 0.0), (0.0, 1.0), 0.4)
    back = arc_points((0.0, 1.0), (1.0, 0.0), -0.4)
    for one, other in zip(there, back[::-1], strict=True):
        assert one == pytest.approx(other, abs=1e-14)


def test_a_quarter_circle_has_its_centre():
    centre, radius = arc_circle((2.0, 0.0), (0.0, 2.0), math.tan(math.pi / 8.0))
    assert centre == pytest.approx((0.0, 0.0), abs=1e-12)
    assert radius == pytest.approx(2.0)
