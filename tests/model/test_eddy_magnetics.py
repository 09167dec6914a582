"""Eddy currents are windings of one co-energy: every quantity is a derivative of it."""

import numpy as np
import pytest

from femfit.core.numerics import central_differences
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.eddy_magnetics import EddyMagnetics
from femfit.model.magnetics import CoenergySpline
from femfit.model.several_magnetics import CoenergyMatrix, CoenergyTensor
from support.eddies import REFERENCE_M, couplings, eddies, flux_linkages, inductances, knots_over, spline_of

TIMES = (10e-3, 3e-3, 0.5e-3)
STATIC_DEGREE, DEGREE = 3, 7


def static_matrix(u, n):
    """Of (1, i_1 .. i_n): what magnets do alone, flux linkages and inductances, of second degree in u."""
    result = np.empty((len(u), n + 1, n + 1))
    for a in range(n + 1):
        for b in range(n + 1):
            size = (0.05, 0.02, 0.016)[min(a, 2)] if a == b else 0.004
            result[:, a, b] = size * (1.0 + 0.3 * (1.0 - u) * (1.0 + 0.1 * (a + b)) + 0.2 * (1.0 - u) ** 2)
    return result


def whole_matrix(u, n, r):
    """The same of (1, i, e), worked out from the shift."""
    static, c, q = static_matrix(u, n), couplings(u, n, r), np.empty((len(u), r, r))
    rows, columns = np.triu_indices(r)
    q[:, rows, columns] = q[:, columns, rows] = inductances(u, n, r, TIMES[:r])
    shift = np.concatenate([np.zeros((len(u), 1, r)), c], axis=1)  # of (1, i)
    whole = np.empty((len(u), n + 1 + r, n + 1 + r))
    whole[:, : n + 1, : n + 1] = static
    whole[:, : n + 1, n + 1 :] = static @ shift
    whole[:, n + 1 :, : n + 1] = np.swapaxes(static @ shift, 1, 2)
    whole[:, n + 1 :, n + 1 :] = np.swapaxes(shift, 1, 2) @ static @ shift + q
    linked = flux_linkages(u, n, r)
    whole[:, 0, n + 1 :] += linked
    whole[:, n + 1 :, 0] += linked
    return whole


def matrix_magnetics(names, function, degree):
    knots = knots_over(0.015, 0.045, degree)
    rows, columns = np.triu_indices(len(names) + 1)
    coefficients = spline_of(lambda u: function(u)[:, rows, columns], knots, degree)
    return CoenergyMatrix(names, DistanceCoordinate(REFERENCE_M, inverse=False), knots, degree, coefficients)


def points(n, r, count=40):
    generator = np.random.default_rng(3)
    return generator.uniform(0.016, 0.044, count), generator.uniform(-1.5, 1.5, (count, n + r))


def assert_close(found, wanted, rtol=1e-10):
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=rtol * np.abs(wanted).max())


def spline_magnetics(n):
    """The same static co-energy of no or one circuit, as a spline of one cell in the current."""
    knots = knots_over(0.015, 0.045, STATIC_DEGREE)
    along = np.array([-2.0, -2.0, -2.0, 2.0, 2.0, 2.0])
    i = np.linspace(-2.0, 2.0, 7)
    currents = np.linalg.pinv(basis_matrix(i, along, 2))

    def values(u):
        matrix = static_matrix(u, n)
        v = np.stack([np.ones_like(i), i])[: n + 1]
        return 0.5 * np.einsum("ap,uab,bp->up", v, matrix, v) @ currents.T

    spline = TensorSpline(knots, along, STATIC_DEGREE, 2, spline_of(values, knots, STATIC_DEGREE))
    return CoenergySpline(DistanceCoordinate(REFERENCE_M, inverse=False), spline)


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_a_linear_device_with_patterns_is_one_with_further_circuits(n):
    names = tuple(f"coil_{k}" for k in range(n))
    static = matrix_magnetics(names, lambda u: static_matrix(u, n), STATIC_DEGREE) if n > 1 else spline_magnetics(n)
    whole = matrix_magnetics((*names, "a", "b", "c"), lambda u: whole_matrix(u, n, 3), DEGREE)
    shifted = EddyMagnetics(static, eddies(names, TIMES))
    d, w = points(n, 3)
    found, wanted = shifted.state(d, w), whole.state(d, w)
    assert_close(shifted.coenergy(d, w), whole.coenergy(d, w))
    assert_close(shifted.flux_linkage(d, w), whole.flux_linkage(d, w))
    assert_close(found.force, wanted.force)
    assert_close(found.motional_constant, wanted.motional_constant)
    assert_close(found.inductance, wanted.inductance)
    slopes, of_whole = shifted.slopes_of_circuits(d, w), whole.slopes_of_circuits(d, w)
    for name in ("force_gradient", "motional_gradient", "inductance_gradient", "motional_constant", "inductance"):
        assert_close(getattr(slopes, name), getattr(of_whole, name), 1e-8)  # a second derivative of degree seven
    assert not slopes.inductance_slope.any() or (n == 1 and np.abs(slopes.inductance_slope).max() < 1e-12)


