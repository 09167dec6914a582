"""How far currents get within a step, against the exponential of a matrix, and the elimination that it takes."""

import casadi as ca
import numpy as np
import pytest
from casadi import SX
from scipy.linalg import expm

from femfit.core.graph import GraphFunction, building
from femfit.core.numerics import central_differences
from femfit.model.decay import decayed, eliminated

RANDOM = np.random.default_rng(6)
PRODUCTS = np.geomspace(1e-6, 1e4, 21)
"""Step times R/L."""


def positive(m, count=None):
    """Symmetric positive definite matrices."""
    parts = RANDOM.normal(size=(*([] if count is None else [count]), m, m))
    return parts @ np.swapaxes(parts, -1, -2) + 0.1 * np.eye(m)


def shares(inductance, resistances, step):
    """f1(M) L^-1 and f2(M) L^-1 of the module, from the exponential of a block matrix."""
    m = len(resistances)
    block = np.zeros((3 * m, 3 * m))
    block[:m, :m] = -step * np.linalg.solve(inductance, np.diag(resistances))
    block[:m, m : 2 * m] = block[m : 2 * m, 2 * m :] = np.eye(m)
    whole = expm(block)
    return whole[:m, m : 2 * m] @ np.linalg.inv(inductance), whole[:m, 2 * m :] @ np.linalg.inv(inductance)


def function_of(m, wide=None):
    """(L, R, b, h) -> both parts, one column below the other; b is of so many columns."""
    wide = m if wide is None else wide
    with building():
        inputs = [SX.sym(name, size) for name, size in (("L", m * m), ("R", m), ("b", m * wide), ("h", 1))]
        matrix, resistances, driving, step = inputs
        parts = decayed(ca.reshape(matrix, m, m), resistances, ca.reshape(driving, m, wide), step)
        return GraphFunction(inputs, ca.vertcat(*(ca.vec(part) for part in parts)))


@pytest.mark.parametrize("m", [1, 2, 3, 5])
def test_the_parts_of_a_decay_are_those_of_the_exponential_at_any_stiffness(m):
    function, eye = function_of(m), np.eye(m).ravel()
    for product in PRODUCTS:
        inductance, resistances = positive(m), RANDOM.uniform(0.5, 2.0, m)
        step = product / np.linalg.eigvals(np.linalg.solve(inductance, np.diag(resistances))).real.max()
        found = function(inductance.ravel(), resistances, eye, np.array([step])).ravel()
        # f1 is off by 1.6e-10 and f2 by 2.6e-9 where they are largest, 1 and 1/2
        each = zip(np.split(found, 2), shares(inductance, resistances, step), (2e-10, 5.5e-9), strict=True)
        for part, wanted, error in each:
            assert np.abs(part.reshape(m, m).T - wanted).max() < error * np.abs(wanted).max()


def test_one_winding_decays_exactly_and_one_of_no_inductance_keeps_its_rate():
    """1 - z/2 + .. and 1/2 - z/6 + .. for a slow coil, 1/z of a settled one; beyond a co-energy's table L may fall."""
    z = np.array([1e-3, 1.0, 1e6])
    ones = np.ones((1, 3))
    first, second = function_of(1)(ones, z[None], ones, ones)
    np.testing.assert_allclose(first, [1.0 - 5e-4 + 1e-6 / 6.0, 1.0 - np.exp(-1.0), 1e-6], rtol=1e-9)
    np.testing.assert_allclose(second, [0.5 - 1e-3 / 6.0 + 1e-6 / 24.0, np.exp(-1.0), 1e-6], rtol=2e-6)
    negative = function_of(1)(-ones, z[None], ones, ones)
    np.testing.assert_allclose(negative, [[-1.0] * 3, [-0.5] * 3], rtol=1e-6)


@pytest.mark.parametrize("m", [1, 3])
def test_the_slopes_of_a_decay_are_its_differences(m):
    function = function_of(m, 1)
    with building():
        x = SX.sym("x", m * m + 2 * m + 1)
        matrix, resistances, driving, step = ca.vertsplit(x, [0, m * m, m * m + m, m * m + 2 * m, x.numel()])
        parts = decayed(ca.reshape(matrix, m, m), resistances, driving, step)
        slope = GraphFunction([x], ca.vec(ca.jacobian(ca.vertcat(*parts), x)))
    at = np.array([[*positive(m).ravel(), *RANDOM.uniform(0.5, 2.0, m), *RANDOM.normal(size=m), h] for h in (0.1, 3.0)])

    def symmetric(points):
        one = points[:, : m * m].reshape(-1, m, m)
        return np.column_stack([0.5 * (one + np.swapaxes(one, 1, 2)).reshape(-1, m * m), points[:, m * m :]])

    def stepped(points):
        parts = np.split(symmetric(points).T, [m * m, m * m + m, m * m + 2 * m])
        return function(*parts).T

    wanted = central_differences(stepped, at, np.ones(at.shape[1]))
    found = slope(at.T).T.reshape(len(at), at.shape[1], -1).swapaxes(1, 2)
    along = found[..., : m * m].reshape(*found.shape[:2], m, m)
    found[..., : m * m] = 0.5 * (along + np.swapaxes(along, 2, 3)).reshape(*found.shape[:2], m * m)  # in both places
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("m", [1, 2, 4])
def test_elimination_solves_what_numpy_solves(m):
    with building():
        matrix, right = SX.sym("A", m * m), SX.sym("B", 2 * m)
        solution = ca.vec(eliminated(ca.reshape(matrix, m, m), ca.reshape(right, m, 2)))
        function = GraphFunction([matrix, right], solution)
    matrices, rights = positive(m, 50), RANDOM.normal(size=(50, m, 2))
    found = function(matrices.reshape(50, -1).T, rights.transpose(2, 1, 0).reshape(2 * m, 50))
    wanted = np.linalg.solve(matrices, rights)
    np.testing.assert_allclose(found.T.reshape(50, 2, m).swapaxes(1, 2), wanted, rtol=1e-8, atol=1e-11)
