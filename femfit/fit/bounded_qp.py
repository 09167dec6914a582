"""The bounded least squares that every fit solves, with its proof.

minimise || (A x - y) / sigma ||^2  subject to  lower <= x <= upper  and  G x >= h.

Rows are divided by sigma and columns by their norm; the triangle R of a QR factorisation stands for the matrix, because
normal equations square the condition number (8e3 becomes 7e7 for d^-4 and d^-2). An active-set method solves the scaled
problem exactly; multipliers that satisfy the conditions of Karush, Kuhn and Tucker, which are sufficient for a convex
problem, prove it.

References
----------
C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (SIAM, 1995), chapter 23 (problems LSI and LDP).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.optimize import nnls

from femfit.core.amount import counted
from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError, InfeasibleFitError

EXCESS_ALLOWED = 1e-6
"""Part of the sum of squares by which another solution could be better."""

# Below this fraction of ||y||^2 a sum of squares is rounding and has no relative accuracy.
_SSE_FLOOR = 1e-22
_ACTIVE = 1e-8
_VIOLATION_ALLOWED = 1e-6
"""Rows of length one with less slack than this may act."""

_DEPENDENT = 1e-10
"""A row that acts with less of its own than this part of the largest repeats others."""

_CONDITION_MAX = 1e12


@dataclass(frozen=True, eq=False)
class Inequalities:
    """G x >= h."""

    matrix: FloatArray  # G; shape (m, k)
    right: FloatArray  # h; shape (m,)
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class QPSolution:
    """Solution of a bounded QP."""

    x: FloatArray  # Coefficients; shape (k,)
    active: tuple[str, ...]  # For each coefficient ``lower``, ``upper`` or empty: the bound it stands on
    active_inequalities: BoolArray  # Which rows of G x >= h hold with equality; shape (m,)
    residual: FloatArray  # A x - y; shape (n,)
    condition_scaled: float  # Condition number of A / sigma with columns of length one


@dataclass(frozen=True, eq=False)
class _ScaledQP:
    """minimise ||R z - q||^2 + outside with bounds and inequalities on z = column_scale x / scale."""

    triangle: FloatArray  # R; shape (k, k)
    right: FloatArray  # q; shape (k,)
    outside: float
    # Bounds of z; shape (k,)
    lower: FloatArray
    upper: FloatArray
    inequalities: Inequalities | None
    column_scale: FloatArray  # Norms of the columns of A / sigma; shape (k,)
    scale: float

    def excess(self, z: FloatArray) -> float:
        """||R z - q||^2."""
        return float(np.sum((self.triangle @ z - self.right) ** 2))

    def all_rows(self) -> tuple[FloatArray, FloatArray]:
        """Bounds and inequalities together as G z >= h."""
        identity = np.eye(len(self.lower))
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        blocks = [identity[below], -identity[above]]
        right = [self.lower[below], -self.upper[above]]
        if self.inequalities is not None:
            blocks.append(self.inequalities.matrix)
            right.append(self.inequalities.right)
        return np.concatenate(blocks), np.concatenate(right)


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

    A has shape (n, k) with n >= k, y and sigma > 0 in its unit (n,), bounds (k,); infinite ones bound nothing.
    """
    labels = [f"x{k + 1}" for k in range(matrix.shape[1])] if names is None else list(names)
    problem = _scaled_qp(matrix, y, sigma, lower, upper, inequalities, labels)
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
    problem = _scaled_qp(matrix, y, sigma, lower, upper, inequalities, names)
    return _solve(problem) * problem.scale / problem.column_scale


def _solve(problem: _ScaledQP) -> FloatArray:
    """z, with its bounds met exactly."""
    z = solve_least_distance(problem.triangle, problem.right, *problem.all_rows())
    return np.clip(z, problem.lower, problem.upper)


