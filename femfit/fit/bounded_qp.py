"""The bounded quadratic programme that every fit solves, and its independent check.

minimise || (A x - y) / sigma ||^2  subject to  lower <= x <= upper  and  G x >= h.

OSQP solves the scaled problem; a second, unrelated algorithm (an active-set method) solves it again, because a
first-order solver can stop early and still report success. Where OSQP does not reach its tolerance (a saturating sweep
with hundreds of shape inequalities), the active-set solution is taken if its multipliers prove it: the conditions of
Karush, Kuhn and Tucker are sufficient for a convex programme.

References
----------
B. Stellato et al., OSQP: an operator splitting solver for quadratic programs, Math. Prog. Comp. 12 (2020) 637.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cvxpy as cp
import numpy as np
from scipy.linalg import null_space, solve_triangular
from scipy.optimize import lsq_linear, nnls

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError, InfeasibleFitError
from femfit.fit.least_distance import solve_least_distance
from femfit.fit.scaled_qp import Inequalities, ScaledQP, scaled_qp

TOLERANCE = 1e-9
"""OSQP's absolute and relative tolerance on the scaled problem."""

MAX_ITERATIONS = 50_000

EXCESS_ALLOWED = 1e-6
"""Largest relative excess of the sum of squares over the independent solver's."""

# Below this fraction of ||y||^2 a sum of squares is rounding and has no relative accuracy.
_SSE_FLOOR = 1e-22
_ACTIVE = 1e-8
_VIOLATION_ALLOWED = 1e-6
"""Of a row of length one; rows with less slack than that may act."""

_CONDITION_MAX = 1e12


@dataclass(frozen=True, eq=False)
class QPSolution:
    """Solution of a bounded QP.

    Parameters
    ----------
    x : array, shape (k,)
        Coefficients.
    active : tuple of str
        For each coefficient ``lower``, ``upper`` or empty: the bound it stands on.
    active_inequalities : array of bool, shape (m,)
        Which rows of G x >= h hold with equality.
    covariance : array, shape (k, k)
        Of the free coefficients, from the residual variance; zero for those on a bound. White residuals assumed.
    residual : array, shape (n,)
        A x - y.
    condition : float
        Of A / sigma before columns are scaled.
    """

    x: FloatArray
    active: tuple[str, ...]
    active_inequalities: BoolArray
    covariance: FloatArray
    degrees_of_freedom: int
    weighted_sse: float
    residual: FloatArray
    condition: float
    condition_scaled: float
    iterations: int


def solve_bounded_qp(
    matrix: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    inequalities: Inequalities | None = None,
    names: Sequence[str] | None = None,
) -> QPSolution:
    """Least squares with bounds and linear inequalities, solved twice.

    Parameters
    ----------
    matrix : array, shape (n, k)
        A; n >= k.
    y, sigma : array, shape (n,)
        Data and their standard deviations (> 0), in the same unit.
    lower, upper : array, shape (k,), or None
        Bounds; infinite entries bound nothing.
    names : sequence of str or None
        Names of the coefficients for messages.

    Raises
    ------
    InfeasibleFitError
        If bounds and inequalities exclude every solution.
    FitError
        If the data do not determine the coefficients, or the two solvers disagree.
    """
    labels = [f"x{k + 1}" for k in range(matrix.shape[1])] if names is None else list(names)
    problem = scaled_qp(matrix, y, sigma, lower, upper, inequalities, labels)
    count, column_scale, scale = matrix.shape[1], problem.column_scale, problem.scale
    condition_scaled = float(np.linalg.cond(problem.triangle))
    if condition_scaled > _CONDITION_MAX:
        raise FitError(
            f"The data do not determine {', '.join(labels[:6])}{' ...' if count > 6 else ''}: condition number "
            f"{condition_scaled:.1e} after scaling. Use fewer coefficients, or rows at more distances and currents."
        )
    z, iterations = _solve(problem, labels)

    active = tuple(
        "lower" if z[k] - problem.lower[k] < _ACTIVE else "upper" if problem.upper[k] - z[k] < _ACTIVE else ""
        for k in range(count)
    )
    on_bound = [[side == "lower" for side in active], [side == "upper" for side in active]]
    ends = [np.full(count, -np.inf) if lower is None else lower, np.full(count, np.inf) if upper is None else upper]
    x = np.select(on_bound, ends, z * scale / column_scale)
    residual = matrix @ x - y
    sse = float(np.sum((residual / sigma) ** 2))
    touching = np.zeros(0, dtype=np.bool_)
    if problem.inequalities is not None:
        touching = problem.inequalities.matrix @ z - problem.inequalities.right < _ACTIVE
    covariance, free = _covariance(problem, active, touching, sse, len(y), column_scale)
    return QPSolution(
        x=x,
        active=active,
        active_inequalities=touching,
        covariance=covariance,
        degrees_of_freedom=len(y) - free,
        weighted_sse=sse,
        residual=residual,
        condition=float(np.linalg.cond(problem.triangle * column_scale)),
        condition_scaled=condition_scaled,
        iterations=iterations,
    )


