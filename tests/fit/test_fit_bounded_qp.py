"""The QP against exact solutions, and against the traps of first-order solvers on badly scaled columns."""

from fractions import Fraction

import cvxpy as cp
import numpy as np
import osqp
import pytest
from scipy import sparse
from scipy.optimize import lsq_linear

from femfit.core.errors import FitError, InfeasibleFitError
from femfit.fit import bounded_qp
from femfit.fit.bounded_qp import Inequalities, active_set_least_squares, solve_bounded_qp, solve_least_distance
from femfit.model.bspline import basis_matrix

DISTANCES = np.linspace(0.015, 0.045, 61)
F1E = np.stack([DISTANCES**-4, DISTANCES**-2], axis=1)
TRUTH = np.array([5.996e-9, 4.51e-6])
ONES = np.ones(61)


def exact_least_squares(matrix, y):
    """Two coefficients from the normal equations in rational arithmetic, where their condition does not matter."""
    A = [[Fraction(v) for v in row] for row in matrix]
    b = [Fraction(v) for v in y]
    p, q, r = (sum(row[j] * row[k] for row in A) for j, k in ((0, 0), (0, 1), (1, 1)))
    u, v = (sum(row[k] * value for row, value in zip(A, b, strict=True)) for k in (0, 1))
    determinant = p * r - q * q
    return np.array([float((u * r - v * q) / determinant), float((v * p - u * q) / determinant)])


def noisy(scale=1e-4, seed=1):
    return F1E @ TRUTH + scale * np.random.default_rng(seed).standard_normal(61)


def test_unscaled_osqp_calls_a_wrong_answer_solved_and_ours_is_exact():
    y = noisy()
    exact = exact_least_squares(F1E, y)
    naive = osqp.OSQP()
    identity = sparse.eye(2, format="csc")
    normal = sparse.csc_matrix(F1E.T @ F1E)
    naive.setup(normal, -F1E.T @ y, identity, np.zeros(2), np.full(2, np.inf), verbose=False)
    answer = naive.solve(raise_error=False)
    assert answer.info.status == "solved"
    assert abs(answer.x[1] / exact[1] - 1.0) > 0.05
    ours = solve_bounded_qp(F1E, y, ONES, lower=np.zeros(2))
    # Rounding, through a scaled condition number of 3.
    np.testing.assert_allclose(ours.x, exact, rtol=1e-9)


def test_condition_number_falls_from_thousands_to_a_few_by_scaling_columns():
    solution = solve_bounded_qp(F1E, noisy(), ONES)
    assert 5e3 < np.linalg.cond(F1E) < 2e4
    assert solution.condition_scaled < 6


def test_a_nine_term_nonnegative_fit_is_feasible_and_optimal():
    matrix = np.stack([DISTANCES ** -float(k) for k in range(9)], axis=1)
    solution = solve_bounded_qp(matrix, noisy(), ONES, lower=np.zeros(9))
    scale = np.linalg.norm(matrix, axis=0)
    reference = lsq_linear(matrix / scale, noisy(), (0, np.inf), method="bvls", tol=1e-15)
    assert np.sum(solution.residual**2) <= 2.0 * reference.cost * (1 + 1e-6)
    assert np.all(solution.x >= 0)
    assert "lower" in solution.active


def test_sums_of_squares_never_exceed_the_independent_solvers_over_random_problems():
    rng = np.random.default_rng(7)
    for _ in range(25):
        count = int(rng.integers(1, 7))
        matrix = rng.standard_normal((30, count)) * 10.0 ** rng.uniform(-8, 8, count)
        y = matrix @ (rng.standard_normal(count) / np.linalg.norm(matrix, axis=0)) + 0.1 * rng.standard_normal(30)
        free = np.linalg.lstsq(matrix / (s := np.linalg.norm(matrix, axis=0)), y, rcond=None)[0] / s
        lower, upper = np.minimum(0.5 * free, 0.0), np.maximum(0.7 * free, 0.0)
        solution = solve_bounded_qp(matrix, y, np.ones(30), lower, upper)
        reference = lsq_linear(matrix / s, y, (lower * s, upper * s), method="bvls", tol=1e-15)
        assert np.sum(solution.residual**2) <= 2.0 * reference.cost * (1 + 1e-6)
        assert np.all((solution.x >= lower) & (solution.x <= upper))
        assert any(solution.active)


def test_an_active_bound_is_met_exactly_and_reported_with_its_side():
    solution = solve_bounded_qp(F1E, noisy(), ONES, lower=np.zeros(2), upper=np.array([1e-7, 1e-7]))
    assert solution.x[1] == 1e-7
    assert solution.active == ("", "upper")


