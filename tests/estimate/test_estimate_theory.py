"""Noise, the bound on its reduction, the direct distance; errors and innovations are as large as the filter says."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from femfit.core.errors import DomainError
from femfit.device.mechanics import Mechanics, Spring
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import ExtendedFilter, UnscentedFilter
from femfit.estimate.noise import FilterNoise, consistency_band, default_noise, process_covariance, unstable_pole
from femfit.estimate.process import Output
from femfit.simulation.observers import distance_inverse
from support.added_effects import under_effects
from support.eddies import with_eddies
from support.parts import with_circuit, with_motion, with_sensor
from support.readings import initial_covariance
from support.solenoids import solenoid
from support.steps import runge_kutta_step

RANDOM = np.random.default_rng(8)


@pytest.mark.parametrize("rho", [1e-4, 30.0])
def test_the_steady_filter_of_an_unstable_body_reaches_the_formula(rho):
    pole, step, noise = 33.0, 5e-5, 1e-4
    density = rho * noise**2 * step * pole**4
    c, s = np.cosh(pole * step), np.sinh(pole * step)
    advance = np.array([[c, s / pole], [pole * s, c]])
    process = SimpleNamespace(
        order=2,
        inputs=1,
        light=False,
        transition=lambda x, _u: x @ advance.T,
        outputs=(Output("d", "m", noise**2),),
        measure=lambda _name, x: x[:, 0],
        gradient=lambda _name, x: np.tile([1.0, 0.0], (len(x), 1)),
        plausible=lambda x: np.ones(len(x), dtype=bool),
        process_covariance=density * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]]),
        with_slopes=lambda x, _u: (x @ advance.T, np.broadcast_to(advance, (len(x), 2, 2))),
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
    current, magnetics = holding_currents(levitation_model, 0.025), levitation_model.magnetics
    assert float(magnetics.force(np.array(0.025), current)) == pytest.approx(4.35e-3 * 9.80665, rel=1e-13)
    gradient = float(magnetics.force_gradient(np.array(0.025), current))
    assert unstable_pole(levitation_model, 0.025) == pytest.approx(np.sqrt(-gradient / 4.35e-3), rel=1e-12)
    for distance, named in ((0.044, "44 mm"), (0.060, "60 mm")):
        with pytest.raises(DomainError, match=named):
            holding_currents(levitation_model, distance)


def test_q_is_the_covariance_of_integrated_white_acceleration_and_of_held_voltages(levitation_model):
    """By C. F. Van Loan's matrix exponential (IEEE Trans. Automat. Contr. 23 (1978) 395); windings as slow as quick."""
    noise, step = default_noise(levitation_model), levitation_model.sample_time_s
    Q = process_covariance(levitation_model, noise, 0.022, (noise.bias_density,))
    density = noise.acceleration_density
    whole = expm(step * np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, density], [0.0] * 4, [0.0, 0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(Q[:2, :2], whole[2:, 2:].T @ whole[:2, 2:], rtol=1e-9)
    assert Q[3, 3] == pytest.approx(noise.bias_density**2 * 0.5e-3)
    quick = with_circuit(levitation_model, resistance_ohm=300.0)
    for model in (levitation_model, quick, with_eddies(quick)):
        windings, middle = model.windings, np.pad([0.7], (0, model.windings.count - 1))
        losses = np.diag(windings.resistances_ohm)
        decay = expm(-step * np.linalg.solve(windings.magnetics.inductance(np.array(0.022), middle), losses))
        moved = np.linalg.solve(losses, (np.eye(len(decay)) - decay).T)[0, 0] * noise.voltage_V
        assert process_covariance(model, noise, 0.022)[2, 2] == pytest.approx(moved**2, rel=1e-9)


@pytest.mark.parametrize("sensitivity", [50.0, -50.0])
def test_the_direct_distance_inverts_a_hall_voltage_of_either_polarity(levitation_model, sensitivity):
    model = with_sensor(levitation_model, sensitivity_V_per_T=sensitivity)
    d, i = RANDOM.uniform(0.015, 0.045, 500), RANDOM.uniform(0.0, 1.4, 500)
    found = distance_inverse(model, "hall")(model.sensor.voltage(d, i), i[:, None])
    # Rounding of 2.5 V is 4e-16 V, at the far edge's 1.5 V/m 3e-16 m; Newton's last step leaves a few of it.
    np.testing.assert_allclose(found, d, atol=1e-13)


def test_the_direct_distance_is_clipped_to_the_box_and_disturbs_no_other(levitation_model):
    """A diverging observer's current moves the range of voltages: such a reading is clipped, its neighbours are not."""
    edge = levitation_model.sensor.voltage(np.array([0.015, 0.045]), np.asarray(0.5))
    volts = np.array([edge[0] + 0.01, edge[1] - 0.01, np.nan, np.inf, edge.mean(), 4.9, edge.mean()])
    currents = np.array([[0.5], [0.5], [0.5], [0.5], [0.5], [1e4], [np.nan]])
    found = distance_inverse(levitation_model, "hall")(volts, currents)
    np.testing.assert_array_equal(found[:2], [0.015, 0.045])
    assert np.isnan(found[[2, 3, 6]]).all()
    assert 0.015 < found[4] < 0.045
    assert found[5] in (0.015, 0.045)


@pytest.mark.parametrize("make", [UnscentedFilter, ExtendedFilter])
@pytest.mark.parametrize("decay", [0.15, 0.25, 0.43, 1.0, 1.9])
def test_errors_and_innovations_lie_in_their_bands_while_a_current_is_switched(levitation_model, make, decay):
    """The rig's coil and faster ones, by R t/L."""
    ohms = decay * float(levitation_model.inductance(0.022, 0.3)) / levitation_model.sample_time_s
    model = with_circuit(levitation_model, resistance_ohm=ohms)
    noise = FilterNoise(acceleration_density=2e-4, voltage_V=0.01, hall_V=0.003)
    sigmas = np.linalg.cholesky(process_covariance(model, noise, 0.022))
    runs, steps, random = 40, 40, np.random.default_rng(4)
    filter_ = make(kalman_filter(model, hall_bias=False, noise=noise).process)
    rest = np.array([0.022, 0.0, holding_currents(model, 0.022)[0]])
    truth = rest + random.normal(size=(runs, 3)) * (1e-4, 1e-3, 1e-3)
    state = filter_.start(np.tile(rest, (runs, 1)), initial_covariance(1e-4, 1e-3, 1e-3))
    nis = np.empty((steps, runs))
    for k in range(steps):
        volts = np.full(runs, ohms * rest[2] + (2.0 if k // 5 % 2 else -2.0))
        truth = runge_kutta_step(model, truth, volts, model.sample_time_s, 4)
        truth = truth + random.normal(size=(runs, 3)) @ sigmas.T
        read = model.sensor.voltage(truth[:, 0], truth[:, 2]) + noise.hall_V * random.normal(size=runs)
        state = filter_.step(state, volts, read)
        nis[k] = state.normalised_innovation_squared
    assert consistency_band(nis.size, 0.99).contains(nis.mean())
    error = state.mean - truth
    squares = error[:, None] @ np.linalg.solve(state.covariance, error[:, :, None])
    low, high = chi2.ppf([0.0005, 0.9995], 3 * runs)
    assert low < squares.sum() < high


def test_a_body_is_held_by_currents_of_the_sign_that_attracts_more():
    sprung = solenoid(Mechanics(0.025, 0.0, springs=(Spring(200.0, 0.1, 4e-3),)))
    forwards, backwards = (under_effects(sprung, ("core_remanence", {"mmf": mmf})) for mmf in (0.3, -0.3))
    assert holding_currents(forwards, 1e-3)[0] == pytest.approx(-holding_currents(backwards, 1e-3)[0], rel=1e-6)
    # Where the sign that adds to what the iron keeps holds alone
    heavy = with_motion(backwards, load_N=15.0)
    held = holding_currents(heavy, 1e-3)[0]
    assert held < backwards.weakest_current_A
    needed = heavy.motion.static_force(np.asarray(1e-3))
    assert heavy.force(1e-3, held) == pytest.approx(float(needed), rel=1e-9)
    assert heavy.force(1e-3, 2.0) < needed


@pytest.mark.parametrize("samples", [60, 200, 4000])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_the_band_is_that_of_chi_square(samples, confidence):
    band = consistency_band(samples, confidence)
    tail = 0.5 - 0.5 * confidence
    expected = chi2.ppf([tail, 1.0 - tail], samples) / samples
    np.testing.assert_allclose([band.lower, band.upper], expected, rtol=1e-12)  # rounding of two libraries
    assert not band.contains(float("nan"))
