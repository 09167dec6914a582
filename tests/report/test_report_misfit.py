"""Measured points on the model's curves, both misfits, and what is left unexplained, as pictures."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.comparison.misfit import MeasuredCurves
from femfit.identify.readings.bench import placed
from femfit.model.bspline import TensorSpline
from femfit.model.carried import (
    Brake,
    Carried,
    Curve,
    FieldChange,
    FieldTerm,
    FurtherResistance,
    ReadingChange,
    SettingChange,
    bounded_basis,
    carried_effect,
)
from femfit.model.coordinate import DistanceCoordinate
from femfit.report.explained_figures import remainder_figure
from femfit.report.misfit_figures import curves_figure, worst_first
from femfit.report.style import style
from support.campaign import campaign


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


def test_every_part_has_its_panel(levitation_model):
    share = EffectParameter("share", bounds=(0.0, 1.0), plausible=(0.0, 1.0), description="How much of it.")
    knots, expand = bounded_basis(0.02, 0.04, cells=3, degree=3)
    every = expand @ np.linspace(0.0, 1e-3, expand.shape[1])
    curve = Curve("share", knots, 3, every)
    spline = TensorSpline(knots, np.array([-9.0, 9.0]), 3, 0, every[:, None])
    term = FieldTerm("share", DistanceCoordinate(1.0, inverse=False), spline, spline)
    carried = Carried(
        FieldChange((term,)),
        SettingChange(curve, curve),
        ReadingChange({"force_N": curve, "flux_linkage_Wb": curve, "hall_V": curve}, {"force_N": curve}),
        Brake(curve, 1e-3),
        FurtherResistance(curve),
    )
    added = AddedEffect(carried_effect("unexplained", "It is not known.", [share], carried), {"share": 1.0})
    observations = placed(levitation_model, campaign(levitation_model, 3, distances=7, currents=5))
    with style():
        axes = [ax for ax in remainder_figure(added, observations).axes if ax.get_xlabel()]
    said = [ax.get_title(loc="left") or ax.get_ylabel() for ax in axes]
    assert len(said) == len(set(said)) == 11
    # The force of dW' is its slope with the other sign, drawn in its own unit
    drawn = next(ax for ax in axes if ax.get_title(loc="left").startswith("force"))
    d = np.linspace(0.02, 0.04, 5)
    slope = (curve.at(d + 1e-7, {"share": 1.0}) - curve.at(d - 1e-7, {"share": 1.0})) / 2e-7
    low, high = drawn.collections[0].get_clim()
    assert high == -low
    assert high == pytest.approx(1e3 * np.abs(slope).max(), rel=0.1)
    assert "(mN)" in drawn.get_title(loc="left")
