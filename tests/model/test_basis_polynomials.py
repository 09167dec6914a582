"""The basis as polynomials of its cells is the basis by recursion, inside, at the knots and beyond the ends."""

import numpy as np
import pytest

from femfit.model.bspline import BasisPolynomials, basis_matrix

KNOTS = np.array([-2.0, -2.0, -2.0, -2.0, -1.2, -0.5, 0.1, 0.9, 1.5, 1.5, 1.5, 1.5])


@pytest.mark.parametrize("derivative", range(5))
def test_polynomials_and_recursion_agree(derivative):
    axis, x = BasisPolynomials(KNOTS, 3), np.concatenate([np.linspace(-2.3, 1.8, 57), KNOTS])
    found = axis.values(axis.places(x), derivative)
    wanted = basis_matrix(x, KNOTS, 3, derivative)
    # Rounding: values are of the order of one, derivatives of one over the narrowest cell each
    assert found == pytest.approx(wanted, abs=1e-12 / 0.4**derivative)
