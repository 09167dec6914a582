"""Poles of state feedback, and the Riccati equation against scipy's solver."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from femfit.core.errors import DomainError
from femfit.simulation.adjust import adjusted
from femfit.simulation.operating_point import feedback_gain, solve_riccati


@pytest.mark.parametrize("latency", [0, 2])
def test_poles_lie_where_they_are_given(design, latency):
    """Of x+ = A x + B u(k - q), q+ = q + t d, u = -K x - P (pending) - k q, all written out here."""
    poles = [-300.0, -120.0 + 60.0j, -120.0 - 60.0j, -40.0]
    late = replace(design, latency=latency)
    found = adjusted(late, "state-feedback", poles_rad_s=poles).controller("state-feedback")
    bench, step = late.bench("exact"), design.model.sample_time_s
    plant = bench.plants[bench.middle]
    loop = np.zeros((4 + latency, 4 + latency))
    law = -np.concatenate([found.gains[0], found.pending[0], found.integral])
    loop[:3, :3], loop[-1, -1], loop[-1, 0] = plant.A[:3, :3], 1.0, step
    if latency:
        loop[:3, 2 + latency] = plant.B[:3, 0]
        loop[3] = law
        for k in range(1, latency):
            loop[3 + k, 2 + k] = 1.0
    else:
        loop[:3] += np.outer(plant.B[:3, 0], law)
    multipliers = np.linalg.eigvals(loop)
    multipliers = multipliers[np.argsort(-np.abs(multipliers))]
    rates = np.log(multipliers[:4]) / step
    np.testing.assert_allclose(np.sort_complex(rates), np.sort_complex(np.array(poles)), rtol=1e-5)
    # Commands on their way stay at zero, where a double root splits by the root of rounding
    assert np.all(np.abs(multipliers[4:]) < 1e-3)


@pytest.mark.parametrize("lonely", [[-300.0, -200.0, -120.0 + 60.0j, -40.0], [-300.0, -9.0 + 2.0j, -9.0 + 2.0j, -40.0]])
def test_a_pole_without_its_conjugate_is_refused(design, lonely):
    with pytest.raises(DomainError, match="conjugate"):
        adjusted(design, "state-feedback", poles_rad_s=lonely)


def test_too_few_poles_are_refused_with_their_number(design):
    with pytest.raises(DomainError, match="-10"):
        adjusted(design, "state-feedback", poles_rad_s=[-10.0])


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


def test_a_state_that_grows_is_brought_back_though_it_is_not_weighed():
    A, B = np.diag([2.0, 0.5]), np.eye(2)
    X = solve_riccati(A, B, np.diag([0.0, 1.0]), np.eye(2))
    K = np.linalg.solve(np.eye(2) + B.T @ X @ B, B.T @ X @ A)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() == pytest.approx(0.5)  # the growing one mirrored


def test_a_loop_that_would_still_grow_is_refused():
    with pytest.raises(DomainError, match="stabilising"):
        solve_riccati(np.diag([2.0, 0.5]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
