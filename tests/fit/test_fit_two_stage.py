"""The paper's two stages: Table 3 to Table 4, and the choice of coefficient functions."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from femfit.fit.law_columns import CoefficientBounds, term_bounds
from femfit.fit.rows import rows_of_table
from femfit.fit.two_stage import fit_coefficient_function, fit_each_current, fit_functions
from femfit.laws.dipoles import F1E, F2E
from support.sweeps import CURRENTS, DISTANCES, force_table

TABLE_3 = pd.read_csv(Path(__file__).parents[2] / "data" / "paper_table3.csv", comment="#")
I = TABLE_3["current_A"].to_numpy()  # noqa: E741 - the paper's symbol
NONNEGATIVE = CoefficientBounds(np.zeros(2), np.full(2, np.inf))
ABOVE_ZERO = NONNEGATIVE.of_column(0)


def paper_force(d, i):
    """Eq. (13)."""
    return 5.996e-9 * d**-4 + 4.509e-6 * i * d**-2


def test_table_4_comes_out_of_table_3():
    a = fit_coefficient_function(I, TABLE_3["a_N_m4"].to_numpy(), "a", ABOVE_ZERO, name="constant")
    b = fit_coefficient_function(I, TABLE_3["b_N_m2"].to_numpy(), "b", ABOVE_ZERO, name="through-origin")
    # Digits as printed in Table 4, except J_3: the paper's 2.0486e-14 does not follow from its own Table 3.
    assert float(a.at(0.0)) == pytest.approx(5.996e-9, abs=0.5e-12)
    assert float(b.at(1.0)) == pytest.approx(4.510e-6, abs=0.5e-9)
    assert b.residual_sum == pytest.approx(1.99e-14, rel=5e-3)


def test_held_out_currents_choose_a_constant_for_the_papers_a():
    a = fit_coefficient_function(I, TABLE_3["a_N_m4"].to_numpy(), "a", ABOVE_ZERO)
    assert a.name == "constant"
    assert min(a.held_out, key=a.held_out.get) == "constant"


@pytest.mark.parametrize("seed", range(8))
def test_a_constant_and_a_line_through_the_origin_are_recognised_in_scattered_coefficients(seed):
    # Table 3 as it would be if (13) were exact, with the scatter that Table 3 has about it.
    rng = np.random.default_rng(seed)
    a = fit_coefficient_function(I, 5.996e-9 + 1.1e-11 * rng.standard_normal(8), "a", ABOVE_ZERO)
    b = fit_coefficient_function(I, 4.51e-6 * I + 2e-8 * rng.standard_normal(8), "b", ABOVE_ZERO)
    assert (a.name, b.name) == ("constant", "through-origin")


@pytest.mark.parametrize(
    ("name", "truth"),
    [("affine", lambda i: 2.0 + 3.0 * i), ("quadratic", lambda i: 2.0 - i + 4.0 * i**2)],
)
def test_richer_functions_are_chosen_where_the_coefficient_needs_them(name, truth):
    values = truth(I) + 0.01 * np.random.default_rng(2).standard_normal(8)
    chosen = fit_coefficient_function(I, values, "c")
    assert chosen.name == name
    np.testing.assert_allclose(chosen.at(I), truth(I), atol=0.05)


def test_a_difference_declared_negligible_buys_no_further_term():
    values = 2.0 + 1e-3 * I
    assert fit_coefficient_function(I, values, "c").name == "affine"
    assert fit_coefficient_function(I, values, "c", negligible=1e-2).name == "constant"


def test_stage_one_finds_the_papers_law_and_its_zero_residual_at_every_current():
    rows = rows_of_table(force_table(paper_force), None, 9.80665)
    stage = fit_each_current(F1E, {}, rows, np.full(len(rows.force), 1e-3), NONNEGATIVE)
    np.testing.assert_allclose(stage.coefficients[:, 0], 5.996e-9, rtol=1e-9)
    np.testing.assert_allclose(stage.coefficients[:, 1], 4.509e-6 * CURRENTS, rtol=1e-8, atol=1e-15)
    assert np.all(stage.residual_sums < 1e-20)
    functions = fit_functions(F1E, stage, NONNEGATIVE)
    assert [function.name for function in functions] == ["constant", "through-origin"]
    assert float(functions[1].at(1.0)) == pytest.approx(4.509e-6, rel=1e-9)


def test_f2e_is_worse_than_f1e_at_every_current_that_flows():
    rows = rows_of_table(force_table(paper_force), None, 9.80665)
    sigma = np.full(len(rows.force), 1e-3)
    first = fit_each_current(F1E, {}, rows, sigma, NONNEGATIVE)
    second = fit_each_current(F2E, {}, rows, sigma, CoefficientBounds(np.zeros(1), np.full(1, np.inf)))
    assert np.all(second.residual_sums[1:] > 100 * first.residual_sums[1:])
    # The more current, the worse: the paper's Table 3 says the same of J_2.
    assert np.all(np.diff(second.residual_sums) > 0)


def test_j_1_is_the_unweighted_sum_of_squares():
    misfit = 1e-3 * np.cos(200 * DISTANCES)
    rows = rows_of_table(force_table(lambda d, i: paper_force(d, i) + 1e-3 * np.cos(200 * d)), None, 9.80665)
    stage = fit_each_current(F1E, {}, rows, np.full(len(rows.force), 7e-5), NONNEGATIVE)
    columns = F1E.columns(DISTANCES, {})
    plain = np.linalg.lstsq(columns / np.linalg.norm(columns, axis=0), misfit, rcond=None)[1][0]
    # Bounds are inactive from 0.2 A on, where the residual is that of plain least squares.
    np.testing.assert_allclose(stage.residual_sums[1:], plain, rtol=1e-6)


def test_bounds_at_every_current_become_a_box_where_one_term_makes_up_the_coefficient():
    limits = term_bounds(["affine", "through-origin"], ["x", "y"], np.array([0.0, 1.0, 2.0]), NONNEGATIVE)
    np.testing.assert_array_equal(limits.lower, [0.0, -np.inf, 0.0])
    np.testing.assert_array_equal(limits.inequalities.matrix, [[1, 1, 0], [1, 2, 0]])
    assert limits.sides == ("lower", "lower")


def test_a_negative_current_turns_a_lower_bound_around():
    bounds = CoefficientBounds(np.array([-1.0]), np.array([4.0]))
    limits = term_bounds(["through-origin"], ["x"], np.array([-2.0, 1.0]), bounds)
    # -1 <= -2 m <= 4 and -1 <= m <= 4 together: -1 <= m <= 0.5.
    assert (limits.lower[0], limits.upper[0]) == (-1.0, 0.5)
