"""A bounded quadratic programme as its solvers see it: rows over sigma, columns over their norm, R for the matrix.

Rows are divided by sigma, columns by their norm, and the scaled matrix is replaced by the triangle R of its QR
factorisation (not by its normal equations, which square the condition number: 8e3 becomes 7e7 for d^-4 and d^-2).

References
----------
Å. Björck, Numerical Methods for Least Squares Problems (SIAM, 1996), chapter 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError, InfeasibleFitError


@dataclass(frozen=True, eq=False)
class Inequalities:
    """G x >= h.

    Parameters
    ----------
    matrix : array, shape (m, k)
        G.
    right : array, shape (m,)
        h.
    """

    matrix: FloatArray
    right: FloatArray
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ScaledQP:
    """minimise ||R z - q||^2 + outside with bounds and inequalities on z = column_scale x / scale.

    Parameters
    ----------
    triangle : array, shape (k, k)
        R.
    right : array, shape (k,)
        q.
    lower, upper : array, shape (k,)
        Bounds of z.
    column_scale : array, shape (k,)
        Norms of the columns of A / sigma.
    """

    triangle: FloatArray
    right: FloatArray
    outside: float
    lower: FloatArray
    upper: FloatArray
    inequalities: Inequalities | None
    column_scale: FloatArray
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


def scaled_qp(
    matrix: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    lower: FloatArray | None,
    upper: FloatArray | None,
    inequalities: Inequalities | None,
    names: Sequence[str],
) -> ScaledQP:
    """Scale rows by sigma and columns by their norm, and factorise.

    FitError if there are too few rows, a value is not finite, a sigma is not positive or a column is zero;
    InfeasibleFitError if a lower bound is above the upper one.
    """
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
    return ScaledQP(
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
        raise FitError(f"{count} coefficients need at least {count} rows; instead received {rows}. Sweep more points.")
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
