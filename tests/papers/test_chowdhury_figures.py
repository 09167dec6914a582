"""The paper's figures are drawn from a run by one command."""

from dataclasses import replace

import numpy as np
import pytest
from papers.chowdhury_figures import (
    coefficient_figure,
    curve_fit_figure,
    local_exponents,
    residual_sums_figure,
    shown_currents,
)

from femfit.fit.law_fit import fit_law
from femfit.fit.rows import FitRows
from femfit.laws.catalogue import law_by_name
from femfit.laws.dipoles import F2E
from femfit.model.magnetics import Coefficient, LawMagnetics


@pytest.fixture(scope="module")
def rows():
    i, d = (
        grid.ravel() for grid in np.meshgrid(np.linspace(0.0, 1.4, 8), np.linspace(0.015, 0.045, 13), indexing="ij")
    )
    force = 4.2e-9 / d**4 + 2e-5 * i / d**2 + 1e-6 * np.sin(400.0 * d)
    return FitRows((), d, i[:, None], force, np.full_like(d, 2e-6), weight=0.0427)


@pytest.fixture(scope="module")
def law(rows):
    return fit_law(law_by_name("F1e"), rows)


def test_the_laws_are_drawn_beside_the_whole_sweep_also_where_it_pushes(rows, law):
    for force in (rows.force, -rows.force, rows.force - np.mean(rows.force)):
        low, high = curve_fit_figure([law], replace(rows, force=force)).axes[0].get_ylim()
        assert low < 1e3 * force.min()
        assert high > 1e3 * force.max()


def test_residuals_and_coefficients_are_drawn_at_each_current(law):
    assert len(residual_sums_figure([law]).axes[0].get_lines()[0].get_xdata()) == 8
    assert len(coefficient_figure(law).axes) == 2


def test_the_currents_shown_are_those_of_figure_9():
    currents = np.linspace(0.0, 1.4, 8)
    np.testing.assert_allclose(currents[shown_currents(8)], [0.0, 0.6, 1.2])
    assert shown_currents(3) == [0, 1, 2]
    assert shown_currents(1) == [0]


def test_the_local_exponent_of_a_power_law_is_its_power():
    power = LawMagnetics(F2E.name, (Coefficient("d^-4", 0, 4e-9, "N m^4"), Coefficient("d^-4", 1, 1e-9, "N m^4")))
    d = np.linspace(0.015, 0.045, 7)
    rows = FitRows((), d, np.zeros((7, 1)), power.force(d, np.zeros((7, 1))), np.zeros(7))
    for _, n in local_exponents(power, rows).values():
        np.testing.assert_allclose(n, 4.0, rtol=1e-12)
