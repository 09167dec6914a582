"""Steps by a table over the distance are those by poles, and the table is as good as it says."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.model.decay import decayed
from femfit.model.dynamics import exponential_step, runge_kutta_step
from femfit.model.responses import ResponseTable
from femfit.simulation.plant import with_force_scale
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.model_kinds import exponential_jacobian, voltage_of
from support.readings import hall_voltage
from support.solenoids import solenoid

PATTERNS = [(10e-3, 3e-3, 0.5e-3), (1e-6, 2e-5, 0.1)]


def states_of(model, low_m, high_m, points=300):
    """Random states in a random order, and voltages."""
    random, n = np.random.default_rng(3), len(model.circuits)
    result = random.normal(0.0, 0.3, (points, model.order))
    result[:, 0], result[:, 1] = random.uniform(low_m, high_m, points), random.normal(0.0, 0.1, points)
    return result, voltage_of(model, random.uniform(-3.0, 3.0, (points, n)))


@pytest.mark.parametrize("circuits", [1, 2])
@pytest.mark.parametrize("times", PATTERNS)
@pytest.mark.parametrize("points", [1, 30, 2000])
def test_a_step_by_the_table_is_that_by_poles(levitation_model, circuits, times, points):
    """Beyond the knots as well, from 15 to 45 mm, where splines are continued; steps of their own go by poles."""
    model = with_eddies(levitation_model if circuits == 1 else cut_in_two(levitation_model), times)
    assert model.equations.linear
    states, volts = states_of(model, 0.010, 0.050, points)
    step = model.sample_time_s
    found = exponential_step(model, states, volts, step)
    wanted = exponential_step(model, states, volts, np.full((points, 1), step))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * np.abs(wanted).max())
    few = slice(0, 20)
    slopes = exponential_jacobian(model, states[few], volts[few], step)
    h = 1e-6 * np.abs(states[few]).max(axis=0)
    for k in range(model.order):
        ahead, back = (
            exponential_step(model, states[few] + sign * h[k] * np.eye(model.order)[k], volts[few], step)
            for sign in (1.0, -1.0)
        )
        quotient = (ahead - back) / (2.0 * h[k])
        np.testing.assert_allclose(slopes[..., k], quotient, rtol=0.0, atol=1e-6 * np.abs(quotient).max() + 1e-9)


def test_saturating_iron_has_no_table():
    linear = solenoid()
    spline = linear.magnetics.spline
    i_knots = np.r_[[-2.0] * 4, [2.0] * 4]
    curved = replace(
        spline, y_knots=i_knots, y_degree=3, coefficients=np.repeat(spline.coefficients, [1, 2, 1], axis=1)
    )
    for magnetics, has_one in ((linear.magnetics, True), (replace(linear.magnetics, spline=curved), False)):
        model = with_eddies(replace(linear, magnetics=magnetics), (8e-3, 2e-3))
        assert model.equations.linear == has_one


def test_runs_of_a_plant_have_forces_of_their_own(levitation_model):
    model = with_eddies(levitation_model)
    states, volts = states_of(model, 0.02, 0.03, 3)
    scaled = with_force_scale(model, np.array([1.0, 1.0, 1.01]))
    assert not scaled.equations.linear
    for move in (exponential_step, runge_kutta_step):
        found, plain = (move(one, states, volts, 1e-4) for one in (scaled, model))
        np.testing.assert_allclose(found[:2], plain[:2], rtol=1e-8)
        assert abs(found[2, 1] - plain[2, 1]) > 1e-7
    np.testing.assert_array_equal(hall_voltage(scaled, states), hall_voltage(model, states))


def test_a_table_is_as_good_as_asked_and_holds_its_ends_where_no_winding_is():
    """The second winding's inductance falls to nothing at 3.2, beyond the domain."""
    resistances, step = np.array([1.0, 2.0]), 0.3

    def inductance(d):
        second = np.where(d < 3.2, 3.2 - d, np.nan)
        return np.stack([np.exp(-d) + 1.0, 0.1 / d, 0.1 / d, second], axis=-1).reshape(-1, 2, 2)

    table = ResponseTable(inductance, resistances, step, (1.0, 3.0))
    with building():
        d = SX.sym("d")
        function = GraphFunction([d], ca.vertcat(*(ca.vec(part) for part in table.at(d))))
    with building():
        matrix = SX.sym("L", 4)
        parts = decayed(ca.reshape(matrix, 2, 2), SX(resistances), SX.eye(2), SX(step))
        by_poles = GraphFunction([matrix], ca.vertcat(*(ca.vec(part) for part in parts)))
    at = np.sort(np.random.default_rng(0).uniform(1.0, 3.0, 2000))
    wanted = by_poles(inductance(at).reshape(-1, 4).T)
    size = np.abs(wanted).max(axis=1, keepdims=True)
    assert (np.abs(function(at[None]) - wanted) / size).max() < 1e-8  # of the poles; the table's own is 1e-11
    far = function(np.array([[3.5, 9.0]]))
    assert np.isfinite(far).all()
    np.testing.assert_array_equal(far[:, 0], far[:, 1])