def active_set_least_squares(
    matrix: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    inequalities: Inequalities | None = None,
) -> FloatArray:
    """Solve the same problem by the independent solver alone: for the many refits of held-out and jackknife errors.

    Parameters
    ----------
    matrix, y, sigma, lower, upper, inequalities
        As in :func:`solve_bounded_qp`.

    Returns
    -------
    array, shape (k,)
        Coefficients.
    """
    names = [f"x{k + 1}" for k in range(matrix.shape[1])]
    problem = scaled_qp(matrix, y, sigma, lower, upper, inequalities, names)
    return _active_set(problem) * problem.scale / problem.column_scale


def _solve(problem: ScaledQP, names: Sequence[str]) -> tuple[FloatArray, int]:
    """OSQP's solution z that the independent solver confirms, and the number of iterations.

    Bounds are simplest in z itself, the objective is best conditioned in w = R z: z is tried first, w where it fails.
    Where both do, the independent solver's z with 0 iterations, if it is proved to be the solution.
    """
    count = len(problem.right)
    inverse = solve_triangular(problem.triangle, np.eye(count))
    reference = _active_set(problem)
    failure = FitError("OSQP was not run.")
    for objective, back in ((problem.triangle, np.eye(count)), (np.eye(count), inverse)):
        try:
            value, iterations = _osqp(problem, objective, back, names)
            z = np.clip(value, problem.lower, problem.upper)
            _cross_check(problem, z, reference)
        except InfeasibleFitError:
            raise
        except FitError as error:
            failure = error
        else:
            return z, iterations
    if not _is_optimal(problem, reference):
        raise failure
    return reference, 0


def _is_optimal(problem: ScaledQP, z: FloatArray) -> bool:
    """Whether z obeys all rows, and multipliers of those that act on it prove that no other z is noticeably better.

    With multipliers m >= 0 of the acting rows, g their slack and u what they leave of the gradient R z - q, no
    feasible point has a sum of squares lower by more than |u|^2 + 2 m g (weak duality).
    """
    G, h = problem.all_rows()
    rest = problem.triangle @ z - problem.right
    slack = G @ z - h
    if np.min(slack, initial=0.0) < -_VIOLATION_ALLOWED:
        return False
    acting = slack < _VIOLATION_ALLOWED
    rows = solve_triangular(problem.triangle, G[acting].T, trans="T")
    multipliers, unexplained = np.zeros(0), float(np.linalg.norm(rest))
    if np.any(acting):
        multipliers, unexplained = nnls(rows, rest, maxiter=30 * max(rows.shape))
    better = unexplained**2 + 2.0 * multipliers @ np.fmax(slack[acting], 0.0)
    return bool(better <= EXCESS_ALLOWED * max(problem.outside + problem.excess(z), _SSE_FLOOR))


