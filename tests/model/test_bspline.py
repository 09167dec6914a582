"""Splines agree with scipy's, inside of their knots and beyond."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from femfit.model.bspline import TensorSpline, basis_matrix, is_clamped
from support.coenergies import partials

RANDOM = np.random.default_rng(11)


def clamped(degree, inner):
    return np.r_[[0.0] * (degree + 1), inner, [1.0] * (degree + 1)]


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_basis_functions_and_derivatives_equal_scipys(degree, derivative):
    knots = clamped(degree, [0.1, 0.35, 0.35, 0.8] if degree > 2 else [0.1, 0.35, 0.8])
    # Off the knots, where a derivative may jump and the two may take different sides.
    x = RANDOM.uniform(-0.2, 1.2, 200)
    ours = basis_matrix(x, knots, degree, derivative)
    for k in range(ours.shape[1]):
        coefficients = np.eye(ours.shape[1])[k]
        spline = BSpline(knots, coefficients, degree)
        theirs = spline.derivative(derivative)(x) if 0 < derivative <= degree else spline(x) * (derivative == 0)
        # Rounding of sums of degree + 1 terms, relative to the largest basis function's derivative.
        np.testing.assert_allclose(ours[:, k], theirs, atol=1e-12 * max(1.0, np.abs(theirs).max()))


def test_basis_functions_sum_to_one_polynomials_are_exact_and_no_number_stays_none():
    knots = clamped(4, [0.2, 0.5])
    x = np.linspace(0.0, 1.0, 33)
    np.testing.assert_allclose(basis_matrix(x, knots, 4).sum(axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(basis_matrix(x, knots, 4, 1).sum(axis=1), 0.0, atol=1e-12)
    knots = np.r_[[2.0] * 3, [5.0] * 3]
    greville = np.array([2.0, 3.5, 5.0])
    spline = TensorSpline(knots, knots, 2, 2, np.add.outer(greville, 2.0 * greville))
    x = np.array([2.0, 3.0, 5.0, 6.0])
    np.testing.assert_allclose(partials(spline.expression, x, x[::-1], ((0, 0),))[0], x + 2.0 * x[::-1], rtol=1e-14)
    knots = clamped(2, [0.5])
    spline = TensorSpline(knots, knots, 2, 2, np.add.outer([0.0, 0.25, 0.75, 1.0], [0.0, 0.25, 0.75, 1.0]))  # x + y
    value = partials(spline.expression, np.array([np.nan, 0.3, 0.3]), np.array([0.3, np.nan, 0.3]), ((0, 0),))[0]
    assert np.isnan(value[:2]).all()
    assert value[2] == pytest.approx(0.6)


@pytest.mark.parametrize("order", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (2, 1), (0, 3), (5, 0)])
def test_tensor_spline_equals_its_basis_sum(order):
    x_knots, y_knots = clamped(4, [0.2, 0.5, 0.9]), clamped(3, [0.4])
    coefficients = RANDOM.normal(size=(8, 5))
    spline = TensorSpline(x_knots, y_knots, 4, 3, coefficients)
    x = np.concatenate([RANDOM.uniform(-0.1, 1.1, 300), x_knots])
    y = RANDOM.uniform(0.0, 1.0, len(x))  # beyond its knots y goes on otherwise
    rows = basis_matrix(x, x_knots, 4, order[0]), basis_matrix(y, y_knots, 3, order[1])
    expected = np.einsum("ni,ij,nj->n", rows[0], coefficients, rows[1])
    (value,) = partials(spline.expression, x, y, (order,))
    # Conversion to one polynomial a cell costs a few digits in the highest derivatives.
    np.testing.assert_allclose(value, expected, atol=1e-10 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize(
    ("knots", "carries"),
    [
        ([0, 0, 0, 1, 1, 1], True),
        ([0, 0, 0, 0.5, 0.5, 1, 1, 1], True),
        ([0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1], False),
        ([0, 0, 1, 1, 1], False),
        ([0, 0, 0, 0.7, 0.2, 1, 1, 1], False),
        ([0, 0, 0, 0, 1, 1, 1], False),
        ([0, 0, 0, 0, 0, 0], False),
    ],
)
def test_clamped_knots_of_degree_two(knots, carries):
    assert is_clamped(np.array(knots, dtype=float), 2) is carries
