"""Effects at work while something moves: circuit law, Jacobians, lag, hysteresis, friction, delay, drift."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.model.with_effects import nominal_of, with_effects
from support.added_effects import added
from support.model_kinds import held
from support.one_current import flat
from support.readings import hall_voltage
from support.steps import runge_kutta_step


def test_the_current_of_a_held_coil_with_a_shorted_ring_has_its_two_exponentials(levitation_model):
    share, tau = 0.4, 4e-3
    base = held(levitation_model)
    model = with_effects(base, [added("eddy_current_lag", ring_share=share, time_s=tau)])
    resistance, d, volts = base.circuit.resistance_ohm, 0.03, 1.0
    inductance = float(flat(base.magnetics).inductance(np.array(d), np.array(0.0)))
    # L (i' - share x') + R i = U and x' = i' - x / tau
    coupled = np.linalg.inv([[inductance, -share * inductance], [-1.0, 1.0]])
    matrix, drive = coupled @ -np.diag([resistance, 1 / tau]), coupled @ [volts, 0.0]
    rest = -np.linalg.solve(matrix, drive)
    poles, shapes = np.linalg.eig(matrix)
    time = 5e-3
    expected = rest + (shapes * np.exp(poles * time)) @ np.linalg.solve(shapes, -rest)
    x = np.array([[d, 0.0, 0.0, 0.0, 0.0]])
    for _ in range(500):
        x = runge_kutta_step(model, x, np.array([volts]), time / 500)
    assert x[0, 2] == pytest.approx(expected[0], rel=1e-8)
    scale = nominal_of(base).peak_current_A
    assert x[0, 3] * scale == pytest.approx(expected[1], rel=1e-7)


def states_along(current, start, parameters, nominal):
    """States of hysteresis after each step of the current, by their own equation and the midpoint rule."""
    effect, z, track = effect_by_name("hysteresis"), start, []
    for low, high in pairwise(current):
        sign, middle = np.array([np.sign(high - low)]), np.array([0.5 * (low + high)])
        moving = Conditions(nominal, current_rate_A_s=sign)
        half = effect.memory.rate(z, middle, moving, parameters)
        mid = {k: v + 0.5 * abs(high - low) * half[k] for k, v in z.items()}
        rate = effect.memory.rate(mid, middle, moving, parameters)
        z = {k: v + abs(high - low) * rate[k] for k, v in z.items()}
        track.append([z[k][0] for k in effect.memory.names])
    return z, np.array(track).T


@pytest.mark.parametrize("fade", [0.0, 2.5])
def test_a_slow_cycle_in_time_is_the_loop_of_the_bench(fade, levitation_model):
    effect = effect_by_name("hysteresis")
    nominal, parameters = nominal_of(levitation_model), effect.null() | {"fade": fade}
    i = np.concatenate([np.linspace(0.2, 1.2, 1001), np.linspace(1.2, 0.2, 1001)[1:]])
    z = dict.fromkeys(effect.memory.names, np.zeros(1))
    for _ in range(6):
        z, track = states_along(i, z, parameters, nominal)
    at = Conditions(nominal, branch=np.repeat([1.0, -1.0], 1000), current_turn_A=(0.2, 1.2))
    slow = effect.memory.steady_state(i[1:], i[1:], at, parameters)
    # After five cycles the largest radius keeps exp(-10 / 0.7) of its start; the midpoint rule's error is 4e-5
    np.testing.assert_allclose(track, np.stack([slow[k] for k in effect.memory.names]), atol=1e-4)


@pytest.mark.parametrize("fade", [0.0, 2.5])
def test_the_path_that_a_bench_recalls_is_that_of_the_states_own_equation(fade, levitation_model):
    effect = effect_by_name("hysteresis")
    nominal, parameters = nominal_of(levitation_model), effect.null() | {"fade": fade, "virgin": 1.0}
    read = np.array([0.4, 1.1, 0.7, 0.9, 0.1, 0.1, 1.2, 0.6])
    fine = np.concatenate([np.linspace(a, b, 1001)[1:] for a, b in pairwise([0.0, *read])])
    z = dict.fromkeys(effect.memory.names, np.zeros(1))
    _, track = states_along(np.append(0.0, fine), z, parameters, nominal)
    recalled = effect.memory.recall(read, np.arange(len(read)) == 0, nominal)
    slow = effect.memory.steady_state(read, read, Conditions(nominal, recalled=recalled), parameters)
    # The midpoint rule's error is 4e-5
    np.testing.assert_allclose(track[:, 999::1000], np.stack([slow[k] for k in effect.memory.names]), atol=1e-4)


def test_a_bench_whose_core_was_cycled_before_recalls_the_cycle(levitation_model):
    effect = effect_by_name("hysteresis")
    nominal = nominal_of(levitation_model)
    read = np.concatenate([np.linspace(0.2, 1.2, 6), np.linspace(1.0, 0.2, 5)])
    at = Conditions(nominal, branch=np.repeat([1.0, -1.0], [6, 5]), current_turn_A=(0.2, 1.2))
    recalled = effect.memory.recall(read, np.arange(11) == 0, nominal)
    path, cycle = (
        effect.memory.steady_state(read, read, one, effect.null()) for one in (replace(at, recalled=recalled), at)
    )
    # At the upper turning point the cycle counts as rising
    for name in effect.memory.names:
        np.testing.assert_allclose(path[name], cycle[name], atol=1e-12)


def test_a_delayed_reading_is_that_of_the_past(levitation_model):
    delay, h = 2e-3, 1e-4
    model = with_effects(levitation_model, [added("sensor_delay", delay_s=delay)])
    x = np.array([[0.022, 0.05, 0.4, 0.0]])
    true, read = [], []
    for k in range(400):
        volts = np.array([1.1 + 0.3 * np.sin(2.0 * np.pi * 5.0 * k * h)])
        true.append(levitation_model.sensor.voltage(x[0, 0], x[0, 2]))
        read.append(hall_voltage(model, x)[0])
        x = runge_kutta_step(model, x, volts, h)
    now, past, told = np.array(true[100:]), np.array(true[80:-20]), np.array(read[100:])
    # To first order in 2 ms, of a current that follows in 6 ms and a body that moves in some 30 ms
    assert np.std(told - past) < 0.15 * np.std(now - past)


def test_drift_goes_on_while_the_plant_runs_and_is_nothing_at_its_start(levitation_model):
    model = with_effects(levitation_model, [added("hall_drift", ramp_V=0.1)])
    x = np.array([[0.022, 0.0, 0.4]])
    assert hall_voltage(model, x)[0] == levitation_model.sensor.voltage(0.022, 0.4)
    assert hall_voltage(model, x, 50.0)[0] - hall_voltage(model, x)[0] == pytest.approx(0.005)
