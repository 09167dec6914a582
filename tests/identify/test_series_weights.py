"""Short-window weights, local polynomials and states along a motion against what calculus gives."""

import numpy as np
import pytest
from scipy import sparse

from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.estimate.record import converter_step, white_noise
from femfit.identify.series.balances import states_along
from femfit.identify.series.noise import SensorNoise, propagated
from femfit.identify.series.views import local_polynomials
from femfit.identify.series.weights import Windows, held_weights, window_weights
from femfit.model.with_effects import nominal_of

EVEN = np.linspace(0.0, 1.0, 201)
UNEVEN = np.sort(np.random.default_rng(0).random(201))
UNEVEN[[0, -1]] = 0.0, 1.0
ONE = Windows(np.array([0.3, 0.7]), np.array([0, 0]), 0.4)


def everywhere(time):
    return np.zeros(len(time), dtype=int), np.ones(len(time), dtype=bool)


@pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_means_and_mean_derivatives_of_a_quintic_are_exact_whatever_the_sampling(time):
    weights = window_weights(ONE, time, *everywhere(time))
    polynomial = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0, -4.0, 7.0])
    fine = np.linspace(-1.0, 1.0, 20001)
    bump = (1.0 - fine**2) ** 2
    for order, rows in enumerate((weights.mean, weights.slope, weights.curvature)):
        derivative = polynomial.deriv(order) if order else polynomial
        expected = [np.sum(bump * derivative(c + 0.2 * fine)) / np.sum(bump) for c in ONE.centre_s]
        np.testing.assert_allclose(rows @ polynomial(time), expected, rtol=1e-7)  # the fine sum's own error


def test_windows_with_a_gap_or_too_few_samples_are_not_valid():
    gap = (EVEN < 0.25) | (EVEN > 0.35)
    weights = window_weights(ONE, EVEN, np.zeros(201, dtype=int), gap)
    assert weights.valid.tolist() == [False, True]
    assert abs(weights.mean[[0]]).sum() == 0.0
    assert not window_weights(ONE, EVEN, np.zeros(201, dtype=int), np.arange(201) % 20 == 0).valid.any()


def test_a_change_driven_by_a_held_input_is_balanced_to_rounding():
    u = np.random.default_rng(1).standard_normal(len(UNEVEN))
    x = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(UNEVEN))])
    known, held = np.ones(len(u), dtype=bool), np.random.default_rng(2).random(len(u)) > 0.1
    driven, _, slope, valid = held_weights(ONE, UNEVEN, np.zeros(len(u), dtype=int), known, held)
    assert valid.all()
    np.testing.assert_allclose(slope @ x, driven @ u, atol=1e-12)
    np.testing.assert_allclose(driven.sum(axis=1), 1.0)


def test_local_polynomials_are_exact_up_to_their_degree_and_may_look_back_alone():
    nodes = np.array([0.0, 0.41, 0.8])
    cubic = np.polynomial.Polynomial([1.0, 2.0, -3.0, 4.0])
    segment, known = everywhere(UNEVEN)
    options = {"centre_s": nodes, "behind_s": 0.1, "ahead_s": 0.1, "degree": 3}
    level, slope = local_polynomials(nodes, segment[:3], UNEVEN, segment, known, **options)
    np.testing.assert_allclose(level @ cubic(UNEVEN), cubic(nodes), rtol=1e-8)
    np.testing.assert_allclose(slope @ cubic(UNEVEN), cubic.deriv()(nodes), rtol=1e-6)
    options = {"centre_s": nodes[1:] - 0.05, "behind_s": 0.2, "ahead_s": 0.0, "degree": 3}
    level, slope = local_polynomials(nodes[1:], segment[:2], UNEVEN, segment, known, **options)
    np.testing.assert_allclose(slope @ cubic(UNEVEN), cubic.deriv()(nodes[1:]), rtol=1e-6)
    assert UNEVEN[level[[0]].indices].max() <= 0.36


