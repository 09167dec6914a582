"""Steps from tables are those of the eigenvalues, wherever a body is, and create no energy."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.model.coordinate import DistanceCoordinate
from femfit.model.distance_table import ERROR, distance_table
from femfit.model.dynamics import hall_voltage
from femfit.model.eddy_currents import EddyHall
from femfit.model.exponential_step import exponential_jacobian, exponential_step
from femfit.model.hall import SensedField
from femfit.model.tabulated_step import step_table
from femfit.simulation.plant import with_force_scale
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.one_current import flat
from support.solenoids import solenoid

PATTERNS = [(10e-3, 3e-3, 0.5e-3), (1e-6, 2e-5, 0.1)]


def by_eigenvalues(model):
    """The same model, whose steps find no table."""
    result = replace(model)
    result.windings.step_tables.update(dict.fromkeys([model.sample_time_s], None))
    return result


def states_of(model, low_m, high_m, points=300):
    """Random states in a random order, and voltages."""
    random, n = np.random.default_rng(3), len(model.circuits)
    result = random.normal(0.0, 0.3, (points, model.order))
    result[:, 0], result[:, 1] = random.uniform(low_m, high_m, points), random.normal(0.0, 0.1, points)
    volts = random.uniform(-3.0, 3.0, (points, n))
    return result, volts[:, 0] if n == 1 else volts


@pytest.mark.parametrize("circuits", [1, 2])
@pytest.mark.parametrize("times", PATTERNS)
@pytest.mark.parametrize("points", [1, 30, 3000])
def test_a_step_from_the_table_is_that_of_the_eigenvalues(levitation_model, circuits, times, points):
    """Beyond the knots as well, where splines are continued, and beyond the table, which ends at 7.5 and 52.5 mm."""
    model = with_eddies(levitation_model if circuits == 1 else cut_in_two(levitation_model), times)
    states, volts = states_of(model, 0.005, 0.06, points)
    step = model.sample_time_s
    table = step_table(model.windings, step)
    assert table is not None
    known = table.table.cell(states[:, 0]) >= 0
    assert known.mean() > 0.7
    assert points == 1 or not known.all()
    found = exponential_step(model, states, volts, step)
    wanted = exponential_step(by_eigenvalues(model), states, volts, step)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=10.0 * ERROR * np.abs(wanted).max())
    slopes = exponential_jacobian(model, states, volts, step)
    exact = exponential_jacobian(by_eigenvalues(model), states, volts, step)
    size = np.abs(exact).max(axis=0) + 1e-12
    # A polynomial's slope is off by its error over a part of a cell
    assert (np.abs(slopes - exact) / size).max() < 1e-5


def test_saturating_iron_has_no_table():
    linear = solenoid()
    spline = linear.magnetics.spline
    i_knots = np.r_[[-2.0] * 4, [2.0] * 4]
    curved = replace(
        spline, y_knots=i_knots, y_degree=3, coefficients=np.repeat(spline.coefficients, [1, 2, 1], axis=1)
    )
    for magnetics, has_one in ((linear.magnetics, True), (replace(linear.magnetics, spline=curved), False)):
        model = with_eddies(replace(linear, magnetics=magnetics), (8e-3, 2e-3))
        assert (step_table(model.windings, model.sample_time_s) is not None) == has_one


@pytest.mark.parametrize("circuits", [1, 2])
def test_the_field_from_its_table_is_that_of_the_splines(levitation_model, circuits):
    """Of two circuits the mean current makes the field of the one."""
    model = with_eddies(levitation_model if circuits == 1 else cut_in_two(levitation_model))
    field = levitation_model.sensor.field
    if circuits == 2:
        spline, ends = field.spline, (field.spline.y_knots,) * 2
        means = 0.5 * (spline.coefficients[:, :, None] + spline.coefficients[:, None])
        field = SensedField(field.coordinate, spline.x_knots, spline.x_degree, ends, (1, 1), means)
    states, _ = states_of(model, 0.005, 0.06)
    hall, w = EddyHall(model.eddy, field), states[:, 2:]
    u = hall.acting(states[:, 0], w).reshape(len(states), -1).mean(axis=1)
    own = model.eddy.forms(states[:, 0])[0].hall if circuits == 1 else np.zeros(3)
    wanted = flat(levitation_model.sensor.field).field(states[:, 0], u) + (own * w[:, circuits:]).sum(axis=1)
    for points in (slice(None), slice(0, 20)):
        found = hall.field(states[points, 0], w[points])
        np.testing.assert_allclose(found, wanted[points], rtol=0.0, atol=10.0 * ERROR * np.abs(wanted).max())
    if circuits == 1:
        seen = model.sensor.quiescent_V + model.sensor.sensitivity_V_per_T * wanted
        np.testing.assert_allclose(hall_voltage(model, states), seen, atol=1e-7)


def test_a_plant_whose_runs_have_forces_of_their_own_steps_by_eigenvalues(levitation_model):
    model = with_eddies(levitation_model)
    states, volts = states_of(model, 0.02, 0.03, 3)
    scaled = with_force_scale(model, np.array([1.0, 1.0, 1.01]))
    assert step_table(scaled.windings, 1e-3) is None
    found, plain = (exponential_step(one, states, volts, 1e-3) for one in (scaled, model))
    np.testing.assert_allclose(found[:2], plain[:2], rtol=1e-8)
    assert abs(found[2, 1] - plain[2, 1]) > 1e-6
    np.testing.assert_array_equal(hall_voltage(scaled, states), hall_voltage(model, states))


def test_a_table_is_as_good_as_asked_and_leaves_out_what_is_not_smooth():
    plain = DistanceCoordinate(1.0, inverse=False)
    knots = np.array([1.0, 2.0, 3.0])

    def values(d):
        return np.stack([np.exp(-d) / d, np.where(d > 2.8, np.nan, d)], axis=1)

    table = distance_table(values, [(plain, knots)], [np.ones(1), np.ones(1)])
    d = np.sort(np.random.default_rng(0).uniform(1.0, 3.0, 2000))
    cell = table.cell(d)
    known = cell >= 0
    assert known[d < 2.79].all()
    assert not known[d > 2.8].any()
    wanted = values(d[known])
    found = table.values(d[known], cell[known])
    np.testing.assert_allclose(found.T, wanted, rtol=10.0 * ERROR)
    np.testing.assert_array_equal(table.cell(np.array([0.0, np.nan, 9.0])), -1)
