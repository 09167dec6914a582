"""How far currents get within a step, against the exponential of a matrix; diodes and amplifiers within it."""

import copy
from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest
from casadi import SX
from scipy.integrate import quad
from scipy.linalg import expm

from femfit.core.graph import GraphFunction, building
from femfit.device.electrics import Drive
from femfit.model.decay import ResponseTable, decayed
from femfit.model.equations import Driver, _slowed, driver_voltages
from femfit.simulation.observers import DirectObserver
from femfit.simulation.plant import Plant
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
    for stiffness in PRODUCTS:
        inductance, resistances = positive(m), RANDOM.uniform(0.5, 2.0, m)
        step = stiffness / np.linalg.eigvals(np.linalg.solve(inductance, np.diag(resistances))).real.max()
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


def every_case(gain, wanted, low, high):
    """The voltages within limits of which each ends its current, or is at the limit that is too near."""
    for places in product((-1, 0, 1), repeat=len(wanted)):
        volts = np.select([np.equal(places, -1), np.equal(places, 1)], [low, high])
        free = np.equal(places, 0)
        if not np.isfinite(volts).all():
            continue
        if free.any():
            volts[free] = np.linalg.solve(gain[np.ix_(free, free)], (wanted - gain @ (~free * volts))[free])
        lacking = wanted - gain @ volts
        within = (volts >= low - 1e-12) & (volts <= high + 1e-12)
        if (within & (free | (lacking * places >= -1e-12))).all():
            return volts
    raise AssertionError


@pytest.mark.parametrize("count", [1, 2, 3])
def test_coupled_drivers_end_their_currents_or_are_at_the_limit_in_the_way(count):
    random = np.random.default_rng(4)
    for trial in range(60):
        signs = np.diag(random.choice([-1.0, 1.0], count))
        gain = signs @ (0.3 + 0.7 * np.eye(count)) @ signs
        gain = np.linalg.inv(gain) if trial % 2 else gain
        wanted, low, high = random.normal(size=count), -random.uniform(0.1, 1.0, count), random.uniform(0.1, 1.0, count)
        high = np.full(count, np.inf) if trial % 4 > 1 else high  # diodes
        drivers = [Driver(k, SX(wanted[k]), (low[k].item(), high[k].item())) for k in range(count)]
        found = ca.evalf(driver_voltages(drivers, SX.zeros(count), SX(ca.DM(gain))))
        np.testing.assert_allclose(found.full()[:, 0], every_case(gain, wanted, low, high), atol=1e-10)


def test_a_winding_that_another_drives_backwards_is_open_whatever_little_feeds_it(levitation_model):
    """A diode carries no current backwards: at a command of nought and at a nanovolt alike."""
    halves = cut_in_two(levitation_model)
    one_sided = tuple(replace(one, drive=Drive(diode_V=0.7), voltage_min_V=0.0) for one in halves.circuits)
    start = np.array([[0.024, 0.0, 0.0, 0.0]] * 2)
    found = Plant(replace(halves, circuits=one_sided)).step(start, np.array([[1.2, 0.0], [1.2, 1e-9]]))
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)
    np.testing.assert_allclose(found[:, 3], 0.0, atol=1e-15)
    alone = replace(halves, circuits=(one_sided[0], replace(one_sided[1], resistance_ohm=1e9)))
    np.testing.assert_allclose(found[0, 2], Plant(alone).step(start, np.array([[1.2, 0.0]] * 2))[0, 2], rtol=1e-4)


def test_a_plant_is_kept_and_sent_after_use_and_has_any_number_of_runs(levitation_model):
    plant, state = Plant(levitation_model), np.array([[0.022, 0.0, 0.4]])
    moved = plant.step(state, np.array([1.0]))
    np.testing.assert_array_equal(copy.deepcopy(plant).step(state, np.array([1.0])), moved)
    assert plant.step(state[:0], np.zeros(0)).shape == (0, 3)
    many = plant.step(np.tile(state, (3, 1)), np.array([[1.0]]))
    np.testing.assert_array_equal(many, np.tile(moved, (3, 1)))


def test_a_reading_that_is_far_off_leaves_the_direct_measurement_s_currents_possible(levitation_model):
    model = levitation_model
    observer, box = DirectObserver(model, "hall"), model.validity
    mean = np.zeros((2, model.order))
    mean[:, 0], mean[:, 1] = box.distance_min_m, [-1.0, 1.0] * np.full(2, 0.03 / model.sample_time_s)
    mean[:, 2:] = 0.5
    found = observer.step(observer.start(mean), np.full((2, len(model.circuits)), 1.0), np.full((2, 1), 2.0)).mean
    assert (np.abs(found[:, 2:] - 0.5) < 0.2).all()
