"""Whitens readings that share errors: those of a stop of the stage, of a row's current, of a setting.

The covariance is I + H H', with a sparse column of H for each error by one standard deviation. With the Cholesky factor
L L' = I + H' H, the map T = I - H (I + L')^-1 L^-1 H' has T' T = (I + H H')^-1.

References
----------
A. Andrews, AIAA Journal 6 (1968) 1165: the square root of a covariance that a vector of readings updates.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from femfit.core.numerics import FloatArray


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Errors that several readings of otherwise unit variance share."""

    columns: sparse.csr_array  # H, shape (M, n): what each error makes of the readings

    def whitened(self, x: FloatArray) -> FloatArray:
        """The readings x, of shape (M,) or (M, k), made independent and of unit variance."""
        if not self.columns.nnz:
            return x
        columns, lower, beyond = self._factors
        return x - np.asarray(columns @ beyond.solve(lower.solve(columns.T @ x)))

    @cached_property
    def _factors(self) -> tuple[sparse.csr_array, Any, Any]:
        """H, its columns in the order of least fill, and solvers of L and of I + L'."""
        n = self.columns.shape[1]
        normal = (self.columns.T @ self.columns + sparse.eye_array(n)).tocsc()
        # No pivoting: the matrix is positive definite, so that its factors are L and the transpose of L by the pivots
        symmetric: dict[str, Any] = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        factors = splu(normal, permc_spec="MMD_AT_PLUS_A", **symmetric)
        lower = factors.L @ sparse.diags_array(np.sqrt(factors.U.diagonal()))
        beyond = sparse.eye_array(n) + lower.T
        triangular = [splu(each.tocsc(), permc_spec="NATURAL", **symmetric) for each in (lower, beyond)]
        return self.columns[:, np.argsort(factors.perm_c)], triangular[0], triangular[1]
