"""The discrete algebraic Riccati equation, by doubling; numpy alone.

    X = A^T X A - A^T X B (R + B^T X B)^-1 B^T X A + Q

Each step of the structure-preserving doubling algorithm takes as many steps of the recursion as all before together:

    W = (I + G H)^-1,    A' = A W A,    G' = G + A W G A^T,    H' = H + A^T H W A,    H -> X.

References
----------
E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, Int. J. Control 77 (2004) 767: structure-preserving algorithms for
periodic discrete-time algebraic Riccati equations.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError

_DOUBLINGS = 60


def solve_riccati(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """The stabilising solution X, of shape (n, n).

    Parameters
    ----------
    A, B, Q, R : array, shapes (n, n), (n, m), (n, n), (m, m)
        Q is positive semidefinite, R positive definite.

    Raises
    ------
    DomainError
        If there is none: an unstable state cannot be moved, or is not weighed.
    """
    n = len(A)
    # States of about equal weight, so that metres and volts do not hide each other
    scale = 1.0 / np.sqrt(np.maximum(np.diag(Q), 1e-12 * float(np.diag(Q).max())))
    a, h = A * scale / scale[:, None], Q * scale * scale[:, None]
    b = B / scale[:, None]
    g = b @ np.linalg.solve(R, b.T)
    first, weight = a, g
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            try:
                w = np.linalg.inv(np.eye(n) + g @ h)
            except np.linalg.LinAlgError:
                break
            more = a.T @ h @ w @ a
            a, g, h = a @ w @ a, g + a @ w @ g @ a.T, h + 0.5 * (more + more.T)
            g = 0.5 * (g + g.T)
            if not np.all(np.isfinite(h)):
                break
            if float(np.abs(more).max()) <= 1e-13 * float(np.abs(h).max()):
                # What is not weighed is left as it is, so that the doubling converges on a loop that still grows
                closed = np.linalg.solve(np.eye(n) + weight @ h, first)
                if np.abs(np.linalg.eigvals(closed)).max() >= 1.0:
                    break
                return np.asarray(h / scale / scale[:, None])
    raise DomainError(
        "The Riccati equation must have a stabilising solution; a state that grows cannot be moved by the drivers or "
        "is not weighed. Choose another point of rest, or other sensors."
    )


def feedback_gain(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """K of u = -K x that minimises sum x^T Q x + u^T R u, of shape (m, n)."""
    X = solve_riccati(A, B, Q, R)
    return np.asarray(np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A))
