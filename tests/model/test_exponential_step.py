"""The filters' step is exact for a current that decays, however fast, and of second order in the motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from femfit.core.numerics import central_differences
from femfit.device.electrics import Drive, PositionSensor
from femfit.device.mechanics import Mechanics
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import FilterNoise
from femfit.model.dynamics import runge_kutta_step
from femfit.model.exponential_step import exponential_jacobian, exponential_step, extrapolated_step
from femfit.model.windings import decay_of, decay_shares
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.solenoids import solenoid

NOISE = FilterNoise(acceleration_density=1e-4, voltage_V=0.01, hall_V=1e-3)


def held(model):
    """So heavy and weightless that it stays where it is."""
    return replace(model, motion=Mechanics(1e9, 0.0))


@pytest.mark.parametrize("decay", [0.01, 0.25, 1.0, 1.5, 1.9, 20.0])
def test_what_is_left_of_a_decay_is_exact(levitation_model, decay):
    """Where the midpoint method left 0.50 for 0.37, 0.63 for 0.22 and 0.91 for 0.15."""
    inductance = float(levitation_model.inductance(0.03, 0.5))  # the same at every current
    step = decay * inductance / levitation_model.circuit.resistance_ohm
    after = exponential_step(held(levitation_model), np.array([[0.03, 0.0, 0.5]]), np.zeros(1), step)
    assert after[0, 2] == pytest.approx(0.5 * np.exp(-decay), rel=1e-9)


@pytest.mark.parametrize("step", [5e-4, 5e-3, 0.05])
def test_coupled_currents_decay_exactly(levitation_model, step):
    """Halves of a coil whose difference meets little but what strays between them; resistances that differ."""
    model = held(cut_in_two(levitation_model))
    one, other = model.circuits
    model = replace(model, circuits=(one, replace(other, resistance_ohm=3.0 * other.resistance_ohm)))
    state, volts = np.array([[0.03, 0.0, 0.5, -0.2]]), np.array([[0.4, -0.7]])
    inductance = model.magnetics.state_of_circuits(state[:, 0], state[:, 2:]).inductance[0]
    rest = volts[0] / model.resistances_ohm
    left = expm(-step * np.linalg.solve(inductance, np.diag(model.resistances_ohm)))
    exact = rest + left @ (state[0, 2:] - rest)
    np.testing.assert_allclose(exponential_step(model, state, volts, step)[0, 2:], exact, rtol=1e-10)


@pytest.mark.parametrize("halves", [False, True])
def test_the_step_converges_with_the_second_order(levitation_model, halves):
    """Over many motions, in some of which the errors of one kind make up for those of another."""
    model, random = cut_in_two(levitation_model) if halves else levitation_model, np.random.default_rng(1)
    start = random.uniform([0.022, -0.05, 0.2, 0.2], [0.03, 0.05, 0.8, 0.8], (30, 4))[:, : 4 if halves else 3]
    volts = random.uniform(0.3, 1.2, (30, 2)) if halves else random.uniform(0.6, 2.4, 30)

    def moved(steps):
        state = start
        for _ in range(steps):
            state = exponential_step(model, state, volts, 0.016 / steps)
        return state

    exact = runge_kutta_step(model, start, volts, 0.016, substeps=256)
    coarse, fine = (np.sqrt(np.mean((moved(steps) - exact) ** 2, axis=0)) for steps in (32, 64))
    # Asymptotic ratio 2^2; a tenth of an order for the pre-asymptotic part
    np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.1)


def test_the_extrapolated_step_converges_with_the_third_order():
    """Where inductance and motional constant change with the distance."""
    model, random = with_eddies(solenoid(), (8e-3, 2e-3)), np.random.default_rng(1)
    start = random.uniform([1e-3, -0.3, 0.1, -0.1, -0.1], [3e-3, 0.1, 0.5, 0.1, 0.1], (30, 5))
    volts = random.uniform(0.0, 12.0, 30)

    def moved(steps):
        state = start
        for _ in range(steps):
            state = extrapolated_step(model, state, volts, 1.6e-3 / steps)
        return state

    exact = runge_kutta_step(model, start, volts, 1.6e-3, substeps=256)
    coarse, fine = (np.sqrt(np.mean((moved(steps) - exact) ** 2, axis=0)) for steps in (32, 64))
    # Asymptotic ratio 2^3; a fifth of an order for the pre-asymptotic part
    np.testing.assert_allclose(np.log2(coarse / fine), 3.0, atol=0.2)


@pytest.mark.parametrize("step", [5e-4, 5e-3])
def test_the_jacobian_of_coupled_circuits_is_a_difference_quotient(levitation_model, step):
    model = cut_in_two(levitation_model)
    states = np.array([[0.024, 0.02, 0.4, 0.3], [0.031, -0.1, 0.2, 0.9]])
    volts = np.array([[0.7, 0.8], [0.2, 0.3]])
    found = exponential_jacobian(model, states, volts, step)
    widths = np.array([1e-5, 1e-3, 1e-3, 1e-3])
    exact = central_differences(
        lambda x: exponential_step(model, x, np.concatenate([volts] * 8), step), states, 10.0 * widths
    )
    scale = np.abs(exact * widths).max(axis=2, keepdims=True)
    assert (np.abs(found - exact) * widths / scale).max() < 1e-6


def test_the_shares_of_a_decay_are_its_integrals():
    """At ends and mean of exp(-z s): 1 - z/2 + .. and 1/2 - z/6 + .. for a slow coil, 1/z of a settled one."""
    first, second = decay_shares(np.array([1e-3, 1.0, 1e6, -1.0]))
    np.testing.assert_allclose(first[:3], [1.0 - 5e-4 + 1e-6 / 6.0, 1.0 - np.exp(-1.0), 1e-6], rtol=1e-9)
    np.testing.assert_allclose(second[:3], [0.5 - 1e-3 / 6.0 + 1e-6 / 24.0, np.exp(-1.0), 1e-6], rtol=2e-6)
    np.testing.assert_allclose([first[3], second[3]], [1.0, 0.5], rtol=1e-6)  # a co-energy beyond its table


def test_a_lost_run_leaves_the_others_their_currents():
    inductance = np.array([np.full((2, 2), np.nan), np.diag([1e-3, 2e-3])])
    z = decay_of(inductance, np.ones(2), 1e-3).z
    np.testing.assert_allclose(np.sort(z[1]), [0.5, 1.0])


def test_a_circuit_beside_an_amplifier_decays_as_one_alone_does(levitation_model):
    """Their flux apart, so that neither knows of the other; the amplifier's current comes to what is commanded."""
    whole = cut_in_two(levitation_model)
    laser = PositionSensor(name="laser", noise=1e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    entries = whole.magnetics.coefficients.copy()
    entries[:, 3:] = 0.02, 0.0, 0.02
    one, other = whole.circuits
    quick = replace(one, resistance_ohm=1.5 * 0.02 / whole.sample_time_s)
    amplifier = replace(other, drive=Drive(kind="current", bandwidth_Hz=100.0))
    model = held(replace(whole, circuits=(quick, amplifier), other_sensors=(laser,)))
    model = replace(model, magnetics=replace(whole.magnetics, coefficients=entries))
    process = levitation_process(model, noise=NOISE, commanded=True)
    moved = process.transition(np.array([[0.03, 0.0, 0.5, 0.3]]), np.array([[0.0, 0.31]]))
    assert moved[0, 2] == pytest.approx(0.5 * np.exp(-1.5), rel=1e-6)
    kept = np.exp(-2.0 * np.pi * 100.0 * model.sample_time_s)
    assert moved[0, 3] == pytest.approx(0.31 - 0.01 * kept, rel=1e-9)
