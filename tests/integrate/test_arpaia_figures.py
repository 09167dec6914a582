"""Figures 5 to 8 of the paper on integrators show what the methods found."""

import numpy as np
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise
from arpaia2022.figures import MAGNIFIED, fields_figure, flat_top_figure, offsets_figure
from arpaia2022.study import PAPER_METHODS, TABLES, experiment_fields, experiment_figures, table_text


@pytest.fixture(scope="module")
def experiment():
    inputs = ExperimentInputs(amplitudes=(320.0, 320.0), plateau=35.0, zero_reading=10.0, sample_rate=200.0)
    return synthesise(inputs, np.random.default_rng(1))


@pytest.fixture(scope="module")
def blocks(experiment):
    return experiment_fields(experiment)


def test_offsets_have_a_panel_for_each_ramp_rate_and_a_curve_for_each_method(blocks):
    figure = offsets_figure({3.2: blocks, 100.0: blocks}, ("ffa1", "ffa2", "cs1"))
    assert [axes.get_title() for axes in figure.axes] == ["3.2 A/s", "100 A/s"]
    curve = figure.axes[1].get_lines()[2]
    at = np.searchsorted(blocks["cs1"].time, curve.get_xdata())
    np.testing.assert_array_equal(curve.get_ydata(), 1e6 * blocks["cs1"].offset[at])


def test_fields_are_magnified_about_the_flat_tops(blocks):
    figure = fields_figure({100.0: blocks}, PAPER_METHODS)
    whole, *magnified = figure.axes
    assert len(whole.get_lines()) == len(PAPER_METHODS)
    assert [axes.get_ylim()[1] for axes in magnified] == [1e3 * half for half in MAGNIFIED]
    # cs1 lies on the flat-top; the plain integral has left the last row's millitesla by the end.
    curves = dict(zip(PAPER_METHODS, magnified[-1].get_lines(), strict=True))
    inside = {name: np.mean(np.abs(line.get_ydata()) < 1e3 * MAGNIFIED[-1]) for name, line in curves.items()}
    assert inside["cs1"] > 0.4
    assert inside["trapezoid"] < 0.1


def test_the_last_flat_top_is_shown_alone(blocks, experiment):
    begin, end = experiment.flat_tops[-1]
    (axes,) = flat_top_figure(blocks, (begin, end), ("ffa2", "cs1", "cs2")).axes
    for line in axes.get_lines():
        assert begin < line.get_xdata().min() < line.get_xdata().max() < end


def test_each_table_is_made_by_one_command(experiment, blocks):
    figures = experiment_figures([experiment])
    for number in TABLES:
        text = table_text(figures, number)
        assert f"Table {number}" in text
        assert all(method in text for method in PAPER_METHODS)
    assert "60.34" in table_text(figures, 3) or "6.034e+04" in table_text(figures, 3)