def test_inequalities_give_the_solution_that_the_conditions_of_optimality_name():
    y = noisy()
    G = np.array([[0.0, 1.0], [1e3, 1.0]])
    h = np.array([5e-6, 1.0e-6])
    given = Inequalities(G, h, ("b at least 5e-6", "1000 a + b at least 1e-6"))
    solution = solve_bounded_qp(F1E, y, ONES, inequalities=given)
    assert list(solution.active_inequalities) == [True, False]
    # With b fixed on its bound, a alone solves the rest.
    a = np.sum(F1E[:, 0] * (y - 5e-6 * F1E[:, 1])) / np.sum(F1E[:, 0] ** 2)
    np.testing.assert_allclose(solution.x, [a, 5e-6], rtol=1e-8)


def osqp_solution(matrix, y, lower, given):
    """What cvxpy and OSQP find, an oracle that shares no line with ours."""
    x = cp.Variable(matrix.shape[1])
    constraints = [x >= lower, given.matrix @ x >= given.right]
    problem = cp.Problem(cp.Minimize(cp.sum_squares(matrix @ x - y)), constraints)
    problem.solve(solver=cp.OSQP, eps_abs=1e-9, eps_rel=1e-9, polishing=True, max_iter=50_000)
    assert problem.status == cp.OPTIMAL
    return x.value


def test_an_independent_solver_agrees_with_bounds_and_inequalities_together():
    rng = np.random.default_rng(3)
    for _ in range(20):
        matrix, y = rng.standard_normal((20, 4)), rng.standard_normal(20)
        given = Inequalities(rng.standard_normal((5, 4)), -0.1 * rng.random(5), tuple("abcde"))
        ours = solve_bounded_qp(matrix, y, np.ones(20), lower=np.full(4, -0.2), inequalities=given)
        # OSQP solves to about 1e-9 of a problem of order one.
        np.testing.assert_allclose(ours.x, osqp_solution(matrix, y, np.full(4, -0.2), given), atol=1e-7)


def test_least_distance_without_inequalities_is_plain_least_squares():
    triangle = np.triu(np.arange(1.0, 10.0).reshape(3, 3))
    z = solve_least_distance(triangle, np.ones(3), np.zeros((0, 3)), np.zeros(0))
    np.testing.assert_allclose(triangle @ z, np.ones(3))


def test_crossed_bounds_are_infeasible_because_of_the_named_coefficient():
    with pytest.raises(InfeasibleFitError, match=r"infeasible, because b must be at least 2 and at most 1"):
        solve_bounded_qp(F1E, noisy(), ONES, np.array([0.0, 2.0]), np.array([1.0, 1.0]), names=("a", "b"))


def test_contradicting_inequalities_are_infeasible():
    given = Inequalities(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0]), ("x >= 1", "x <= -1"))
    matrix, y = np.eye(3, 2), np.zeros(3)
    with pytest.raises(InfeasibleFitError, match="infeasible, because"):
        solve_bounded_qp(matrix, y, np.ones(3), inequalities=given)
    with pytest.raises(InfeasibleFitError, match="infeasible, because"):
        active_set_least_squares(matrix, y, np.ones(3), inequalities=given)


@pytest.mark.parametrize("wrong", [lambda z: 1.001 * z, lambda z: z - 0.1])
def test_a_solution_that_is_not_proven_is_refused(monkeypatch, wrong):
    right = bounded_qp._solve
    monkeypatch.setattr(bounded_qp, "_solve", lambda problem: wrong(right(problem)))
    with pytest.raises(FitError, match="no proven optimum"):
        solve_bounded_qp(F1E, noisy(), ONES, lower=np.array([7e-9, 0.0]))


@pytest.mark.parametrize(
    ("matrix", "y", "sigma", "message"),
    [
        (F1E[:1], ONES[:1], ONES[:1], "2 coefficients need at least 2 rows"),
        (F1E, np.where(ONES > 0, np.nan, 0), ONES, "must be finite"),
        (F1E, ONES, 0.0 * ONES, "must be > 0"),
        (F1E * [1.0, 0.0], ONES, ONES, "do not contain x2"),
        (np.stack([DISTANCES, DISTANCES * (1 + 1e-14)], axis=1), ONES, ONES, "do not determine x1, x2"),
    ],
)
def test_data_that_determine_no_solution_are_refused_with_the_reason(matrix, y, sigma, message):
    with pytest.raises(FitError, match=message):
        solve_bounded_qp(matrix, y, sigma)


def test_least_squares_that_do_not_converge_are_a_fit_error_with_a_remedy():
    rng = np.random.default_rng(1)
    with pytest.raises(FitError, match="Use fewer coefficients"):
        bounded_qp.non_negative(rng.random((30, 20)), rng.random(30), steps=1)


