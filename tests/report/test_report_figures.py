"""Figures as a notebook gets them: plain functions that return matplotlib figures."""

import re
import subprocess
import sys
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

from femfit.report.drawing import actuator_figure
from femfit.report.field_figures import colour_limit, colours_of, field_figure, flux_levels
from femfit.report.force_figures import (
    changes_sign,
    coil_figure,
    force_curves_figure,
    force_map_figure,
    stroke_figure,
)
from femfit.report.loop_report import spectrum_figure, steps_figure
from femfit.report.model_figures import hall_figure, ranking_figure, residual_figure
from femfit.report.rating import rate, reciprocity, sweep_grid
from femfit.report.style import svg_uri

WITH_UNIT = re.compile(r"\([^()]*(mm|A|V|N|T|H|%|s|Hz|µm)[^()]*\)|operations")


def all_figures(content):
    """Every figure of the report."""
    fit, rows, study = content.fit, content.fit.rows, content.study
    grid = sweep_grid(rows)
    rating = rate(content.model, content.actuator, heat=content.heat)
    return {
        "actuator": actuator_figure(content.actuator, 0.022),
        "field": field_figure(content.actuator, content.field),
        "stroke": stroke_figure(rating, content.model.motion),
        "coil": coil_figure(rating),
        "force-map": force_map_figure(grid, rows.weight),
        "force-curves": force_curves_figure(grid, rows.weight),
        "ranking": ranking_figure(fit.ranking),
        "residuals": residual_figure(rows, [("model", content.model.force(rows.distance, rows.current))]),
        "hall": hall_figure(fit.model, rows),
        "steps": steps_figure(study.series[0]),
        "spectrum": spectrum_figure(study.spectra[0]),
    }


@pytest.fixture(scope="module")
def figures(rig_content):
    return all_figures(rig_content)


def test_axes_are_labelled_with_units(figures):
    for name, figure in figures.items():
        labels = [axis.get_label_text() for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
        labels = [label for label in labels if label]
        assert labels, name
        for label in labels:
            assert WITH_UNIT.search(label), (name, label)


def test_the_same_figure_gives_the_same_bytes(rig_content):
    one, two = (svg_uri(lambda: actuator_figure(rig_content.actuator, 0.022), "actuator") for _ in range(2))
    assert one == two


def test_matplotlibs_own_settings_are_left_as_they_were(rig_content):
    before = dict(mpl.rcParams)
    svg_uri(lambda: actuator_figure(rig_content.actuator, 0.022), "actuator")
    assert dict(mpl.rcParams) == before


def test_importing_the_report_loads_neither_matplotlib_nor_pyvista():
    code = (
        "import sys, femfit.report.write; print([m for m in ('matplotlib', 'pyvista', 'ngsolve') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_figures_keep_no_state_in_pyplot(figures):
    assert figures
    if "matplotlib.pyplot" in sys.modules:
        assert sys.modules["matplotlib.pyplot"].get_fignums() == []


def test_the_ranking_has_a_bar_for_each_fitted_law_with_the_recommended_one_marked(figures, rig_content):
    ranking, (axes,) = rig_content.fit.ranking, figures["ranking"].axes
    fitted = [c for c in ranking.candidates if c.fit is not None]
    assert len(axes.patches) == len(fitted)
    ends = [bar.get_x() + bar.get_width() for bar in axes.patches]
    np.testing.assert_allclose(ends, [100.0 * c.error for c in fitted])
    marked = {bar.get_facecolor() for bar in axes.patches}
    assert len(marked) == 2


def test_flux_lines_are_equally_spaced_and_leave_the_axis_out(rig_content):
    for flux in (rig_content.field.flux_Wb, -rig_content.field.flux_Wb):
        levels = flux_levels(flux)
        np.testing.assert_allclose(np.diff(levels), np.diff(levels)[0])
        assert np.all(levels != 0.0)
        assert levels.min() > flux.min()
        assert levels.max() < flux.max()


def test_iron_between_half_a_tesla_and_two_has_half_of_the_colours(rig_content):
    field = replace(rig_content.field, flux_density_T=np.full_like(rig_content.field.flux_density_T, 1.9))
    assert colour_limit(field) == 2.0
    norm = colours_of(2.0, "cividis")["norm"]
    assert float(norm(2.0) - norm(0.5)) == pytest.approx(0.5)


def test_an_actuator_without_field_is_drawn_without_lines(rig_content):
    field = rig_content.field
    none = replace(field, flux_Wb=0.0 * field.flux_Wb, flux_density_T=0.0 * field.flux_density_T)
    assert flux_levels(none.flux_Wb).size == 0
    assert 0.0 < colour_limit(none) <= 1e-6
    field_figure(rig_content.actuator, none).draw_without_rendering()


def test_a_reciprocal_table_agrees_and_a_wrong_flux_does_not(rig_content):
    grid = sweep_grid(rig_content.fit.rows)
    assert reciprocity(grid) < 3e-3  # a cubic spline through 13 distances
    doubled = replace(grid, flux_linkage=2.0 * grid.flux_linkage)
    assert reciprocity(doubled) == pytest.approx(1.0, abs=0.2)  # at the second distance, k_m itself


def test_points_that_do_not_fill_a_grid_are_not_arranged(rig_content):
    rows = rig_content.fit.rows
    assert sweep_grid(rows.take(np.arange(len(rows.force)) != 3)) is None


def through_a_coil(rows):
    """The rows with the force of a magnet that is drawn into a coil and out of it, with both signs of the current."""
    middle = np.median(rows.distance)
    current = rows.current - np.median(rows.current)
    return replace(rows, circuit_currents=current[:, None], force=3.0 * current * (rows.distance - middle))


def test_a_force_of_both_signs_is_drawn_on_linear_axes(rig_content):
    grid = sweep_grid(through_a_coil(rig_content.fit.rows))
    assert changes_sign(grid)
    assert not changes_sign(sweep_grid(rig_content.fit.rows))
    curves = force_curves_figure(grid, 0.02)
    assert [axes.get_yscale() for axes in curves.axes] == ["linear"]
    assert len(curves.axes[0].get_lines()) == len(grid.currents) + 1
    image = force_map_figure(grid, 0.02).axes[0].collections[0]
    # White is no force: the scale is as long for repulsion as for attraction.
    assert image.norm.vmin == -image.norm.vmax == -np.abs(1e3 * grid.force).max()
