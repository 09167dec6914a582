"""The coordinate of a body between two gaps: its slopes, and that only several circuits have it."""

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.model.bspline import TensorSpline
from femfit.model.coordinate import DistanceCoordinate

TWO_GAPS = DistanceCoordinate(0.5e-3, inverse=False, stretch_m=0.2e-3)


def test_slopes_are_those_of_the_coordinate_and_the_distance_comes_back():
    d, step = np.linspace(0.1e-3, 0.9e-3, 9), 1e-8
    u, slope, bend = TWO_GAPS.with_slopes(d)
    np.testing.assert_allclose(TWO_GAPS.distance(u), d, rtol=1e-12)
    np.testing.assert_allclose(slope, (TWO_GAPS.of(d + step) - TWO_GAPS.of(d - step)) / (2 * step), rtol=1e-6)
    slopes = [TWO_GAPS.with_slopes(d + change)[1] for change in (step, -step)]
    np.testing.assert_allclose(bend, (slopes[0] - slopes[1]) / (2 * step), rtol=1e-5, atol=1.0)


def test_a_spline_of_one_current_is_refused_in_it():
    knots = np.array([-3.0, -3.0, 3.0, 3.0])
    spline = TensorSpline(knots, knots, 1, 1, np.ones((2, 2)))
    place = np.array([0.4e-3])
    with pytest.raises(DomainError, match="two gaps"):
        TWO_GAPS.partial_derivatives(spline, place, place, ((1, 0),))
    with pytest.raises(DomainError, match="two gaps"):
        TWO_GAPS.in_floats()