@pytest.fixture(scope="module", params=[1, 2])
def saturating(request):
    """Static co-energies of any shape in their currents, with patterns."""
    n, generator = request.param, np.random.default_rng(8)
    knots, along = knots_over(0.015, 0.045, 4), np.array([-4.0] * 5 + [0.1] + [4.0] * 5)
    coordinate, coefficients = DistanceCoordinate(REFERENCE_M, inverse=False), generator.normal(size=(5, *[6] * n))
    if n == 1:
        static = CoenergySpline(coordinate, TensorSpline(knots, along, 4, 4, coefficients))
    else:
        static = CoenergyTensor(("a", "b"), coordinate, knots, 4, (along,) * n, (4,) * n, coefficients)
    return EddyMagnetics(static, eddies(("a", "b")[:n], TIMES))


def test_all_slopes_of_a_saturating_device_are_those_of_its_co_energy(saturating):
    n = len(saturating.eddy.circuits)
    d, w = points(n, 3)
    points_of = np.column_stack([d, w])
    scale = np.array([1e-2, *[1.0] * w.shape[1]])

    def slopes_of(function):
        return central_differences(lambda x: function(x[:, 0], x[:, 1:]).reshape(len(x), -1), points_of, scale)

    first = slopes_of(saturating.coenergy)[:, 0]
    state, slopes = saturating.state(d, w), saturating.slopes_of_circuits(d, w)
    assert_close(-state.force, first[:, 0], 1e-7)
    assert_close(saturating.flux_linkage(d, w), first[:, 1:], 1e-7)
    of_force, of_flux = slopes_of(saturating.force)[:, 0], slopes_of(saturating.flux_linkage)
    assert_close(slopes.force_gradient, of_force[:, 0], 1e-7)
    assert_close(state.motional_constant, of_force[:, 1:], 1e-7)
    assert_close(state.motional_constant, -of_flux[:, :, 0], 1e-7)
    assert_close(state.inductance, of_flux[:, :, 1:], 1e-7)
    assert_close(slopes.motional_constant, state.motional_constant)
    assert_close(slopes.inductance, state.inductance)
    of_motional = slopes_of(saturating.motional_constant)
    of_inductance = slopes_of(saturating.inductance).reshape(*state.inductance.shape, -1)
    assert_close(slopes.motional_gradient, of_motional[:, :, 0], 1e-7)
    assert_close(-slopes.inductance_gradient, of_motional[:, :, 1:], 1e-7)
    assert_close(slopes.inductance_gradient, of_inductance[..., 0], 1e-7)
    assert_close(slopes.inductance_slope, of_inductance[..., 1:], 1e-7)


def test_scaled_turns_leave_what_the_patterns_do_to_the_field():
    """W_s(d, s i + C e): the patterns' own field does not know how many turns a coil has."""
    patterns = eddies(("coil",), TIMES)
    (at,) = patterns.forms(np.array(0.02))
    (scaled,) = patterns.scaled(1.1, np.array([2.0])).forms(np.array(0.02))
    np.testing.assert_allclose(2.0 * scaled.coupling, at.coupling)
    np.testing.assert_allclose(scaled.flux_linkage, 1.1 * at.flux_linkage)
    np.testing.assert_allclose(scaled.inductance, at.inductance)
