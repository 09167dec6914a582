"""The bounded QP against independent solvers, its proof, and what it reports."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

from femfit.core.errors import FitError, InfeasibleFitError
from femfit.fit import bounded_qp
from femfit.fit.bounded_qp import BoundedQP, Inequalities
from femfit.fit.law_columns import FUNCTIONS, design_matrix, term_bounds
from femfit.laws.catalogue import BUILT_IN
from femfit.model.bspline import basis_matrix
from support.sweeps import SaturatingCircuit, force_table, full_table, paper_force


def solve_bounded_qp(*given, **bounds):
    return BoundedQP(*given, **bounds).solve()


def active_set_least_squares(*given, **bounds):
    return BoundedQP(*given, **bounds).solve_unproven()


DISTANCES = np.linspace(15e-3, 45e-3, 61)
F1E = np.stack([DISTANCES**-4, DISTANCES**-2], axis=1)  # The paper's two columns; condition number 8e3
TRUTH = np.array([5.996e-9, 4.509e-6])
ONES = np.ones(61)


def noisy(scale=1e-4, seed=1):
    return F1E @ TRUTH + scale * np.random.default_rng(seed).standard_normal(61)


SWEEPS = {
    "closed form": full_table,
    "paper": lambda: force_table(paper_force),
    "both signs": lambda: force_table(lambda d, i: 4e-6 * (i + 0.1) * d**-2, currents=np.linspace(-0.6, 0.6, 7)),
    "saturating": lambda: SaturatingCircuit().table(np.linspace(0.0, 1.0, 6), np.geomspace(2e-4, 6e-3, 12)),
}


@pytest.mark.parametrize(
    "sweep", [pytest.param(name, marks=[pytest.mark.nightly] * (name in ("closed form", "paper"))) for name in SWEEPS]
)
@pytest.mark.parametrize("law", BUILT_IN, ids=lambda law: law.name)
def test_the_stated_problem_and_the_fast_one_of_refits_have_the_same_answer_for_every_law(law, sweep):
    rows = SWEEPS[sweep]().rows
    d, i, force = (rows[name].to_numpy() for name in ("distance_m", "current_A", "force_N"))
    shape = {parameter.name: parameter.start for parameter in law.shape}
    acted = 0
    for function in FUNCTIONS:
        functions = (function,) * len(law.basis)
        matrix = design_matrix(law, shape, functions, d, i)
        scale = np.linalg.norm(matrix, axis=0)
        free = np.linalg.lstsq(matrix / scale, force, rcond=1e-12)[0] / scale
        # Each coefficient function must not be negative, and at most half of what the first term's would be
        ceiling = np.full(len(law.basis), np.inf)
        ceiling[0] = 0.5 * abs(free[0]) * np.max(np.abs(i)) ** FUNCTIONS[function][0]
        currents = np.unique(i)
        bounds = np.repeat(np.stack([np.zeros_like(ceiling), ceiling])[:, None], len(currents), axis=1)
        limits = term_bounds(functions, law.basis, currents, bounds)
        sides = limits.lower, limits.upper, limits.inequalities
        stated = solve_bounded_qp(matrix, force, np.ones_like(force), *sides)
        fast = active_set_least_squares(matrix, force, np.ones_like(force), *sides)
        largest = np.max(np.abs(matrix @ fast)) or np.max(np.abs(force))
        np.testing.assert_allclose(matrix @ stated.x, matrix @ fast, rtol=0.0, atol=1e-9 * largest)
        acted += len(limits.active(stated))
    assert acted > 0


@pytest.mark.parametrize("imposed", [0, 5])
def test_no_independent_solver_finds_less_over_random_problems(imposed):
    rng = np.random.default_rng(7)
    for _ in range(12):
        count = int(rng.integers(2, 7))
        matrix = rng.standard_normal((30, count)) * 10.0 ** rng.uniform(-8, 8, count)
        size = np.linalg.norm(matrix, axis=0)
        y = matrix @ (rng.standard_normal(count) / size) + 0.1 * rng.standard_normal(30)
        free = np.linalg.lstsq(matrix / size, y, rcond=None)[0] / size
        lower, upper = np.minimum(0.5 * free, 0.0), np.maximum(0.7 * free, 0.0)
        G, h = rng.standard_normal((imposed, count)) * size, -0.1 * rng.random(imposed)
        solution = solve_bounded_qp(matrix, y, np.ones(30), lower, upper, Inequalities(G, h, ("",) * imposed))
        scaled, box = matrix / size, np.stack([lower * size, upper * size], axis=1)
        if imposed:
            obeyed = {"type": "ineq", "fun": lambda z, G=G / size, h=h: G @ z - h}
            reference = minimize(
                lambda z, A=scaled, y=y: np.sum((A @ z - y) ** 2),
                np.zeros(count),
                bounds=box,
                constraints=obeyed,
                options={"ftol": 1e-13},
            ).fun
        else:
            reference = 2.0 * lsq_linear(scaled, y, box.T, method="bvls", tol=1e-15).cost
        assert np.sum(solution.residual**2) <= reference * (1 + 1e-6)
        assert np.all((solution.x >= lower) & (solution.x <= upper))
        assert np.all(G @ solution.x >= h - 1e-9)
        assert any(solution.active) or np.any(solution.active_inequalities)


def test_an_inequality_that_acts_is_met_and_named_beside_one_that_does_not():
    y = noisy()
    given = Inequalities(np.array([[0.0, 1.0], [1e3, 1.0]]), np.array([5e-6, 1e-6]), ("b", "1000 a + b"))
    solution = solve_bounded_qp(F1E, y, ONES, inequalities=given)
    assert list(solution.active_inequalities) == [True, False]
    # With b fixed on its bound, a alone solves the rest.
    a = np.sum(F1E[:, 0] * (y - 5e-6 * F1E[:, 1])) / np.sum(F1E[:, 0] ** 2)
    np.testing.assert_allclose(solution.x, [a, 5e-6], rtol=1e-8)


@pytest.mark.parametrize(
    ("lower", "upper", "inequality", "x", "active"),
    [
        ((0.0, 0.0), (1e-7, 1e-7), None, (None, 1e-7), ("", "upper")),
        ((0.0, 5e-6), (np.inf, 5e-6), None, (None, 5e-6), ("", "lower")),
        ((6e-9, 5e-6), (6e-9, 5e-6), None, (6e-9, 5e-6), ("lower", "lower")),
        ((-np.inf, 5e-6), (np.inf, 5e-6), 7e-9, (7e-9, 5e-6), ("", "lower")),
    ],
)
def test_a_bound_that_acts_is_met_exactly_and_reported_with_its_side(lower, upper, inequality, x, active):
    limits = np.array([] if inequality is None else [inequality])
    given = Inequalities(np.tile([1.0, 0.0], (len(limits), 1)), limits, ("a",) * len(limits))
    solution = solve_bounded_qp(F1E, noisy(), ONES, np.array(lower), np.array(upper), given)
    for found, wanted, side in zip(solution.x, x, active, strict=True):
        assert wanted is None or (found == wanted if side else found == pytest.approx(wanted, rel=1e-8))
    assert solution.active == active


@pytest.mark.parametrize("solve", [solve_bounded_qp, active_set_least_squares])
def test_bounds_that_contradict_each_other_are_infeasible(solve):
    given = Inequalities(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0]), ("x >= 1", "x <= -1"))
    with pytest.raises(InfeasibleFitError, match="all 2 bounds"):
        solve(np.eye(3, 2), np.zeros(3), np.ones(3), inequalities=given)
    with pytest.raises(InfeasibleFitError, match="x2 must be at least 2 and at most 1"):
        solve(F1E, noisy(), ONES, np.array([0.0, 2.0]), np.array([1.0, 1.0]))


@pytest.mark.parametrize("wrong", [lambda z: 1.001 * z, lambda z: z - 0.1])
def test_a_solution_that_is_not_proven_is_refused(monkeypatch, wrong):
    right = bounded_qp._ScaledQP.on_rows
    monkeypatch.setattr(bounded_qp._ScaledQP, "on_rows", lambda problem, acting: wrong(right(problem, acting)))
    with pytest.raises(FitError, match="x1, x2 has no proven optimum"):
        solve_bounded_qp(F1E, noisy(), ONES, lower=np.array([7e-9, 0.0]))


@pytest.mark.parametrize("solvers", [{}, {"OSQP": {"max_iter": 1}}, {"OSQP": {"max_iter": 1}, "CLARABEL": {}}])
def test_a_solver_that_names_the_wrong_bounds_is_followed_by_another_with_the_same_answer(monkeypatch, solvers):
    lower = np.array([7e-9, 0.0])
    proven = solve_bounded_qp(F1E, noisy(), ONES, lower)
    monkeypatch.setattr(bounded_qp, "_SOLVERS", solvers)
    np.testing.assert_allclose(solve_bounded_qp(F1E, noisy(), ONES, lower).x, proven.x, rtol=1e-14)


@pytest.mark.parametrize(
    ("matrix", "y", "sigma", "message"),
    [
        (F1E[:1], ONES[:1], ONES[:1], "2 coefficients.*2 rows"),
        (F1E, np.where(ONES > 0, np.nan, 0), ONES, "finite"),
        (F1E, ONES, 0.0 * ONES, "> 0"),
        (F1E * [1.0, 0.0], ONES, ONES, "x2"),
        (np.stack([DISTANCES, DISTANCES * (1 + 1e-14)], axis=1), ONES, ONES, r"x1, x2: condition number \d"),
    ],
)
def test_data_that_determine_no_solution_are_refused_with_the_reason(matrix, y, sigma, message):
    with pytest.raises(FitError, match=message):
        solve_bounded_qp(matrix, y, sigma)


def test_rows_weigh_by_their_standard_deviation_and_what_does_not_converge_is_an_error():
    solution = solve_bounded_qp(np.ones((2, 1)), np.array([0.0, 1.0]), np.array([1.0, 0.5]))
    assert solution.x[0] == pytest.approx(0.8, rel=1e-12)
    rng = np.random.default_rng(1)
    with pytest.raises(FitError, match="20 coefficients"):
        bounded_qp.non_negative(rng.random((30, 20)), rng.random(30), steps=1)


def tensor_spline(count_u, count_i, u, i, order=0):
    """Columns of a tensor B-spline of fourth degree on the unit square, its derivative of an order in i."""

    def columns(x, count, derivative=0):
        breaks = np.linspace(0.0, 1.0, count - 3)
        return basis_matrix(x, np.concatenate([np.zeros(4), breaks, np.ones(4)]), 4, derivative)

    return (columns(u, count_u)[:, :, None] * columns(i, count_i, order)[:, None, :]).reshape(len(u), -1)


@pytest.mark.parametrize("constraint", ["convex", "box", "each bound twice"])
def test_badly_conditioned_tables_with_hundreds_of_coefficients_end_with_a_proof(constraint):
    """Of the convex one nearly all constraints act at once: no solver names them, and the active set is asked."""
    rng = np.random.default_rng(1)
    u, i = rng.uniform(0, 1, 600) ** 2, rng.uniform(0, 1, 600)
    matrix = tensor_spline(14, 16, u, i) * 10.0 ** rng.uniform(-6, 6, 224)
    y = np.tanh(6 * i) / (u + 0.05) + 0.02 * rng.standard_normal(600)
    sigma = 1e-3 + np.where(rng.uniform(size=600) < 0.5, 1e-4, 1.0)
    size = np.linalg.norm(matrix / sigma[:, None], axis=0)
    lower, upper, rows = np.zeros(224), np.inf, np.zeros((0, 224))
    if constraint == "convex":
        grid_u, grid_i = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 25)))
        lower, rows = -np.inf, -tensor_spline(14, 16, grid_u, grid_i, 2) * size
    elif constraint == "box":
        upper = np.full(224, np.median(y) * np.sqrt(600)) / size
    else:
        rows = np.vstack([np.eye(224)] * 2) * size
    given = Inequalities(rows, np.zeros(len(rows)), ("",) * len(rows))
    stated = solve_bounded_qp(matrix, y, sigma, lower, upper, given)
    fast = matrix @ active_set_least_squares(matrix, y, sigma, lower, upper, given) / sigma
    # A sum of squares at its least is flat: half of the proof's digits
    assert np.sum((stated.residual / sigma) ** 2) <= np.sum((fast - y / sigma) ** 2) * (1 + 1e-6)
    # A coefficient within 1e-8 of a bound is put on it, beside columns of length one and data of this one
    atol = 224 * 1e-8 * np.linalg.norm(y / sigma)
    np.testing.assert_allclose((stated.residual + y) / sigma, fast, rtol=0.0, atol=atol)
