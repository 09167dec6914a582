"""The bounded least squares that every fit solves, with its proof.

minimise || (A x - y) / sigma ||^2  subject to  lower <= x <= upper  and  G x >= h.

An active-set method solves the scaled problem exactly; multipliers that satisfy the conditions of Karush, Kuhn and
Tucker, which are sufficient for a convex problem, prove it. First-order solvers stop early on columns as badly scaled
as d^-4 and d^-2 and still report success; the tests use one as an oracle on the scaled problem.

References
----------
C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (SIAM, 1995), chapter 23 (problems LSI and LDP).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError, InfeasibleFitError
from femfit.fit.scaled_qp import Inequalities, ScaledQP, scaled_qp

EXCESS_ALLOWED = 1e-6
"""Part of the sum of squares by which another solution could be better."""

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
    residual : array, shape (n,)
        A x - y.
    condition_scaled : float
        Of A / sigma with columns of length one.
    """

    x: FloatArray
    active: tuple[str, ...]
    active_inequalities: BoolArray
    residual: FloatArray
    condition_scaled: float


def solve_bounded_qp(
    matrix: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    inequalities: Inequalities | None = None,
    names: Sequence[str] | None = None,
) -> QPSolution:
    """Least squares with bounds and linear inequalities, with a proof that no other solution is better.

    Parameters
    ----------
    matrix : array, shape (n, k)
        A; n >= k.
    y, sigma : array, shape (n,)
        Data and their standard deviations (> 0), in the same unit.
    lower, upper : array, shape (k,), or None
        Bounds; infinite entries bound nothing.
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
    z = _solve(problem)
    if not _is_optimal(problem, z):
        raise FitError(
            f"The fit of {', '.join(labels[:6])}{' ...' if count > 6 else ''} has no proven optimum. Use fewer "
            "coefficients, or drop constraints that the data contradict."
        )
    active = tuple(
        "lower" if z[k] - problem.lower[k] < _ACTIVE else "upper" if problem.upper[k] - z[k] < _ACTIVE else ""
        for k in range(count)
    )
    on_bound = [[side == "lower" for side in active], [side == "upper" for side in active]]
    ends = [np.full(count, -np.inf) if lower is None else lower, np.full(count, np.inf) if upper is None else upper]
    x = np.select(on_bound, ends, z * scale / column_scale)
    touching = np.zeros(0, dtype=np.bool_)
    if problem.inequalities is not None:
        touching = problem.inequalities.matrix @ z - problem.inequalities.right < _ACTIVE
    return QPSolution(
        x=x,
        active=active,
        active_inequalities=touching,
        residual=matrix @ x - y,
        condition_scaled=condition_scaled,
    )


def active_set_least_squares(
    matrix: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    inequalities: Inequalities | None = None,
) -> FloatArray:
    """Solve the same problem without proof: for the many refits of held-out and jackknife errors."""
    names = [f"x{k + 1}" for k in range(matrix.shape[1])]
    problem = scaled_qp(matrix, y, sigma, lower, upper, inequalities, names)
    return _solve(problem) * problem.scale / problem.column_scale


def _solve(problem: ScaledQP) -> FloatArray:
    """z, with its bounds met exactly."""
    z = solve_least_distance(problem.triangle, problem.right, *problem.all_rows())
    return np.clip(z, problem.lower, problem.upper)


def solve_least_distance(triangle: FloatArray, q: FloatArray, G: FloatArray, h: FloatArray) -> FloatArray:
    """Minimise ||R z - q||^2 subject to G z >= h, R upper triangular and regular.

    With w = R z - q the problem is: minimise ||w|| subject to G R^-1 w >= h - G R^-1 q, whose dual is a non-negative
    least-squares problem (Lawson and Hanson, section 23.4).
    """
    if len(h) == 0:
        return np.asarray(solve_triangular(triangle, q))
    moved = solve_triangular(triangle, G.T, trans="T").T
    shifted = h - moved @ q
    system = np.vstack([moved.T, shifted])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    multipliers, _ = nnls(system, goal, maxiter=30 * system.shape[1])
    remaining = system @ multipliers - goal
    if abs(remaining[-1]) < 1e-13:
        raise InfeasibleFitError(
            f"The fit is infeasible, because no coefficients satisfy all {len(h)} bounds and inequalities at once. "
            "Drop or widen some of them."
        )
    return np.asarray(solve_triangular(triangle, q - remaining[:-1] / remaining[-1]))


def _is_optimal(problem: ScaledQP, z: FloatArray) -> bool:
    """Whether z obeys all rows, and multipliers of those that act on it prove that no other z is noticeably better.

    With multipliers m >= 0 of the acting rows, g their slack and u what they leave of the gradient R z - q, no
    feasible point has a sum of squares lower by more than |u|^2 + 2 m g (weak duality).
    """
    G, h = problem.all_rows()
    gradient = problem.triangle @ z - problem.right
    slack = G @ z - h
    if np.min(slack, initial=0.0) < -_VIOLATION_ALLOWED:
        return False
    acting = slack < _VIOLATION_ALLOWED
    rows = solve_triangular(problem.triangle, G[acting].T, trans="T")
    multipliers, unexplained = np.zeros(0), float(np.linalg.norm(gradient))
    if np.any(acting):
        multipliers, unexplained = nnls(rows, gradient, maxiter=30 * max(rows.shape))
    better = unexplained**2 + 2.0 * multipliers @ np.fmax(slack[acting], 0.0)
    return bool(better <= EXCESS_ALLOWED * max(problem.outside + problem.excess(z), _SSE_FLOOR))
