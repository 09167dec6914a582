"""The bounded least squares that every fit solves, with its proof.

minimise || (A x - y) / sigma ||^2  subject to  lower <= x <= upper  and  G x >= h.

Rows are divided by sigma and columns by their norm; the triangle R of a QR factorisation stands for the matrix, because
normal equations square the condition number (8e3 becomes 7e7 for d^-4 and d^-2). The problem is stated in cvxpy and
solved by OSQP. Its multipliers say which bounds act; a QR factorisation then solves for the coefficients on these to
rounding, and multipliers that satisfy the conditions of Karush, Kuhn and Tucker, which are sufficient for a convex
problem, prove the answer. Where they do not, Clarabel is asked, then an active-set method (hundreds of coefficients and
inequalities that nearly all act), and then there is an error.

The many refits of held-out and jackknife errors take the active-set method at once, in a thirtieth of the time, and
solve for the coefficients alike.

References
----------
B. Stellato et al., Math. Program. Comput. 12 (2020) 637: OSQP, and bounds that act by its multipliers (section 4).
C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (SIAM, 1995), chapter 23 (problems LSI and LDP).
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.optimize import nnls

from femfit.core.errors import FitError, InfeasibleFitError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import counted

EXCESS_ALLOWED = 1e-6
"""Part of the sum of squares by which another solution could be better."""

_EXCESS_OF_ROUNDING = 1e-12
"""What rounding leaves of that with the right rows acting, so that another method need not be asked for them."""

# Below this fraction of ||y||^2 a sum of squares is rounding and has no relative accuracy.
_SSE_FLOOR = 1e-22
_ACTIVE = 1e-8
_VIOLATION_ALLOWED = 1e-6
"""Rows of length one with less slack than this may act."""

_DEPENDENT = 1e-10
"""A row that acts with less of its own than this part of the largest repeats others."""

_CONDITION_MAX = 1e12

_SOLVERS: dict[str, dict[str, float]] = {
    # rho is adapted after so many iterations, not after a time, which would make the answer depend on the machine
    "OSQP": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 10_000, "adaptive_rho_interval": 50, "polishing": True},
    "CLARABEL": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12},
}


@dataclass(frozen=True, eq=False)
class Inequalities:
    """G x >= h."""

    matrix: FloatArray  # G; shape (m, k)
    right: FloatArray  # h; shape (m,)
    labels: tuple[str, ...]


NO_INEQUALITIES = Inequalities(np.zeros((0, 1)), np.zeros(0), ())
"""None, whatever the number of coefficients is."""


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
    """minimise ||R z - q||^2 + outside with G z >= h, where z = column_scale x / scale."""

    triangle: FloatArray  # R; shape (k, k)
    right: FloatArray  # q; shape (k,)
    outside: float
    # Bounds of z; shape (k,)
    lower: FloatArray
    upper: FloatArray
    # Finite bounds, then inequalities: G with rows of length one, and h
    rows: FloatArray
    ends: FloatArray
    labels: Sequence[str]
    column_scale: FloatArray  # Norms of the columns of A / sigma; shape (k,)
    scale: float

    @cached_property
    def whitened(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The rows of length one and the ends of G R^-1 w >= h - G R^-1 q with w = R z - q, and what scaled them."""
        moved = solve_triangular(self.triangle, self.rows.T, trans="T").T
        lengths = np.linalg.norm(moved, axis=1)
        lengths[lengths == 0.0] = 1.0
        return moved / lengths[:, None], (self.ends - moved @ self.right) / lengths, lengths

    def on_rows(self, acting: BoolArray) -> FloatArray:
        """Z of the least squares with equality in the rows that act, of those that repeat others in one."""
        if not np.any(acting):
            return np.asarray(solve_triangular(self.triangle, self.right))
        rows, ends, _ = (array[acting] for array in self.whitened)
        q_factor, corner, order = qr(rows.T, mode="economic", pivoting=True)
        size = np.abs(np.diag(corner))
        rank = int(np.sum(size > _DEPENDENT * size[0]))
        departure = q_factor[:, :rank] @ solve_triangular(corner[:rank, :rank], ends[order[:rank]], trans="T")
        return np.asarray(solve_triangular(self.triangle, self.right + departure))

    def unscaled(self, z: FloatArray) -> FloatArray:
        """The coefficients x in their own units."""
        return np.asarray(z * self.scale / self.column_scale)


