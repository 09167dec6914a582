"""Beyond the swept currents a co-energy of iron that saturates stays convex, one function, and twice differentiable."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Circuit
from femfit.device.mechanics import Mechanics
from femfit.fit.build import fit_model
from femfit.model.bspline import LINE, TensorSpline
from femfit.model.dynamics import state_derivative, state_jacobian
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.simulation.open_loop import simulate
from support.saturating_circuit import SaturatingCircuit

DISTANCES = 1e-3 * np.array([0.2, 0.3, 0.4, 0.55, 0.75, 1.0, 1.4, 1.9, 2.6, 3.5, 4.6, 6.0])
BETWEEN = np.geomspace(0.25e-3, 5.5e-3, 17)
BODY = Mechanics(0.05, 0.0)


@pytest.fixture(scope="module")
def model():
    """Swept to 1 A, where the least distance saturates."""
    truth = SaturatingCircuit()
    fitted = fit_model(truth.table(np.linspace(0.0, 1.0, 6), DISTANCES)).model
    return replace(fitted, circuits=(Circuit(10.0, 0.0, 150.0),), motion=BODY)


@pytest.mark.parametrize(("end", "beyond"), [(0.0, [-1e-9, -0.3, -15.0]), (1.0, [1.0 + 1e-9, 1.3, 15.0])])
def test_the_inductance_is_held_at_that_of_the_last_current(model, end, beyond):
    at_the_end = model.magnetics.inductance(BETWEEN, np.full(17, end))
    assert at_the_end.min() > 0.0
    for current in beyond:
        found = model.magnetics.inductance(BETWEEN, np.full(17, current))
        np.testing.assert_allclose(found, at_the_end, rtol=1e-6)  # 1e-9 A inside, its slope changes it by as little


@pytest.mark.parametrize("current", [-8.0, -0.2, 1.2, 15.0])
def test_force_and_flux_linkage_stay_slopes_of_one_coenergy(model, current):
    magnetics, step, i = model.magnetics, 1e-7, np.full(17, current)
    rise = (magnetics.force(BETWEEN, i + 1e-3) - magnetics.force(BETWEEN, i - 1e-3)) / 2e-3
    fall = -(magnetics.flux_linkage(BETWEEN + step, i) - magnetics.flux_linkage(BETWEEN - step, i)) / (2.0 * step)
    # Central differences of second order over a thousandth of an ampere and 0.1 um
    np.testing.assert_allclose(rise, fall, rtol=1e-4, atol=1e-6 * np.abs(rise).max())
    np.testing.assert_allclose(rise, magnetics.motional_constant(BETWEEN, i), atol=1e-6 * np.abs(rise).max())


@pytest.mark.parametrize("current", [-3.0, 1.5, 15.0])
def test_the_jacobian_is_the_difference_quotient(model, current):
    state, voltage = np.array([[0.8e-3, 0.1, current]]), np.array([5.0])
    exact = state_jacobian(model, state, voltage)[0]
    for k, width in enumerate((1e-7, 1e-3, 1e-4)):
        move = width * np.eye(3)[k]
        ahead, back = (state_derivative(model, state + sign * move, voltage)[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead - back) / (2.0 * width), exact[:, k], rtol=1e-4, atol=1e-5)


def test_all_energy_of_a_simulation_far_beyond_the_currents_is_accounted_for(model):
    motion = simulate(model, voltage_V=120.0, start_m=5e-3, duration_s=0.01, outside="extrapolate")
    assert "current" in dict(motion.left_domain)
    assert motion.table["current_A"].max() > 2.0
    assert np.all(np.diff(motion.table["current_A"][:20]) > 0.0)
    assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


def test_the_file_and_the_floats_continue_it_alike(model):
    read = model_from_dict(model_to_dict(model)).magnetics
    orders = ((0, 0), (1, 0), (0, 1), (1, 1), (0, 2))
    d, i = BETWEEN[:5], np.array([-2.0, 0.0, 0.5, 1.0, 15.0])
    wanted = model.magnetics.coenergy_derivatives(d, i, orders)
    np.testing.assert_array_equal(read.coenergy_derivatives(d, i, orders), wanted)
    u, arrays = model.magnetics.coordinate.of(d), model.magnetics.spline.derivatives
    floats = model.magnetics.spline.in_floats(orders)(u.tolist(), i.tolist())
    np.testing.assert_allclose(floats, np.transpose(arrays(u, i, orders)), rtol=1e-9, atol=1e-14)


def test_a_field_goes_on_as_a_straight_line():
    knots = np.repeat([0.0, 1.0], 4)
    spline = TensorSpline(np.repeat([0.0, 1.0], 2), knots, 1, 3, np.tile([0.0, 1.0, 1.5, 1.6], (2, 1)), LINE)
    x, beyond = np.full(3, 0.4), np.array([1.0, 3.0, 15.0])
    value, slope = spline.derivatives(x, beyond, ((0, 0), (0, 1)))
    np.testing.assert_allclose(slope, 0.3)  # three times the last difference of the coefficients
    np.testing.assert_allclose(value, 1.6 + 0.3 * (beyond - 1.0))
