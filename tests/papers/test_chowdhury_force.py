"""The levitation paper's force tables: linearity with its statistics right."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from papers.chowdhury_force import linearity_test, quadratic_f_test
from scipy import stats

from femfit.fit.law_columns import CoefficientBounds, fit_coefficient_function
from femfit.fit.rows import rows_of_table
from femfit.tables.sweep_table import write_sweep_table
from support.snapshot import check_snapshot
from support.sweeps import CURRENTS, DISTANCES, force_table


def rows_of(force, **axes):
    return rows_of_table(force_table(force, **axes), None, 9.80665)


def paper_force(d, i):
    return 5.996e-9 * d**-4 + 4.509e-6 * i * d**-2


def test_table_2_from_the_papers_law_has_the_mean_and_spread_that_follow_from_it():
    test = linearity_test(rows_of(paper_force))
    # ERRATA: mean of m 0.2 d^-2 over 15..45 mm is 1.35 mN (printed 0.0012), sd 0.92e-3 or 0.93e-3 (printed 0.6740).
    np.testing.assert_allclose(test.mean_N, 1.35e-3, atol=0.01e-3)
    np.testing.assert_allclose(test.sd_N, 0.925e-3, atol=0.01e-3)
    assert len(test.mean_N) == 7
    difference = 4.509e-6 * 0.2 * DISTANCES**-2.0
    np.testing.assert_allclose(test.mean_N, difference.mean(), rtol=1e-9)
    np.testing.assert_allclose(test.sd_N, np.std(difference, ddof=1), rtol=1e-9)


def test_the_papers_b_is_not_quite_linear_in_the_current():
    table = pd.read_csv(Path(__file__).parents[2] / "data" / "paper_table3.csv", comment="#")
    current, b = table["current_A"].to_numpy(), table["b_N_m2"].to_numpy()
    f_value, p_value = quadratic_f_test(current, b, through_origin=True)
    assert f_value == pytest.approx(11.4, abs=0.05)
    assert p_value == pytest.approx(0.015, abs=5e-4)
    above_zero = CoefficientBounds(np.zeros(1), np.full(1, np.inf))
    assert fit_coefficient_function(current, b, "b", above_zero).name == "quadratic"


def test_an_exactly_linear_force_has_no_quadratic_part_and_no_noise_to_test_it_against():
    test = linearity_test(rows_of(paper_force))
    assert test.quadratic_share < 1e-12
    assert test.f_value is None


def test_the_share_of_a_known_quadratic_part_is_found():
    def force(d, i):
        return paper_force(d, i) + 1e-3 * i**2

    test = linearity_test(rows_of(force))
    # i^2 less its own straight line over the grid, by hand.
    bend = 1e-3 * (CURRENTS**2 - np.polyval(np.polyfit(CURRENTS, CURRENTS**2, 1), CURRENTS))
    change = force(*np.meshgrid(DISTANCES, CURRENTS))
    change = change - change.mean(axis=0)
    expected = np.sqrt(np.mean(bend**2) / np.mean(change**2))
    assert test.quadratic_share == pytest.approx(expected, rel=1e-9)


def test_the_f_test_is_that_of_nested_least_squares():
    rng = np.random.default_rng(3)
    y = 1.0 + 2.0 * CURRENTS + 0.3 * CURRENTS**2 + 0.05 * rng.standard_normal(8)
    line, parabola = (np.sum((y - np.polyval(np.polyfit(CURRENTS, y, n), CURRENTS)) ** 2) for n in (1, 2))
    f_value, p_value = quadratic_f_test(CURRENTS, y)
    assert f_value == pytest.approx((line - parabola) / (parabola / 5), rel=1e-9)
    assert p_value == pytest.approx(stats.f.sf(f_value, 1, 5), rel=1e-12)


def test_a_table_with_holes_or_two_currents_is_not_tested():
    assert linearity_test(rows_of(paper_force, currents=[0.0, 1.0])) is None
    rows = rows_of(paper_force)
    assert linearity_test(rows.take(np.arange(len(rows.force)) != 5)) is None


def test_one_command_prints_the_tables(tmp_path, renew, capsys, monkeypatch):
    write_sweep_table(force_table(lambda d, i: paper_force(d, i) + 1e-3 * np.cos(300 * d)), tmp_path)
    script = str(Path(__file__).with_name("chowdhury_force.py"))
    monkeypatch.setattr(sys, "argv", [script, str(tmp_path)])
    runpy.run_path(script, run_name="__main__")
    check_snapshot("paper-force", capsys.readouterr().out, renew=renew, least=12)