@dataclass(frozen=True, eq=False)
class BoundedQP:
    """Least squares with bounds and linear inequalities."""

    matrix: FloatArray  # A; shape (n, k) with n >= k
    y: FloatArray  # Shape (n,)
    sigma: FloatArray  # > 0, in the unit of y; shape (n,)
    # Bounds, shape (k,), or one for all; infinite ones bound nothing
    lower: FloatArray | float = -np.inf
    upper: FloatArray | float = np.inf
    inequalities: Inequalities = NO_INEQUALITIES
    names: Sequence[str] | None = None

    def solve(self) -> QPSolution:
        """The solution, with a proof that no other is better."""
        problem = self._scaled
        labels = problem.labels
        coefficients = f"{', '.join(labels[:6])}{' ...' if len(labels) > 6 else ''}"
        condition_scaled = float(np.linalg.cond(problem.triangle))
        if condition_scaled > _CONDITION_MAX:
            raise FitError(
                f"The data do not determine {coefficients}: condition number {condition_scaled:.1e} after scaling. Use "
                "fewer coefficients, or rows at more distances and currents."
            )
        z = _proven(problem)
        if z is None:
            raise FitError(
                f"The fit of {coefficients} has no proven optimum. Use fewer coefficients, or drop constraints that "
                "the data contradict."
            )
        on_bound = [z - problem.lower < _ACTIVE, problem.upper - z < _ACTIVE]
        x = np.select(on_bound, [self.lower, self.upper], problem.unscaled(z))
        slack = problem.rows @ z - problem.ends
        return QPSolution(
            x=x,
            active=tuple(map(str, np.select(on_bound, ["lower", "upper"], ""))),
            active_inequalities=slack[len(slack) - len(self.inequalities.right) :] < _ACTIVE,
            residual=self.matrix @ x - self.y,
            condition_scaled=condition_scaled,
        )

    def solve_unproven(self) -> FloatArray:
        """The same coefficients quickly and without proof: for the many refits of held-out and jackknife errors."""
        problem = self._scaled
        z = problem.on_rows(_acting_by_dual(problem))
        return problem.unscaled(np.clip(z, problem.lower, problem.upper))

    @property
    def _scaled(self) -> _ScaledQP:
        """Rows scaled by sigma and columns by their norm, and factorised."""
        count = self.matrix.shape[1]
        labels = self.names or [f"x{k + 1}" for k in range(count)]
        low, high = (np.broadcast_to(np.asarray(end, np.float64), count) for end in (self.lower, self.upper))
        if len(self.matrix) < count:
            raise FitError(
                f"{counted(count, 'coefficient needs', 'coefficients need')} at least "
                f"{counted(count, 'row')}; instead received {len(self.matrix)}. Sweep more points."
            )
        if not (np.all(np.isfinite(self.matrix)) and np.all(np.isfinite(self.y))):
            raise FitError("Rows of a fit must be finite numbers; at least one is not. Remove or repair these rows.")
        if not np.all((self.sigma > 0) & np.isfinite(self.sigma)):
            raise FitError(f"Standard deviations must be > 0 and finite; instead received {np.min(self.sigma):g}.")
        for name, least, most in zip(labels, low, high, strict=True):
            if least > most:
                raise InfeasibleFitError(
                    f"The fit is infeasible, because {name} must be at least {least:g} and at most {most:g}. "
                    "Swap or widen these bounds."
                )
        weighted, target = self.matrix / self.sigma[:, None], self.y / self.sigma
        column_scale = np.linalg.norm(weighted, axis=0)
        if not np.all(column_scale > 0):
            dead = labels[int(np.argmin(column_scale))]
            raise FitError(f"The data do not contain {dead}: its column is zero in every row. Leave it out of the fit.")
        q_factor, triangle = qr(weighted / column_scale, mode="economic")
        scale = float(np.linalg.norm(target)) or 1.0
        right = q_factor.T @ target / scale
        low, high = (end * column_scale / scale for end in (low, high))
        below, above = np.isfinite(low), np.isfinite(high)
        imposed = self.inequalities.matrix / column_scale
        norms = np.linalg.norm(imposed, axis=1)
        norms[norms == 0.0] = 1.0
        return _ScaledQP(
            triangle=triangle,
            right=right,
            outside=float(np.sum((target / scale - q_factor @ right) ** 2)),
            lower=low,
            upper=high,
            rows=np.concatenate([np.eye(count)[below], -np.eye(count)[above], imposed / norms[:, None]]),
            ends=np.concatenate([low[below], -high[above], self.inequalities.right / scale / norms]),
            labels=labels,
            column_scale=column_scale,
            scale=scale,
        )


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