def _osqp(problem: ScaledQP, objective: FloatArray, back: FloatArray, names: Sequence[str]) -> tuple[FloatArray, int]:
    """Minimise ||objective v - q||^2 for z = back v, with constraint rows of length one."""
    v = cp.Variable(len(problem.right))
    G, h = problem.all_rows()
    constraints = []
    if len(h):
        moved = G @ back
        length = np.linalg.norm(moved, axis=1)
        constraints.append(moved / length[:, None] @ v >= h / length)
    programme = cp.Problem(cp.Minimize(cp.sum_squares(objective @ v - problem.right)), constraints)
    try:
        with warnings.catch_warnings():
            # cvxpy warns of an inaccurate solution; the status below refuses it.
            warnings.simplefilter("ignore", UserWarning)
            programme.solve(
                solver=cp.OSQP, eps_abs=TOLERANCE, eps_rel=TOLERANCE, polishing=True, max_iter=MAX_ITERATIONS
            )
    except cp.SolverError as error:
        raise FitError(f"OSQP failed: {error}. Use fewer coefficients or looser constraints.") from error
    if programme.status in {cp.INFEASIBLE, cp.INFEASIBLE_INACCURATE}:
        raise InfeasibleFitError(
            f"The fit of {', '.join(names)} is infeasible, because no coefficients satisfy all {len(h)} bounds and "
            "inequalities at once. Drop or widen some of them."
        )
    if programme.status != cp.OPTIMAL or v.value is None:
        raise FitError(
            f"OSQP stopped with status {programme.status!r}; only 'optimal' is accepted. Use fewer coefficients, or "
            "drop constraints that the data contradict."
        )
    return back @ np.asarray(v.value, dtype=np.float64), int(programme.solver_stats.num_iters or 0)


def _active_set(problem: ScaledQP) -> FloatArray:
    if problem.inequalities is not None:
        return solve_least_distance(problem.triangle, problem.right, *problem.all_rows())
    fixed = (
        problem.lower >= problem.upper
    )  # bounds that coincide leave nothing to solve for, and lsq_linear refuses them
    z = problem.lower.copy()
    if not np.all(fixed):
        right = problem.right - problem.triangle[:, fixed] @ z[fixed]
        bounds = (problem.lower[~fixed], problem.upper[~fixed])
        z[~fixed] = lsq_linear(problem.triangle[:, ~fixed], right, bounds, method="bvls", tol=1e-15).x
    return z


def _cross_check(problem: ScaledQP, z: FloatArray, reference: FloatArray) -> None:
    ours, theirs = problem.excess(z), problem.excess(reference)
    whole = max(problem.outside + theirs, _SSE_FLOOR)
    if ours - theirs > EXCESS_ALLOWED * whole:
        raise FitError(
            f"OSQP's solution has a sum of squares {(ours - theirs) / whole:.1e} (relative) above that of an "
            f"independent active-set solver; at most {EXCESS_ALLOWED:g} is accepted. Use fewer coefficients or "
            "constraints; please report this case."
        )
    if problem.inequalities is not None:
        violation = float(np.max(problem.inequalities.right - problem.inequalities.matrix @ z))
        if violation > _VIOLATION_ALLOWED:
            raise FitError(f"OSQP's solution violates an inequality by {violation:.1e} of its scale. Loosen it.")


def _covariance(
    problem: ScaledQP, active: Sequence[str], touching: BoolArray, sse: float, rows: int, column_scale: FloatArray
) -> tuple[FloatArray, int]:
    """Covariance of x in the directions that active bounds leave free, and their number."""
    count = len(active)
    fixed = np.eye(count)[[bool(a) for a in active]]
    if problem.inequalities is not None and np.any(touching):
        fixed = np.concatenate([fixed, problem.inequalities.matrix[touching]])
    directions = null_space(fixed) if len(fixed) else np.eye(count)
    free = directions.shape[1]
    if free == 0 or rows <= free:
        return np.zeros((count, count)), free
    reduced = np.linalg.qr(problem.triangle @ directions, mode="r")
    half = solve_triangular(reduced, np.eye(free))
    spread = directions @ half / column_scale[:, None]
    return spread @ spread.T * (sse / (rows - free)), free