def test_rows_weigh_by_their_standard_deviation():
    y = np.array([0.0, 1.0])
    solution = solve_bounded_qp(np.ones((2, 1)), y, np.array([1.0, 0.5]))
    assert solution.x[0] == pytest.approx(0.8, rel=1e-12)


def test_a_coefficient_whose_bounds_coincide_is_fixed_there():
    y = noisy()
    solution = solve_bounded_qp(F1E, y, ONES, np.array([0.0, 5e-6]), np.array([np.inf, 5e-6]))
    a = np.sum(F1E[:, 0] * (y - 5e-6 * F1E[:, 1])) / np.sum(F1E[:, 0] ** 2)
    np.testing.assert_allclose(solution.x, [a, 5e-6], rtol=1e-8)
    assert solution.active == ("", "lower")


def test_all_coefficients_may_be_fixed_and_inequalities_may_stand_beside_them():
    fixed = np.array([6e-9, 5e-6])
    np.testing.assert_array_equal(solve_bounded_qp(F1E, noisy(), ONES, fixed, fixed).x, fixed)
    given = Inequalities(np.array([[1.0, 0.0]]), np.array([7e-9]), ("a at least 7e-9",))
    x = solve_bounded_qp(F1E, noisy(), ONES, np.array([-np.inf, 5e-6]), np.array([np.inf, 5e-6]), given).x
    np.testing.assert_allclose(x, [7e-9, 5e-6], rtol=1e-8)


def tensor_spline(count_u, count_i, u, i, order=0):
    """Columns of a tensor B-spline of fourth degree on the unit square, its derivative of an order in i."""

    def columns(x, count, derivative=0):
        breaks = np.linspace(0.0, 1.0, count - 3)
        return basis_matrix(x, np.concatenate([np.zeros(4), breaks, np.ones(4)]), 4, derivative)

    return (columns(u, count_u)[:, :, None] * columns(i, count_i, order)[:, None, :]).reshape(len(u), -1)


@pytest.mark.parametrize("constraint", ["convex", "box", "each bound twice"])
def test_badly_conditioned_tables_with_hundreds_of_coefficients_end_with_a_proof(constraint):
    """256 to 288 coefficients, columns over twelve decades, half of the rows weighted a thousand times as much."""
    rng = np.random.default_rng(1)
    shape, rows = ((16, 16), 700) if constraint == "each bound twice" else ((18, 16), 900)
    u, i = rng.uniform(0, 1, rows) ** 2, rng.uniform(0, 1, rows)
    matrix = tensor_spline(*shape, u, i)
    matrix *= 10.0 ** rng.uniform(-6, 6, matrix.shape[1])
    y = np.tanh(6 * i) / (u + 0.05) + 0.02 * rng.standard_normal(rows)
    sigma = 1e-3 + np.where(rng.uniform(size=rows) < 0.5, 1e-4, 1.0)
    size = np.linalg.norm(matrix / sigma[:, None], axis=0)
    count = matrix.shape[1]
    given, upper = None, None
    if constraint == "convex":
        grid_u, grid_i = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 25)))
        G = -tensor_spline(*shape, grid_u, grid_i, 2) * size
        given = Inequalities(G, np.zeros(len(G)), ("concave",) * len(G))
    elif constraint == "box":
        upper = np.full(count, np.median(y) * np.sqrt(rows)) / size
    else:
        given = Inequalities(np.vstack([np.eye(count)] * 2) * size, np.zeros(2 * count), ("positive",) * 2 * count)
    lower = None if constraint == "convex" else np.zeros(count)
    ours = solve_bounded_qp(matrix, y, sigma, lower, upper, given)
    # The oracle, an interior-point method, on the problem with columns of length one
    z, scaled, target = cp.Variable(count), matrix / sigma[:, None] / size, y / sigma
    q_factor, triangle = np.linalg.qr(scaled)
    length = np.linalg.norm(target)
    limits = [] if lower is None else [z >= 0]
    limits += [] if upper is None else [z <= upper * size / length]
    if constraint == "convex":
        unit = given.matrix / size
        limits.append((unit / np.linalg.norm(unit, axis=1)[:, None]) @ z >= 0)
    cp.Problem(cp.Minimize(cp.sum_squares(triangle @ z - q_factor.T @ target / length)), limits).solve(cp.CLARABEL)
    theirs = np.sum((scaled @ z.value * length - target) ** 2)
    # Its tolerance of 1e-8 on a target of length one is 1e-4 of what is left of it
    assert np.sum((ours.residual / sigma) ** 2) <= theirs * (1 + 1e-4)
