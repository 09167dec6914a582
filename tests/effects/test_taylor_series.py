"""The truncated series that effects act on, against functions whose derivatives are known."""

import numpy as np
import pytest

from femfit.effects.taylor_series import TaylorSeries, current_series, distance_series

D = np.array([0.5, 1.3, 2.0])
I = np.array([-0.7, 0.4, 1.1])  # noqa: E741 - the field's symbol


def _product() -> TaylorSeries:
    d, i = distance_series(D, 3, 3), current_series(I, 3, 3)
    return d * d * i + 2.0 * (i * i * i)


def test_products_carry_every_derivative_of_a_polynomial():
    f = _product()
    np.testing.assert_allclose(f.value, D**2 * I + 2 * I**3, rtol=1e-14)
    np.testing.assert_allclose(f.derivative(1, 1), 2 * D, rtol=1e-14)
    np.testing.assert_allclose(f.derivative(2, 1), np.full(3, 2.0), rtol=1e-14)
    np.testing.assert_allclose(f.derivative(0, 3), np.full(3, 12.0), rtol=1e-14)


def test_derivatives_of_a_series_are_series_of_the_derivatives():
    f = _product()
    np.testing.assert_allclose(f.along_distance().derivative(1, 1), f.derivative(2, 1), rtol=1e-14)
    np.testing.assert_allclose(f.along_current().derivative(2, 0), f.derivative(2, 1), rtol=1e-14)


def test_composition_is_the_chain_rule():
    f = _product()
    e = np.exp(f.value)
    g = f.compose([e] * 8)
    fd, fi, fdi = f.derivative(1, 0), f.derivative(0, 1), f.derivative(1, 1)
    np.testing.assert_allclose(g.derivative(1, 0), e * fd, rtol=1e-13)
    np.testing.assert_allclose(g.derivative(1, 1), e * (fd * fi + fdi), rtol=1e-13)
    fii = f.derivative(0, 2)
    np.testing.assert_allclose(g.derivative(0, 2), e * (fi**2 + fii), rtol=1e-13)


def test_scaling_the_variables_is_evaluating_elsewhere():
    scaled = (distance_series(2.0 * D, 2, 2) * current_series(3.0 * I, 2, 2)).scaled(2.0, 3.0)
    direct = 6.0 * (distance_series(D, 2, 2) * current_series(I, 2, 2))
    np.testing.assert_allclose(scaled.coefficients, direct.coefficients, rtol=1e-14)


def test_the_hall_part_obeys_the_product_rule_and_keeps_first_order_only():
    f = _product()
    with_hall = TaylorSeries(np.stack([f.coefficients[0], 0.25 * f.coefficients[0]]))
    square = with_hall * with_hall
    np.testing.assert_allclose(square.derivative(0, 0, 1), 2 * f.value * 0.25 * f.value, rtol=1e-14)
    np.testing.assert_allclose(square.derivative(0, 0, 0), f.value**2, rtol=1e-14)


@pytest.mark.parametrize("factor", [2.0, np.array([1.0, -2.0, 0.5])])
def test_sums_and_multiples(factor):
    f = _product()
    np.testing.assert_allclose((f + factor * f).value, (1 + factor) * f.value, rtol=1e-14)
    np.testing.assert_allclose((f - f).coefficients, 0.0, atol=1e-15)
