"""Force, flux linkage, motional constant and inductance belong to one co-energy, of whatever kind; its splines."""

from functools import partial

import numpy as np
import pytest

from femfit.core.numerics import central_differences
from femfit.laws.catalogue import BUILT_IN, all_laws
from femfit.model.bspline import LINE, DistanceCoordinate, TensorSpline, basis_matrix
from femfit.model.eddy_currents import EddyMagnetics
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics
from femfit.model.several_magnetics import CircuitAxis, CoenergyTensor
from femfit.simulation.open_loop import simulate
from support.coenergies import partials
from support.eddies import REFERENCE_M, couplings, eddies, flux_linkages, inductances, knots_over
from support.one_current import flat

RANDOM = np.random.default_rng(5)
DISTANCE, CURRENT = RANDOM.uniform(0.017, 0.043, 40), RANDOM.uniform(0.1, 1.3, 40)
TIMES = (10e-3, 3e-3, 0.5e-3)
TWO_GAPS = DistanceCoordinate(0.5e-3, kind="two_gaps", stretch_m=0.2e-3)


def law_magnetics(law):
    shape = {parameter.name: parameter.start for parameter in law.shape}
    typical = np.abs(law.columns(np.array([0.02]), shape)[0])
    coefficients = tuple(
        Coefficient(name, power, 0.02 * (k + 1) / (power + 1) / size, "")
        for k, (name, size) in enumerate(zip(law.basis, typical, strict=True))
        for power in (0, 1, 2)
    )
    return LawMagnetics(law.name, coefficients, shape, 0.016, 1e-3)


@pytest.fixture(params=["spline", "shifted spline", "plain spline", *(law.name for law in BUILT_IN)])
def magnetics(request, levitation_model):
    known = levitation_model.magnetics
    # d_0 / (d + s) spans 1/3 .. 1 over 15 .. 45 mm for no other s than zero; here over 10 .. 50 mm.
    coordinates = {
        "spline": known.coordinate,
        "shifted spline": DistanceCoordinate(0.02, 0.01),
        "plain spline": DistanceCoordinate(0.045, kind="distance"),
    }
    if request.param in coordinates:
        return CoenergySpline(coordinates[request.param], known.spline)
    return law_magnetics(all_laws()[request.param])


def assert_close(values, wanted, rtol=1e-10):
    np.testing.assert_allclose(values, wanted, rtol=0.0, atol=rtol * np.abs(wanted).max())


def test_named_quantities_are_the_co_energys_derivatives_and_broadcast(magnetics):
    orders = ((1, 0), (0, 1), (1, 1), (0, 2), (2, 0))
    d_w, i_w, di_w, ii_w, dd_w = partials(magnetics.expression, DISTANCE, CURRENT, orders)
    named = {
        "force": -d_w,
        "flux_linkage": i_w,
        "motional_constant": -di_w,
        "inductance": ii_w,
        "force_gradient": -dd_w,
    }
    for name, wanted in named.items():
        assert_close(getattr(flat(magnetics), name)(DISTANCE, CURRENT), wanted, 1e-13)
    state = magnetics.state(DISTANCE, CURRENT[:, None])
    assert_close(state.force, -d_w, 1e-13)
    assert_close(state.inductance[:, 0, 0], ii_w, 1e-13)
    grid = flat(magnetics).force(DISTANCE[:, None], CURRENT[None, :3])
    assert_close(grid[:, 1], flat(magnetics).force(DISTANCE, CURRENT[1]), 1e-13)
    assert flat(magnetics).force(np.asarray(0.02), np.asarray(0.3)).shape == ()


def test_a_coordinate_between_two_gaps_has_the_slopes_of_differences_and_leads_back():
    d, h = np.linspace(0.1e-3, 0.9e-3, 9), 1e-8
    u, slope, bend = TWO_GAPS.with_slopes(d)
    np.testing.assert_allclose(TWO_GAPS.distance(u), d, rtol=1e-12)
    np.testing.assert_allclose(slope, (TWO_GAPS.of(d + h) - TWO_GAPS.of(d - h)) / (2 * h), rtol=1e-6)
    slopes = [TWO_GAPS.with_slopes(d + change)[1] for change in (h, -h)]
    np.testing.assert_allclose(bend, (slopes[0] - slopes[1]) / (2 * h), rtol=1e-5, atol=1.0)


# Eddy currents: further windings of the same co-energy


