"""Force, flux linkage, motional constant and inductance belong to one co-energy."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Circuit
from femfit.device.mechanics import Mechanics
from femfit.laws.catalogue import BUILT_IN
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.dynamics import (
    runge_kutta_step,
    state_derivative,
    state_jacobian,
)
from femfit.model.exponential_step import exponential_jacobian, exponential_step
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics

RANDOM = np.random.default_rng(5)
DISTANCE, CURRENT = RANDOM.uniform(0.017, 0.043, 40), RANDOM.uniform(0.1, 1.3, 40)


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
    if request.param == "spline":
        return levitation_model.magnetics
    if request.param == "shifted spline":
        spline = levitation_model.magnetics.spline
        # d_0 / (d + s) spans 1/3 .. 1 over 15 .. 45 mm for no other s than zero; here over 10 .. 50 mm.
        return CoenergySpline(DistanceCoordinate(0.02, 0.01), spline)
    if request.param == "plain spline":
        spline = levitation_model.magnetics.spline
        return CoenergySpline(DistanceCoordinate(0.045, inverse=False), spline)
    return law_magnetics(next(law for law in BUILT_IN if law.name == request.param))


def central_difference(function, x, width):
    """Fourth-order central difference."""
    return (8.0 * (function(x + width) - function(x - width)) - (function(x + 2 * width) - function(x - 2 * width))) / (
        12.0 * width
    )


@pytest.mark.parametrize("order", [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2)])
def test_each_derivative_is_the_difference_quotient_of_the_one_below(magnetics, order):
    def at(d, i, a, b):
        return magnetics.coenergy_derivatives(d, i, ((a, b),))[0]

    in_distance = central_difference(lambda d: at(d, CURRENT, *order), DISTANCE, 2e-5)
    in_current = central_difference(lambda i: at(DISTANCE, i, *order), CURRENT, 2e-3)
    # Rounding 1e-16 / (width / scale 1e-3) and truncation (1e-3)^4 of terms up to d^-9 relative to their largest value.
    for found, exact in (
        (in_distance, at(DISTANCE, CURRENT, order[0] + 1, order[1])),
        (in_current, at(DISTANCE, CURRENT, order[0], order[1] + 1)),
    ):
        scale = np.abs(exact).max() + 1e-12 * np.abs(at(DISTANCE, CURRENT, *order)).max() / 2e-5
        assert np.abs(found - exact).max() < 1e-6 * scale


def test_named_quantities_are_the_co_energys_derivatives(magnetics):
    d_w, i_w, di_w, ii_w, dd_w = magnetics.coenergy_derivatives(
        DISTANCE, CURRENT, ((1, 0), (0, 1), (1, 1), (0, 2), (2, 0))
    )
    np.testing.assert_array_equal(magnetics.force(DISTANCE, CURRENT), -d_w)
    np.testing.assert_array_equal(magnetics.flux_linkage(DISTANCE, CURRENT), i_w)
    np.testing.assert_array_equal(magnetics.motional_constant(DISTANCE, CURRENT), -di_w)
    np.testing.assert_array_equal(magnetics.inductance(DISTANCE, CURRENT), ii_w)
    np.testing.assert_array_equal(magnetics.force_gradient(DISTANCE, CURRENT), -dd_w)
    state = magnetics.state(DISTANCE, CURRENT)
    np.testing.assert_array_equal(state.force, -d_w)
    np.testing.assert_array_equal(state.inductance, ii_w)


def test_reciprocity_of_force_and_flux_linkage(magnetics):
    rise = central_difference(lambda i: magnetics.force(DISTANCE, i), CURRENT, 2e-3)
    fall = -central_difference(lambda d: magnetics.flux_linkage(d, CURRENT), DISTANCE, 2e-5)
    # As above: the difference quotients' own error.
    assert np.abs(rise - fall).max() < 1e-6 * np.abs(rise).max()


def test_shapes_broadcast_and_scalars_stay_scalars(magnetics):
    assert magnetics.force(DISTANCE[:, None], CURRENT[None, :3]).shape == (40, 3)
    assert magnetics.force(np.asarray(0.02), np.asarray(0.3)).shape == ()
    grid = magnetics.force(DISTANCE[:, None], CURRENT[None, :3])
    np.testing.assert_array_equal(grid[:, 1], magnetics.force(DISTANCE, CURRENT[1]))


def test_hall_slopes_are_difference_quotients(levitation_model):
    field = levitation_model.sensor.field
    value, in_distance, in_current = field.derivatives(DISTANCE, CURRENT)
    np.testing.assert_array_equal(value, field.field(DISTANCE, CURRENT))
    found = central_difference(lambda d: field.field(d, CURRENT), DISTANCE, 2e-5)
    assert np.abs(found - in_distance).max() < 1e-7 * np.abs(in_distance).max()
    found = central_difference(lambda i: field.field(DISTANCE, i), CURRENT, 2e-3)
    assert np.abs(found - in_current).max() < 1e-9 * np.abs(in_current).max()


@pytest.fixture
def states():
    return np.stack([DISTANCE, RANDOM.normal(scale=0.1, size=40), CURRENT], axis=1), RANDOM.uniform(0.5, 3.0, 40)


def test_energy_is_conserved_without_resistance_and_gravity(levitation_model):
    model = replace(levitation_model, circuits=(Circuit(1e-300, 0.0, 3.0),), motion=Mechanics(4.35e-3, 0.0))
    state = np.array([[0.025, -0.05, 0.6]])

    def energy(s):
        d, v, i = s[0, 0], s[0, 1], s[0, 2]
        magnetic = i * model.magnetics.flux_linkage(d, i) - model.magnetics.coenergy(d, i)
        return float(0.5 * 4.35e-3 * v**2 + magnetic)

    before = energy(state)
    after = energy(runge_kutta_step(model, state, np.zeros(1), 0.02, substeps=200))
    kinetic = 0.5 * 4.35e-3 * 0.05**2
    # Truncation of RK4 at 0.1 ms; back-EMF and force would differ by the whole exchanged energy if either sign was off.
    assert abs(after - before) < 1e-7 * kinetic


@pytest.mark.parametrize(
    ("function", "jacobian"),
    [
        (state_derivative, state_jacobian),
        (lambda m, x, u: exponential_step(m, x, u, 5e-4), lambda m, x, u: exponential_jacobian(m, x, u, 5e-4)),
        (lambda m, x, u: exponential_step(m, x, u, 3e-3), lambda m, x, u: exponential_jacobian(m, x, u, 3e-3)),
    ],
    ids=["derivative", "step", "step of the coil's time constant"],
)
def test_jacobians_are_difference_quotients(levitation_model, states, function, jacobian):
    state, voltage = states
    exact = jacobian(levitation_model, state, voltage)
    widths = np.array([2e-5, 1e-3, 2e-3])
    for k, width in enumerate(widths):
        offset = width * np.eye(3)[k]
        found = central_difference(
            lambda x, base=state, step=offset: function(levitation_model, base + x * step, voltage), 0.0, 1.0
        )
        # In units of what each state's typical change does to each component.
        scale = np.abs(exact[:, :, k] * width).max(axis=0) + 1e-9
        assert (np.abs(found - exact[:, :, k] * width) / scale).max() < 1e-6


def test_runge_kutta_converges_with_the_fourth_order(levitation_model):
    start, voltage = np.array([[0.024, 0.02, 0.4]]), np.array([1.5])
    exact = runge_kutta_step(levitation_model, start, voltage, 0.016, substeps=512)
    coarse, fine = (
        np.abs(runge_kutta_step(levitation_model, start, voltage, 0.016, substeps) - exact)[0, 0] for substeps in (4, 8)
    )
    # Asymptotic ratio 2^4; 10 % of an order for the pre-asymptotic part.
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.4)
