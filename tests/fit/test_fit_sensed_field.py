"""Fields of several currents at a sensor: lines without saturation, splines where iron saturates, refusals."""

import numpy as np
import pytest

from femfit.core.errors import FitError
from femfit.fit.rows import rows_of_table
from femfit.fit.sensed_field import fit_hall, fit_sensed
from femfit.fit.words import note
from support.one_current import flat
from support.sweeps import MASS, ClosedForm, full_table

DISTANCES = np.linspace(1e-3, 5e-3, 15)
CLOSED = ClosedForm()


def grid(*axes):
    d, *currents = (one.ravel() for one in np.meshgrid(DISTANCES, *axes, indexing="ij"))
    return d, np.stack(currents, axis=-1)


def lines(d, currents):
    """A magnet's part and one of each current, all of the distance."""
    return 0.1 / (1.0 + 300.0 * d) + (0.02 - 2.0 * d) * currents[:, 0] + 0.01 / (1.0 + 500.0 * d) * currents[:, 1]


def bent(d, currents):
    """Iron that saturates by both currents together."""
    whole = currents[:, 0] + 0.5 * currents[:, 1]
    return 0.3 * np.tanh(whole / (1.0 + 200.0 * d)) + 0.01 * currents[:, 1]


def test_lines_in_two_currents_need_no_grid():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    d, currents = np.repeat(DISTANCES, 4), np.tile(points, (15, 1))
    field = fit_sensed(d, currents, lines(d, currents), "B").field
    between, both = np.array([1.3e-3, 2.7e-3, 4.6e-3]), np.array([[0.5, 0.8], [-0.7, 0.3], [0.2, -0.5]])
    found, in_distance, in_currents = flat(field).derivatives(between, both)
    np.testing.assert_allclose(found, lines(between, both), rtol=1e-4)
    h = 1e-7
    slope = (lines(between + h, both) - lines(between - h, both)) / (2.0 * h)
    np.testing.assert_allclose(in_distance, slope, rtol=2e-3)
    wanted = np.stack([0.02 - 2.0 * between, 0.01 / (1.0 + 500.0 * between)], axis=-1)
    np.testing.assert_allclose(in_currents, wanted, rtol=2e-3)


def test_iron_that_saturates_by_two_currents_is_followed_over_their_grid():
    axes = np.linspace(-1.5, 1.5, 9), np.linspace(-1.0, 1.0, 7)
    d, currents = grid(*axes)
    fit = fit_sensed(d, currents, bent(d, currents), "B")
    between, both = np.array([1.4e-3, 3.1e-3]), np.array([[0.55, 0.2], [-0.95, 0.75]])
    np.testing.assert_allclose(flat(fit.field).field(between, both), bent(between, both), atol=3e-3)  # of 0.6
    assert fit.rms < 1e-4
    rise = flat(fit.field).derivatives(between, both)[2]
    for k, step in enumerate(1e-5 * np.eye(2)):
        change = (bent(between, both + step) - bent(between, both - step)) / 2e-5
        np.testing.assert_allclose(rise[:, k], change, atol=0.03)


def test_a_magnet_alone_is_fitted_along_the_distance():
    values = 0.1 / (1.0 + 300.0 * DISTANCES)
    field = fit_sensed(DISTANCES, np.zeros((15, 0)), values, "search").field
    value, slope, rest = field.derivatives(np.array([2.2e-3]), np.zeros((1, 0)))
    assert value[0] == pytest.approx(0.1 / 1.66, rel=1e-5)
    assert slope[0] == pytest.approx(-30.0 / 1.66**2, rel=2e-3)
    assert rest.shape == (1, 0)


def test_noisy_rows_off_a_grid_are_lines_where_lines_miss_little():
    random = np.random.default_rng(4)
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.3, -0.8]])
    d, currents = np.repeat(DISTANCES, 5), np.tile(points, (15, 1))
    exact = lines(d, currents)
    noise = 1e-4 * np.ptp(exact)
    fit = fit_sensed(d, currents, exact + noise * random.standard_normal(len(d)), "B")
    between, both = np.array([1.4e-3, 3.1e-3]), np.array([[0.5, 0.4], [-0.5, 0.5]])
    np.testing.assert_allclose(flat(fit.field).field(between, both), lines(between, both), atol=4.0 * noise)
    with pytest.raises(FitError, match="do not determine"):
        fit_sensed(d, currents, bent(d, 2.0 * currents), "B")


def test_a_field_that_is_fitted_badly_is_said_with_what_to_do():
    few = np.linspace(1e-3, 5e-3, 6)
    d, i = (one.ravel() for one in np.meshgrid(few, [0.0, 1.0]))
    bad = fit_sensed(d, i[:, None], i * np.sin(3e3 * d), "search")
    d, currents = grid([0.0, 1.0], [0.0, 1.0])
    good = fit_sensed(d, currents, lines(d, currents), "search")
    assert bad.held_out > 0.05
    assert "more distances" in note("sensed", bad, "search", "Wb")
    assert "more distances" not in note("sensed", good, "search", "Wb")


# One circuit: coil part and magnet part apart from each other


def test_coil_and_magnet_part_come_apart_and_hold_between_the_rows():
    rows = rows_of_table(full_table(CLOSED), MASS, 9.80665)
    fit = fit_hall(rows, rows.hall)
    d, i = np.meshgrid(np.linspace(0.0152, 0.0448, 31), np.linspace(0.05, 1.35, 9))
    # The basis is chosen for 2e-5 of the range on held-out rows, rms; ten times that at most.
    np.testing.assert_allclose(flat(fit.field).field(d, i), CLOSED.hall(d, i), atol=2e-4 * np.ptp(rows.hall))
    assert fit.rms_T < 1e-4 * np.ptp(rows.hall)
    assert fit.max_T >= fit.rms_T
    assert fit.coil_slope_T_per_A[0] == pytest.approx(3.9e-3, rel=2e-3)
    assert fit.magnet_field_T == pytest.approx((CLOSED.hall(0.045, 0.0), CLOSED.hall(0.015, 0.0)), abs=2e-6)
    assert fit.field.spline.y_degree == 1


def test_a_parabola_is_taken_where_the_field_is_quadratic_and_noise_buys_no_cells():
    rows = rows_of_table(full_table(CLOSED), MASS, 9.80665)
    fit = fit_hall(rows, rows.hall + 1e-3 * rows.current**2)
    assert fit.field.spline.y_degree == 2
    noisy = rows.hall + 1e-4 * np.random.default_rng(0).standard_normal(len(rows.hall))
    fit = fit_hall(rows, noisy)
    assert fit.field.spline.coefficients.size <= 24
    np.testing.assert_allclose(flat(fit.field).field(rows.distance, rows.current), rows.hall, atol=1e-4)
