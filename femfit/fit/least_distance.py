"""Least squares with linear inequalities by an active-set method, independent of OSQP.

References
----------
C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (SIAM, 1995), chapter 23 (problems LSI and LDP).
"""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from femfit.core.arrays import FloatArray
from femfit.core.errors import InfeasibleFitError


def solve_least_distance(triangle: FloatArray, q: FloatArray, G: FloatArray, h: FloatArray) -> FloatArray:
    """Minimise ||R z - q||^2 subject to G z >= h by non-negative least squares.

    With w = R z - q the problem is: minimise ||w|| subject to G R^-1 w >= h - G R^-1 q, whose dual is a non-negative
    least-squares problem.

    Parameters
    ----------
    triangle : array, shape (k, k)
        R, upper triangular and regular.
    q : array, shape (k,)
        Right side.
    G, h : array, shapes (m, k) and (m,)
        Inequalities.

    Returns
    -------
    array, shape (k,)
        z.

    Raises
    ------
    InfeasibleFitError
        If no z satisfies the inequalities.

    References
    ----------
    Lawson and Hanson (1995), section 23.4.
    """
    if len(h) == 0:
        return np.asarray(solve_triangular(triangle, q))
    moved = solve_triangular(triangle, G.T, trans="T").T
    shifted = h - moved @ q
    system = np.vstack([moved.T, shifted])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    multipliers, _ = nnls(system, goal, maxiter=30 * system.shape[1])
    rest = system @ multipliers - goal
    if abs(rest[-1]) < 1e-13:
        raise InfeasibleFitError(
            f"The fit is infeasible, because no coefficients satisfy all {len(h)} bounds and inequalities at once. "
            "Drop or widen some of them."
        )
    return np.asarray(solve_triangular(triangle, q - rest[:-1] / rest[-1]))