def _proven(problem: _ScaledQP) -> FloatArray | None:
    """Z, with its bounds met exactly; None where no rows that act lead to a proven one."""
    proven, least = None, EXCESS_ALLOWED
    for acting in _acting_rows(problem):
        z = np.clip(problem.on_rows(acting), problem.lower, problem.upper)
        excess = _excess(problem, z)
        if excess <= least:
            proven, least = z, excess
        if least <= _EXCESS_OF_ROUNDING:
            break
    return proven


def _acting_rows(problem: _ScaledQP) -> Iterator[BoolArray]:
    """Which rows act, as one method after the other finds them: those whose multiplier is above their slack."""
    for solver, options in _SOLVERS.items() if len(problem.ends) else ():
        import cvxpy as cp  # noqa: PLC0415  takes a second, which a fit without bounds should not wait for

        z = cp.Variable(len(problem.right))
        obeyed = problem.rows @ z >= problem.ends
        stated = cp.Problem(cp.Minimize(cp.sum_squares(problem.triangle @ z - problem.right)), [obeyed])
        with warnings.catch_warnings(), suppress(cp.SolverError):
            warnings.simplefilter("ignore")  # of an answer that may not be accurate: the proof decides
            stated.solve(solver=solver, **options)
        if z.value is not None:
            yield np.asarray(obeyed.dual_value > problem.rows @ z.value - problem.ends)
    yield _acting_by_dual(problem)


def _acting_by_dual(problem: _ScaledQP) -> BoolArray:
    """The same by non-negative least squares, to which least ||w|| with whitened rows is dual.

    The dual's own w loses as many digits as R^-1 is large (Lawson and Hanson, section 23.4).
    """
    rows, ends, _ = problem.whitened
    if len(ends) == 0:
        return np.zeros(0, dtype=np.bool_)
    system = np.vstack([rows.T, ends])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    multipliers, _ = non_negative(system, goal, 30 * len(ends))
    if abs((system @ multipliers - goal)[-1]) < 1e-13:
        raise InfeasibleFitError(
            f"The fit is infeasible, because no coefficients satisfy all {len(ends)} bounds and inequalities at once. "
            "Drop or widen some of them."
        )
    return np.asarray(multipliers > 0.0)


def _excess(problem: _ScaledQP, z: FloatArray) -> float:
    """By which part of the sum of squares another solution could be better; infinite where z breaks a row.

    With multipliers m >= 0 of the acting rows, g their slack and u what they leave of the gradient R z - q, no
    feasible point has a sum of squares lower by more than |u|^2 + 2 m g (weak duality).
    """
    slack = problem.rows @ z - problem.ends
    if np.min(slack, initial=0.0) < -_VIOLATION_ALLOWED:
        return np.inf
    acting = slack < _VIOLATION_ALLOWED
    rows, _, lengths = problem.whitened
    gradient = problem.triangle @ z - problem.right
    multipliers, unexplained = np.zeros(0), float(np.linalg.norm(gradient))
    if np.any(acting):
        multipliers, unexplained = non_negative(rows[acting].T, gradient, 30 * max(len(gradient), int(acting.sum())))
    better = unexplained**2 + 2.0 * multipliers @ np.fmax(slack[acting] / lengths[acting], 0.0)
    return float(better / max(problem.outside + float(gradient @ gradient), _SSE_FLOOR))