def test_white_noise_is_read_from_neighbours_under_a_smooth_motion():
    generator = np.random.default_rng(3)
    values = np.sin(20.0 * EVEN.repeat(20)) * 0.0 + np.sin(np.linspace(0.0, 20.0, 4020))
    noisy = values + 1e-3 * generator.standard_normal(4020)
    assert white_noise(noisy, np.zeros(4020, dtype=int)) == pytest.approx(1e-3, rel=0.06)  # 4020 differences
    assert np.isnan(white_noise(noisy[:50], np.zeros(50, dtype=int)))


def test_a_converter_is_known_by_its_step():
    values = np.round(np.random.default_rng(4).standard_normal(2000) / 0.05) * 0.05
    assert converter_step(values) == pytest.approx(0.05)
    assert converter_step(np.random.default_rng(4).standard_normal(2000)) == 0.0


def test_the_error_of_a_coarse_converter_does_not_average_until_noise_dithers_it():
    mean = sparse.csr_array(np.full((1, 400), 1.0 / 400.0))
    generator, errors = np.random.default_rng(5), {}
    for sigma in (0.0, 1.0):
        draws = []
        for level in generator.random(300):
            values = np.round(level + sigma * generator.standard_normal(400))
            draws.append(float((mean @ values)[0]) - level)
        white = np.hypot(sigma, 1.0 / np.sqrt(12.0))
        said = propagated(mean, (mean, SensorNoise(white, 1.0, values)))
        errors[sigma] = np.std(draws), float(said[0])
    for seen, said in errors.values():
        assert said == pytest.approx(seen, rel=0.15)  # 300 draws


def test_states_along_a_motion_follow_their_equation(levitation_model):
    effect = effect_by_name("eddy_current_lag")
    added = AddedEffect(effect, effect.null() | {"ring_share": 0.2, "time_s": 0.02})
    nominal = nominal_of(levitation_model)
    time = np.linspace(0.0, 0.5, 2001)
    current = 0.7 + 0.2 * np.sin(25.0 * time)
    first = np.zeros(2001, dtype=bool)
    first[[0, 1200]] = True
    still = np.zeros(2001)
    states = states_along(added, time, still + 0.02, current, still, Conditions(nominal), first)
    seen = states["eddy_ring"] * nominal.peak_current_A
    # x' = i' - x / tau from rest, integrated by hand
    ramp = np.diff(current) * np.exp(-0.5 * 0.25e-3 / 0.02)
    expected = np.zeros(2001)
    for k in range(1, 2001):
        expected[k] = 0.0 if first[k] else expected[k - 1] * np.exp(-0.25e-3 / 0.02) + ramp[k - 1]
    np.testing.assert_allclose(seen, expected, atol=1e-5 * np.abs(expected).max())  # steps of 1/80 of tau


def test_every_effect_with_states_has_rates_affine_in_each_state_alone(levitation_model):
    from femfit.effects.catalogue import BUILT_IN

    nominal = nominal_of(levitation_model)
    v, i, rate = (np.array([x]) for x in (0.05, 0.7, 3.0))
    at = Conditions(nominal, velocity_m_s=v, current_rate_A_s=rate, motional_V=np.array([0.01]))
    for effect in BUILT_IN:
        if effect.memory is None:
            continue
        memory, p = effect.memory, effect.null() | dict.fromkeys(effect.memory.amplitudes, 0.1)

        def rates(levels, memory=memory, p=p):
            states = {name: np.array([z]) for name, z in zip(memory.names, levels, strict=True)}
            rate = memory.rate(states, i, at, p)
            return np.array([float(rate[name][0]) for name in memory.names])

        count = len(memory.names)
        zero = rates(np.zeros(count))
        slopes = np.stack([rates(row) - zero for row in np.eye(count)])
        np.testing.assert_allclose(slopes, np.diag(np.diag(slopes)), atol=1e-12)
        np.testing.assert_allclose(rates(np.full(count, 0.5)) - zero, 0.5 * np.diag(slopes), rtol=1e-9, atol=1e-12)
        assert np.all(np.diag(slopes) <= 0.0)