@pytest.mark.parametrize("n", [1, 2])
def test_patterns_shift_the_currents_and_add_their_own_energy_and_all_slopes_are_the_co_energy_s(n):
    generator = np.random.default_rng(8)
    knots, along = knots_over(0.015, 0.045, 4), np.array([-4.0] * 5 + [0.1] + [4.0] * 5)
    coordinate, coefficients = DistanceCoordinate(REFERENCE_M, kind="distance"), generator.normal(size=(5, *[6] * n))
    static = (
        CoenergySpline(coordinate, TensorSpline(knots, along, 4, 4, coefficients))
        if n == 1
        else CoenergyTensor(coordinate, knots, 4, tuple(CircuitAxis(name, along, 4) for name in "ab"), coefficients)
    )
    device = EddyMagnetics(static, eddies(("a", "b")[:n], TIMES))
    d, w = generator.uniform(0.016, 0.044, 40), generator.uniform(-1.5, 1.5, (40, n + 3))
    u, e, own = d / REFERENCE_M, w[:, n:], np.empty((40, 3, 3))
    rows, columns = np.triu_indices(3)
    own[:, rows, columns] = own[:, columns, rows] = inductances(u, n, 3, TIMES)
    acting = w[:, :n] + (couplings(u, n, 3) @ e[..., None])[..., 0]
    energy = static.coenergy(d, acting) + np.einsum("pj,pjk,pk->p", e, 0.5 * own, e)
    assert_close(device.coenergy(d, w), energy + (flux_linkages(u, n, 3) * e).sum(axis=1))
    scale = np.array([1e-2, *[1.0] * w.shape[1]])

    def slopes_of(function):
        def flat(x):
            return function(x[:, 0], x[:, 1:]).reshape(len(x), -1)

        return central_differences(flat, np.column_stack([d, w]), scale)

    first, of_force, of_flux = (slopes_of(f) for f in (device.coenergy, device.force, device.flux_linkage))
    state, slopes = device.state(d, w), device.slopes(d, w)
    for values, wanted in (
        (-state.force, first[:, 0, 0]),
        (device.flux_linkage(d, w), first[:, 0, 1:]),
        (slopes.force_gradient, of_force[:, 0, 0]),
        (state.motional_constant, of_force[:, 0, 1:]),
        (state.motional_constant, -of_flux[:, :, 0]),
        (state.inductance, of_flux[:, :, 1:]),
        (slopes.motional_constant, state.motional_constant),
        (slopes.inductance, state.inductance),
    ):
        assert_close(values, wanted, 1e-7)


def test_scaled_turns_leave_what_the_patterns_do_to_the_field():
    """W_s(d, s i + C e): the patterns' own field does not know how many turns a coil has."""
    patterns = eddies(("coil",), TIMES)
    (plain,) = patterns.forms(np.array(0.02))
    (scaled,) = patterns.scaled(1.1, np.array([2.0])).forms(np.array(0.02))
    np.testing.assert_allclose(2.0 * scaled.coupling, plain.coupling)
    np.testing.assert_allclose(scaled.flux_linkage, 1.1 * plain.flux_linkage)
    np.testing.assert_allclose(scaled.inductance, plain.inductance)


# Beyond the swept currents a co-energy of iron that saturates stays convex, one function, and twice differentiable

BETWEEN = np.geomspace(0.25e-3, 5.5e-3, 17)


@pytest.fixture
def saturating(model_kind):
    return model_kind("saturating")


@pytest.mark.parametrize(("end", "beyond"), [(0.0, [-1e-9, -0.3, -15.0]), (1.0, [1.0 + 1e-9, 1.3, 15.0])])
def test_the_inductance_is_held_at_that_of_the_last_current(saturating, end, beyond):
    last = flat(saturating.magnetics).inductance(BETWEEN, np.full(17, end))
    assert last.min() > 0.0
    for current in beyond:
        values = flat(saturating.magnetics).inductance(BETWEEN, np.full(17, current))
        np.testing.assert_allclose(values, last, rtol=1e-6)  # 1e-9 A inside, its slope changes it by as little


def test_all_energy_of_a_simulation_far_beyond_the_currents_is_accounted_for(saturating):
    motions = [
        simulate(saturating, voltage_V=120.0, start_m=start, duration_s=0.01, outside="extrapolate")
        for start in 5e-3 + 1e-9 * np.arange(3)
    ]
    for motion in motions:
        assert "current" in dict(motion.left_domain)
        assert motion.table["current_A"].max() > 2.0
        assert np.all(np.diff(motion.table["current_A"][:20]) > 0.0)
    # How the integrator's steps meet the kink of the inductance at the last current is chance, worth 1e-6 at times
    assert np.median([abs(one.energy.remainder_J) / one.energy.supplied_J for one in motions]) < 1e-6


def test_a_field_goes_on_as_a_straight_line():
    knots = np.repeat([0.0, 1.0], 4)
    spline = TensorSpline(np.repeat([0.0, 1.0], 2), knots, 1, 3, np.tile([0.0, 1.0, 1.5, 1.6], (2, 1)))
    x, beyond = np.full(3, 0.4), np.array([1.0, 3.0, 15.0])
    value, slope = partials(partial(spline.expression, beyond=LINE), x, beyond, ((0, 0), (0, 1)))
    np.testing.assert_allclose(slope, 0.3)  # three times the last difference of the coefficients
    np.testing.assert_allclose(value, 1.6 + 0.3 * (beyond - 1.0))


@pytest.mark.parametrize("order", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (2, 1), (0, 3), (5, 0)])
def test_tensor_spline_equals_its_basis_sum(order):
    x_knots, y_knots = np.r_[[0.0] * 5, 0.2, 0.5, 0.9, [1.0] * 5], np.r_[[0.0] * 4, 0.4, [1.0] * 4]
    coefficients = RANDOM.normal(size=(8, 5))
    spline = TensorSpline(x_knots, y_knots, 4, 3, coefficients)
    x = np.concatenate([RANDOM.uniform(-0.1, 1.1, 300), x_knots])
    y = RANDOM.uniform(0.0, 1.0, len(x))  # beyond its knots y goes on otherwise
    rows = basis_matrix(x, x_knots, 4, order[0]), basis_matrix(y, y_knots, 3, order[1])
    expected = np.einsum("ni,ij,nj->n", rows[0], coefficients, rows[1])
    (value,) = partials(spline.expression, x, y, (order,))
    # Conversion to one polynomial a cell costs a few digits in the highest derivatives.
    np.testing.assert_allclose(value, expected, atol=1e-10 * max(1.0, np.abs(expected).max()))