def solve_least_distance(triangle: FloatArray, q: FloatArray, G: FloatArray, h: FloatArray) -> FloatArray:
    """Minimise ||R z - q||^2 subject to G z >= h, R upper triangular and regular.

    With w = R z - q the problem is: minimise ||w|| subject to G R^-1 w >= h - G R^-1 q, whose dual is a non-negative
    least-squares problem (Lawson and Hanson, section 23.4). Its rows are scaled to length one, and w is solved for once
    more on the rows that act: the dual's own w loses as many digits as R^-1 is large.
    """
    if len(h) == 0:
        return np.asarray(solve_triangular(triangle, q))
    moved = solve_triangular(triangle, G.T, trans="T").T
    lengths = np.linalg.norm(moved, axis=1)
    lengths[lengths == 0.0] = 1.0
    moved, shifted = moved / lengths[:, None], (h - moved @ q) / lengths
    system = np.vstack([moved.T, shifted])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    multipliers, _ = non_negative(system, goal, 30 * system.shape[1])
    if abs((system @ multipliers - goal)[-1]) < 1e-13:
        raise InfeasibleFitError(
            f"The fit is infeasible, because no coefficients satisfy all {len(h)} bounds and inequalities at once. "
            "Drop or widen some of them."
        )
    acting = np.flatnonzero(multipliers)
    if len(acting) == 0:
        return np.asarray(solve_triangular(triangle, q))
    q_factor, corner, order = qr(moved[acting].T, mode="economic", pivoting=True)
    size = np.abs(np.diag(corner))
    rank = int(np.sum(size > _DEPENDENT * size[0]))
    values = solve_triangular(corner[:rank, :rank], shifted[acting[order[:rank]]], trans="T")
    return np.asarray(solve_triangular(triangle, q + q_factor[:, :rank] @ values))


def non_negative(matrix: FloatArray, right: FloatArray, steps: int | None = None) -> tuple[FloatArray, float]:
    """The least ||A x - b|| with x >= 0: (x, that norm); FitError where so many steps do not do."""
    try:
        x, norm = nnls(matrix, right, maxiter=steps)
    except RuntimeError as error:
        raise FitError(
            f"Least squares for {matrix.shape[1]} coefficients that must not be negative do not converge. Use fewer "
            "coefficients, drop bounds or constraints, or sweep more points."
        ) from error
    return x, float(norm)


def _is_optimal(problem: _ScaledQP, z: FloatArray) -> bool:
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
        multipliers, unexplained = non_negative(rows, gradient, 30 * max(rows.shape))
    better = unexplained**2 + 2.0 * multipliers @ np.fmax(slack[acting], 0.0)
    return bool(better <= EXCESS_ALLOWED * max(problem.outside + problem.excess(z), _SSE_FLOOR))


def _scaled_qp(
    matrix: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    lower: FloatArray | None,
    upper: FloatArray | None,
    inequalities: Inequalities | None,
    names: Sequence[str],
) -> _ScaledQP:
    """Scale rows by sigma and columns by their norm, and factorise."""
    count = matrix.shape[1]
    low = np.full(count, -np.inf) if lower is None else np.asarray(lower, dtype=np.float64)
    high = np.full(count, np.inf) if upper is None else np.asarray(upper, dtype=np.float64)
    _check(matrix, y, sigma, low, high, names)
    weighted, target = matrix / sigma[:, None], y / sigma
    column_scale = np.linalg.norm(weighted, axis=0)
    if not np.all(column_scale > 0):
        dead = names[int(np.argmin(column_scale))]
        raise FitError(f"The data do not contain {dead}: its column is zero in every row. Leave it out of the fit.")
    q_factor, triangle = qr(weighted / column_scale, mode="economic")
    scale = float(np.linalg.norm(target)) or 1.0
    right = q_factor.T @ target / scale
    return _ScaledQP(
        triangle=triangle,
        right=right,
        outside=float(np.sum((target / scale - q_factor @ right) ** 2)),
        lower=low * column_scale / scale,
        upper=high * column_scale / scale,
        inequalities=_scale_inequalities(inequalities, column_scale, scale),
        column_scale=column_scale,
        scale=scale,
    )


def _check(
    matrix: FloatArray, y: FloatArray, sigma: FloatArray, lower: FloatArray, upper: FloatArray, names: Sequence[str]
) -> None:
    rows, count = matrix.shape
    if rows < count:
        raise FitError(
            f"{counted(count, 'coefficient needs', 'coefficients need')} at least "
            f"{counted(count, 'row')}; instead received {rows}. Sweep more points."
        )
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(y))):
        raise FitError("Rows of a fit must be finite numbers; at least one is not. Remove or repair these rows.")
    if not np.all((sigma > 0) & np.isfinite(sigma)):
        raise FitError(f"Standard deviations must be > 0 and finite; instead received {np.min(sigma):g}.")
    for name, low, high in zip(names, lower, upper, strict=True):
        if low > high:
            raise InfeasibleFitError(
                f"The fit is infeasible, because {name} must be at least {low:g} and at most {high:g}. "
                "Swap or widen these bounds."
            )


def _scale_inequalities(given: Inequalities | None, column_scale: FloatArray, scale: float) -> Inequalities | None:
    if given is None or len(given.right) == 0:
        return None
    matrix = given.matrix / column_scale
    norms = np.linalg.norm(matrix, axis=1)
    norms[norms == 0.0] = 1.0
    return Inequalities(matrix / norms[:, None], given.right / scale / norms, given.labels)
