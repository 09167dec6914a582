"""How far currents get within a step, against the exponential of a matrix; a table of it, against its poles."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from casadi import SX
from scipy.integrate import quad
from scipy.linalg import expm

from femfit.core.graph import GraphFunction, building
from femfit.model.decay import ResponseTable, decayed
from femfit.model.equations import _slowed
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.model_kinds import states_of, voltage_of
from support.solenoids import solenoid
from support.steps import exponential_step

RANDOM = np.random.default_rng(6)
PRODUCTS = np.geomspace(1e-6, 1e4, 21)
"""Step times R/L."""


def positive(m):
    parts = RANDOM.normal(size=(m, m))
    return parts @ parts.T + 0.1 * np.eye(m)


def shares(inductance, resistances, step):
    """f1(M) L^-1, f2(M) L^-1 and f3(M) L^-1 of the module, from the exponential of a block matrix."""
    m = len(resistances)
    block = np.zeros((4 * m, 4 * m))
    block[:m, :m] = -step * np.linalg.solve(inductance, np.diag(resistances))
    for first in range(0, 3 * m, m):
        block[first : first + m, first + m : first + 2 * m] = np.eye(m)
    whole = expm(block)[:m, m:]
    return [part @ np.linalg.inv(inductance) for part in np.split(whole, 3, axis=1)]


def function_of(m):
    """(L, R, b, h) -> the three parts, one column below the other."""
    with building():
        inputs = [SX.sym(name, size) for name, size in (("L", m * m), ("R", m), ("b", m * m), ("h", 1))]
        matrix, resistances, driving, step = inputs
        parts = decayed(ca.reshape(matrix, m, m), ca.diag(resistances), ca.reshape(driving, m, m), step)
        return GraphFunction(inputs, ca.vertcat(*(ca.vec(part) for part in parts)))


@pytest.mark.parametrize("m", [1, 2, 3, 5])
def test_the_parts_of_a_decay_are_those_of_the_exponential_at_any_stiffness(m):
    function, eye = function_of(m), np.eye(m).ravel()
    for product in PRODUCTS:
        inductance, resistances = positive(m), RANDOM.uniform(0.5, 2.0, m)
        step = product / np.linalg.eigvals(np.linalg.solve(inductance, np.diag(resistances))).real.max()
        found = function(inductance.ravel(), resistances, eye, np.array([step])).ravel()
        # f1 is off by 1.6e-10, f2 by 2.6e-9 and f3 by 1.8e-8 where they are largest, 1, 1/2 and 1/6
        errors = 2e-10, 5.5e-9, 1.1e-7
        each = zip(np.split(found, 3), shares(inductance, resistances, step), errors, strict=True)
        for part, wanted, error in each:
            assert np.abs(part.reshape(m, m).T - wanted).max() < error * np.abs(wanted).max()


def test_one_winding_decays_or_grows_exactly():
    """By the series of each function, at z of both signs: iron that saturates lets a current grow."""
    z = np.array([-5.0, -1.0, -0.5, -1e-9, 0.0, 1e-9, 1e-3, 0.999, 1.001, 30.0, 1e6])
    ones = np.ones((1, len(z)))
    found = function_of(1)(ones, z[None], ones, ones)
    steep = (1e-6, 1e-6 - 1e-12, 0.5e-6 - 1e-12)  # the last, where no quadrature follows the integrand
    for power, values in enumerate(found):
        grown = [quad(lambda s, x=x, k=power: np.exp(-x * (1.0 - s)) * s**k, 0.0, 1.0)[0] for x in z[:-1]]
        wanted = np.array(grown) / max(power, 1)
        np.testing.assert_allclose(values, [*wanted, steep[power]], rtol=1e-10)


@pytest.mark.parametrize("circuits", [1, 2])
def test_no_current_grows_more_than_e_fold_where_an_inductance_falls(circuits):
    """An inductance that is extended far beyond its domain may fall to nothing within a step."""
    inductance = positive(circuits)
    change = -50.0 * inductance
    room = np.diag(inductance) / 0.1 + 1.0
    slowed = np.array(ca.DM(_slowed(SX(change), SX(room))))
    assert (np.diag(slowed) >= -room * (1.0 + 1e-12)).all()
    np.testing.assert_array_equal(np.array(ca.DM(_slowed(SX(0.1 * change), SX(room)))), 0.1 * change)


PATTERNS = [(10e-3, 3e-3, 0.5e-3), (1e-6, 2e-5, 0.1)]


@pytest.fixture(scope="module", params=[*zip((1, 2), PATTERNS, strict=True)])
def decaying(request, levitation_model):
    circuits, times = request.param
    return with_eddies(levitation_model if circuits == 1 else cut_in_two(levitation_model), times)


@pytest.mark.parametrize("points", [1, 30, 2000])
def test_a_step_by_the_table_is_that_by_poles(decaying, points):
    """Beyond the knots as well, from 15 to 45 mm, where splines are continued; steps of their own go by poles."""
    model = decaying
    assert model.equations._losses is not None
    states, volts = states_of(model, points)
    states[:, 0], volts = RANDOM.uniform(0.010, 0.050, points), voltage_of(model, volts)
    step = model.sample_time_s
    found = exponential_step(model, states, volts, step)
    wanted = exponential_step(model, states, volts, np.full((points, 1), step))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * np.abs(wanted).max())


def test_saturating_iron_has_no_table():
    linear = solenoid()
    spline = linear.magnetics.spline
    i_knots = np.r_[[-2.0] * 4, [2.0] * 4]
    curved = replace(
        spline, y_knots=i_knots, y_degree=3, coefficients=np.repeat(spline.coefficients, [1, 2, 1], axis=1)
    )
    for magnetics, has_one in ((linear.magnetics, True), (replace(linear.magnetics, spline=curved), False)):
        model = with_eddies(replace(linear, magnetics=magnetics), (8e-3, 2e-3))
        assert (model.equations._losses is not None) == has_one


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
    at = np.sort(np.random.default_rng(0).uniform(1.0, 3.0, 2000))
    wanted = function_of(2)(inductance(at).reshape(-1, 4).T, resistances, np.eye(2).ravel(), np.array([step]))
    size = np.abs(wanted).max(axis=1, keepdims=True)
    errors = (np.abs(function(at[None]) - wanted) / size).max(axis=1).reshape(3, 4).max(axis=1)
    assert (errors < [2e-9, 1e-8, 1e-7]).all()  # of the poles; the table's own is 1e-11
    far = function(np.array([[3.5, 9.0]]))
    assert np.isfinite(far).all()
    np.testing.assert_array_equal(far[:, 0], far[:, 1])
