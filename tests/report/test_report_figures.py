"""Figures as a notebook gets them, those of a misfit among them, and pictures drawn without a screen."""

import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from femfit.core.errors import UsageError
from femfit.identify.misfit import MeasuredCurves
from femfit.report.cutaway import draw_off_screen
from femfit.report.drawing import actuator_figure
from femfit.report.field_figures import colour_limit, field_figure, flux_levels
from femfit.report.figures import figures_of
from femfit.report.misfit_figures import SCALAR, curves_figure
from femfit.report.model_figures import at_supply, force_curves_figure, hall_figure, stroke_figure, sweep_grid
from femfit.report.motion_figures import closed_loop_figure
from femfit.report.style import quantity, svg_uri, words

PREFIX = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6}
POWER = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
WITH_UNIT = re.compile(r"\([^()]*(mm|A|V|N|T|H|%|s|Hz|µm)[^()]*\)")


def test_axes_are_labelled_with_units(rig_content):
    model, rows = rig_content.model, rig_content.fit.rows
    for figure in (
        actuator_figure(rig_content.actuator, 0.022),
        field_figure(rig_content.actuator, rig_content.field),
        stroke_figure(at_supply(model), model.motion),
        force_curves_figure(sweep_grid(rows), rows.weight),
        hall_figure(model, rows),
        closed_loop_figure(rig_content.study.loops[0]),
    ):
        labels = [axis.get_label_text() for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
        assert any(labels)
        assert all(WITH_UNIT.search(label) for label in labels if label), labels


def test_a_study_draws_each_loop_that_held_a_run(rig_content, lost_study):
    assert set(figures_of(rig_content.study)) == {"steps-backstepping", "steps-pid", "steps-state-feedback"}
    assert len(rig_content.study.plot("steps-pid").axes) == 3
    assert figures_of(lost_study) == {}
    with pytest.raises(UsageError, match="nothing to draw of <ClosedLoopStudy: Lost"):
        lost_study.plot()


def test_figures_leave_matplotlib_as_it_was_and_give_the_same_bytes_again(rig_content):
    before, model = dict(mpl.rcParams), rig_content.model
    one, two = (svg_uri(lambda: stroke_figure(at_supply(model), model.motion), "stroke") for _ in range(2))
    assert one == two
    assert dict(mpl.rcParams) == before
    if "matplotlib.pyplot" in sys.modules:
        assert sys.modules["matplotlib.pyplot"].get_fignums() == []


def test_flux_lines_are_equally_spaced_and_leave_the_axis_out(rig_content):
    for flux in (rig_content.field.flux_Wb, -rig_content.field.flux_Wb):
        levels = flux_levels(flux)
        np.testing.assert_allclose(np.diff(levels), np.diff(levels)[0])
        assert np.all(levels != 0.0)
        assert flux.min() < levels.min() <= levels.max() < flux.max()


def test_an_actuator_without_field_is_drawn_without_lines(rig_content):
    field = rig_content.field
    none = replace(field, flux_Wb=0.0 * field.flux_Wb, flux_density_T=0.0 * field.flux_density_T)
    assert flux_levels(none.flux_Wb).size == 0
    assert 0.0 < colour_limit(none) <= 1e-6
    field_figure(rig_content.actuator, none).draw_without_rendering()


@pytest.mark.parametrize(
    ("source", "reason", "timeout"),
    [
        ("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)", "killed by signal 11", 60.0),
        ("raise ImportError('libGL.so.1')", "ended with code 1", 60.0),
        ("import time\ntime.sleep(60)", "no picture within 0.5 s", 0.5),
    ],
    ids=["segmentation fault", "import error", "endless"],
)
def test_a_child_that_fails_leaves_a_reason_and_this_process_alive(
    rig_content, monkeypatch, tmp_path, source, reason, timeout
):
    (tmp_path / "pyvista.py").write_text(source)  # which the child, and only it, imports
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    image, why = draw_off_screen(rig_content.actuator, rig_content.field, timeout=timeout)
    assert image is None
    assert reason in why


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


X, LEVEL = np.linspace(0.01, 0.03, 9), np.arange(9) % 2
CURVES = MeasuredCurves(
    channel="force_N",
    along="distance_m",
    over="current_A",
    levels=np.array([0.0, 1.0]),
    axis=X,
    before=np.array([1e-3 / X, 2e-3 / X]),
    after=np.array([1.1e-3 / X, 2.2e-3 / X]),
    x=X,
    level=LEVEL,
    measured=1.1e-3 * (1 + LEVEL) / X,
    misfit_before=1e-4 * (1 + LEVEL) / X,
    misfit_after=np.zeros(9),
    noise=1e-4,
)


def axes_of(curves, effects=()):
    """What is drawn of a result with these curves, of which a figure asks no more."""
    return curves_figure(SimpleNamespace(curves={"force_N": curves}, effects=effects), "force_N").axes


def test_readings_stand_on_both_sets_of_curves_in_one_scale():
    every = axes_of(CURVES, ("found",))
    assert every[0].get_ylim() == every[1].get_ylim()
    for axes in every[:2]:
        drawn = np.concatenate([line.get_ydata() for line in axes.get_lines() if line.get_marker() == "o"])
        np.testing.assert_allclose(np.sort(drawn), np.sort(1e3 * CURVES.measured))  # in mN
    below = [np.concatenate([line.get_ydata() for line in axes.get_lines()[:2]]) for axes in every[2:]]
    assert np.abs(below[0]).max() > 0.0
    np.testing.assert_array_equal(below[1], 0.0)


def test_a_record_has_points_without_curves_and_without_anything_added_one_column():
    assert len(axes_of(CURVES)) == 2
    none = replace(CURVES, before=np.zeros((0, 9)), after=np.zeros((0, 9)))
    assert {line.get_marker() for line in axes_of(none)[0].get_lines()} == {"o"}


@pytest.mark.parametrize("covariate", SCALAR)
def test_each_covariate_of_a_misfit_has_its_label(covariate):
    assert words("covariates", covariate)


@given(st.floats(1e-12, 1e8), st.integers(2, 6), st.sampled_from([1.0, -1.0]))
def test_a_quantity_read_again_is_the_value_to_its_digits(magnitude, digits, sign):
    written, unit = quantity(sign * magnitude, "T", digits).split("\u00a0")
    mantissa, _, power = written.replace("−", "-").partition("·10")
    read = float(mantissa) * 10.0 ** float(power.translate(POWER) or 0) * PREFIX[unit.removesuffix("T")]
    assert read == pytest.approx(sign * magnitude, rel=0.51 * 10 ** (1 - digits))
