"""The Riccati equation against scipy's solver."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from femfit.core.errors import DomainError
from femfit.simulation.operating_point import feedback_gain, solve_riccati


@pytest.mark.parametrize("seed", range(6))
def test_the_solution_is_that_of_scipy(seed):
    generator = np.random.default_rng(seed)
    n, m = 4, 1 + seed % 3
    A, B = generator.standard_normal((n, n)), generator.standard_normal((n, m))
    root, R = generator.standard_normal((n, n)), np.diag(generator.uniform(0.1, 10.0, m))
    X = solve_discrete_are(A, B, root @ root.T, R)
    # Both solve to rounding, times the condition of some hundreds that random matrices have
    np.testing.assert_allclose(solve_riccati(A, B, root @ root.T, R), X, rtol=1e-8, atol=1e-8 * np.abs(X).max())
    K = np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A)
    np.testing.assert_allclose(feedback_gain(A, B, root @ root.T, R), K, rtol=1e-7, atol=1e-7 * np.abs(K).max())


@pytest.mark.parametrize(
    ("A", "B", "Q"),
    [
        (np.diag([2.0, 0.5]), np.eye(2), np.diag([0.0, 1.0])),
        (np.diag([2.0, 0.5]), np.array([[0.0], [1.0]]), np.eye(2)),
    ],
    ids=["a growing state is not weighed", "a growing state is not moved"],
)
def test_a_loop_that_would_still_grow_is_refused(A, B, Q):
    with pytest.raises(DomainError, match="stabilising"):
        solve_riccati(A, B, Q, np.eye(B.shape[1]))
