"""The picture of measured points on the model's curves shows the readings and both misfits as they are."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.identify.comparison.misfit import MeasuredCurves
from femfit.report.misfit_figures import curves_figure, worst_first


@pytest.fixture
def curves():
    x = np.linspace(0.01, 0.03, 9)
    level = np.arange(9) % 2
    return MeasuredCurves(
        channel="force_N",
        along="distance_m",
        over="current_A",
        levels=np.array([0.0, 1.0]),
        axis=x,
        before=np.array([1e-3 / x, 2e-3 / x]),
        after=np.array([1.1e-3 / x, 2.2e-3 / x]),
        x=x,
        level=level,
        measured=1.1e-3 * (1 + level) / x,
        misfit_before=1e-4 * (1 + level) / x,
        misfit_after=np.zeros(9),
        noise=1e-4,
    )


def test_readings_stand_on_both_sets_of_curves_in_one_scale(curves):
    figure = curves_figure(curves, fitted=True)
    above = figure.axes[:2]
    assert above[0].get_ylim() == above[1].get_ylim()
    for axes in above:
        drawn = np.concatenate([line.get_ydata() for line in axes.get_lines() if line.get_marker() == "o"])
        np.testing.assert_allclose(np.sort(drawn), np.sort(1e3 * curves.measured))  # in mN
    below = [np.concatenate([line.get_ydata() for line in axes.get_lines()[:2]]) for axes in figure.axes[2:]]
    assert np.abs(below[0]).max() > 0.0
    np.testing.assert_array_equal(below[1], 0.0)


def test_without_anything_added_there_is_one_column(curves):
    assert len(curves_figure(curves, fitted=False).axes) == 2


def test_a_record_over_time_has_points_without_curves(curves):
    none = replace(curves, before=np.zeros((0, 9)), after=np.zeros((0, 9)))
    lines = curves_figure(none, fitted=False).axes[0].get_lines()
    assert {line.get_marker() for line in lines} == {"o"}


def test_the_channel_that_misses_by_most_of_its_noise_comes_first(curves):
    small = replace(curves, channel="hall_V", misfit_before=0.1 * curves.misfit_before)
    assert [one.channel for one in worst_first([small, curves])] == ["force_N", "hall_V"]
