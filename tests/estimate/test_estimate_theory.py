"""Noise, the bound on its reduction, and the direct distance."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import central_differences
from femfit.estimate.holding import holding_current
from femfit.estimate.kalman_filter import ExtendedFilter
from femfit.estimate.noise import default_noise, process_covariance, unstable_pole
from femfit.estimate.process import FilterProcess, Output, cholesky
from femfit.model.bspline import TensorSpline
from femfit.model.sensors import reading_of
from femfit.simulation.observers import hall_inverse
from support.one_current import flat

RANDOM = np.random.default_rng(8)


@pytest.mark.parametrize("rho", [1e-4, 30.0, *(pytest.param(one, marks=pytest.mark.nightly) for one in (0.3, 3.0))])
def test_the_steady_filter_of_an_unstable_body_reaches_the_formula(rho):
    pole, step, noise = 33.0, 5e-5, 1e-4
    density = rho * noise**2 * step * pole**4
    c, s = np.cosh(pole * step), np.sinh(pole * step)
    advance = np.array([[c, s / pole], [pole * s, c]])
    process = FilterProcess(
        names=("d", "v"),
        step_s=step,
        transition=lambda x, _u: x @ advance.T,
        outputs=(Output("d", "m", lambda x: x[:, 0], noise**2, jacobian=lambda x: np.tile([1.0, 0.0], (len(x), 1))),),
        process_covariance=density * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]]),
        transition_jacobian=lambda x, _u: np.broadcast_to(advance, (len(x), 2, 2)),
    )
    filter_ = ExtendedFilter(process)
    state = filter_.start(np.zeros(2), np.diag([1e-8, 1e-4]))
    for _ in range(6_000):  # ten time constants of the slowest pole, 1 / lambda
        state = filter_.step(state, 0.0, 0.0)
    ratio = noise / np.sqrt(state.covariance[0, 0, 0])
    bound = 1.0 / np.sqrt(2.0 * pole * step)
    # White acceleration noise of density q = rho r lambda^4 moves the poles to (s^2 - lambda^2)^2 = -rho lambda^4.
    # The formula is that of continuous time: relative error lambda t_s = 0.17 % times a few.
    assert ratio == pytest.approx(bound * (0.5 * (1.0 + np.sqrt(1.0 + rho))) ** -0.25, rel=1e-2)
    assert ratio <= 1.005 * bound


def test_the_body_is_held_where_force_equals_weight_and_nowhere_else(levitation_model):
    current = holding_current(levitation_model, 0.025)
    force = float(flat(levitation_model.magnetics).force(np.asarray(0.025), np.asarray(current)))
    assert force == pytest.approx(4.35e-3 * 9.80665, rel=1e-13)
    gradient = float(flat(levitation_model.magnetics).force_gradient(np.asarray(0.025), np.asarray(current)))
    assert unstable_pole(levitation_model, 0.025) == pytest.approx(np.sqrt(-gradient / 4.35e-3), rel=1e-12)
    with pytest.raises(DomainError, match="44 mm"):
        holding_current(levitation_model, 0.044)
    with pytest.raises(DomainError, match="60 mm"):
        holding_current(levitation_model, 0.060)


def test_the_noise_of_a_reading_adds_the_converters_rounding(levitation_model):
    sensor = levitation_model.sensor
    step = 5.0 / 4096
    exact = RANDOM.uniform(1.0, 4.0, 400_000)
    error = step * np.round((exact + sensor.noise_V * RANDOM.normal(size=exact.size)) / step) - exact
    # Standard error of a standard deviation from 4e5 samples is 0.11 %.
    assert reading_of(levitation_model, "hall").white == pytest.approx(error.std(), rel=5e-3)
    assert default_noise(levitation_model).hall_V == reading_of(levitation_model, "hall").white
    bare = replace(levitation_model, sensor=replace(sensor, adc_bits=0))
    assert reading_of(bare, "hall").white == sensor.noise_V


def test_q_is_the_covariance_of_integrated_white_acceleration(levitation_model):
    noise = default_noise(levitation_model)
    Q = process_covariance(levitation_model, noise, 0.022, (noise.bias_density,))
    parts, runs = 50, 20_000
    h = levitation_model.sample_time_s / parts
    velocity, distance = np.zeros(runs), np.zeros(runs)
    for _ in range(parts):
        kick = np.sqrt(noise.acceleration_density * h) * RANDOM.normal(size=runs)
        distance, velocity = distance + h * (velocity + 0.5 * kick), velocity + kick
    # Sampling error of a variance 1 / sqrt(1e4) = 1 %, discretisation 1 / parts.
    np.testing.assert_allclose(np.cov(distance, velocity), Q[:2, :2], rtol=0.05)
    assert Q[3, 3] == pytest.approx(noise.bias_density**2 * 0.5e-3)
    assert np.linalg.eigvalsh(Q[:2, :2] / np.sqrt(np.outer(np.diag(Q)[:2], np.diag(Q)[:2]))).min() > 0.1


def test_the_direct_distance_inverts_the_hall_voltage_whichever_way_the_element_sees_the_magnet(levitation_model):
    d, i = RANDOM.uniform(0.015, 0.045, 500), RANDOM.uniform(0.0, 1.4, 500)
    found, clipped = hall_inverse(levitation_model).distance(levitation_model.sensor.voltage(d, i), i[:, None])
    # Rounding of 2.5 V is 4e-16 V, at the far edge's 1.5 V/m 3e-16 m; Newton's last step leaves a few of it.
    np.testing.assert_allclose(found, d, atol=1e-13)
    assert not clipped.any()
    turned = replace(levitation_model, sensor=replace(levitation_model.sensor, sensitivity_V_per_T=-50.0))
    d = np.linspace(0.016, 0.044, 20)
    volts = turned.sensor.voltage(d, np.asarray(0.3))
    found, clipped = hall_inverse(turned).distance(volts, np.array([0.3]))
    np.testing.assert_allclose(found, d, atol=1e-13)
    assert not clipped.any()
    low, _ = hall_inverse(turned).distance(np.array([0.0]), np.array([0.3]))
    assert low[0] == 0.015


def test_the_direct_distance_is_clipped_to_the_box_and_flagged_and_disturbs_no_other(levitation_model):
    sensor = levitation_model.sensor
    edge = sensor.voltage(np.array([0.015, 0.045]), np.asarray(0.5))
    volts = np.array([edge[0] + 0.01, edge[1] - 0.01, np.nan, np.inf, edge.mean()])
    found, clipped = hall_inverse(levitation_model).distance(volts, np.array([0.5]))
    np.testing.assert_array_equal(clipped, [True, True, True, True, False])
    np.testing.assert_array_equal(found[:2], [0.015, 0.045])
    assert np.isnan(found[2:4]).all()
    assert 0.015 < found[4] < 0.045
    # A diverging observer's current moves the range of voltages: such a reading is clipped, its neighbours are solved.
    inverse = hall_inverse(levitation_model)
    volts = levitation_model.require_sensor().voltage(np.array(0.022), np.array(0.5))
    distance, clipped = inverse.distance(np.array([volts, 4.9, volts]), np.array([[0.5], [1e4], [np.nan]]))
    assert distance[0] == pytest.approx(0.022, abs=1e-12)
    assert clipped.tolist() == [False, True, True]
    assert distance[1] in (levitation_model.validity.distance_min_m, levitation_model.validity.distance_max_m)
    assert np.isnan(distance[2])


def test_a_hall_voltage_that_turns_cannot_be_inverted(levitation_model):
    spline = levitation_model.sensor.field.spline
    bent = spline.coefficients.copy()
    bent[3] += 0.05
    field = replace(
        levitation_model.sensor.field,
        spline=TensorSpline(spline.x_knots, spline.y_knots, spline.x_degree, spline.y_degree, bent),
    )
    with pytest.raises(FilterError, match=r"turns at"):
        hall_inverse(replace(levitation_model, sensor=replace(levitation_model.sensor, field=field)))


def test_batched_cholesky_equals_numpys_and_names_each_failure():
    roots = RANDOM.normal(size=(50, 4, 4))
    matrices = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(4)
    matrices[7] = -np.eye(4)
    matrices[9, 3, 3] = np.nan
    factor, definite = cholesky(matrices)
    good = np.delete(np.arange(50), [7, 9])
    np.testing.assert_array_equal(np.flatnonzero(~definite), [7, 9])
    np.testing.assert_allclose(factor[good], np.linalg.cholesky(matrices[good]), atol=1e-13)
    assert np.isnan(factor[[7, 9]]).all()


@pytest.mark.parametrize("size", [0.0, 1e-13, 1e-9, 1e-3])
def test_central_differences_do_not_lose_their_digits_near_zero(size):
    found = central_differences(lambda x: 9.80665 - 5.0 * x, np.array([[size]]), np.array([0.02]))
    np.testing.assert_allclose(found, [[[-5.0]]], rtol=1e-7)
