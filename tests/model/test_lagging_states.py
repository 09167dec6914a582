"""Eddy currents and the states of effects in the equations of motion: closed forms, passivity, lag, hysteresis."""

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.stages import changed_coenergy, circuit_of
from femfit.model.dynamics import state_derivative
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.hall import CurrentAxis, SensedField
from femfit.model.with_effects import coenergy_of, nominal_of, with_effects
from femfit.simulation.system import MODE_NUMBERS, moment_function
from support.added_effects import added, under_effects
from support.eddies import REFERENCE_M, knots_over, magnets_alone, spline_of, with_eddies
from support.halves import cut_in_two
from support.model_kinds import by_volt, held, states_of, voltage_of
from support.one_current import flat
from support.readings import hall_voltage
from support.steps import runge_kutta_step

DISTANCE_M = 0.025


def one_ring(model, coupling=0.4, inductance=2e-3, linkage=0.0):
    """One pattern of 1 ohm whose C, Q and lambda are constant, but for a straight lambda."""
    knots = knots_over(0.015, 0.045, 2)
    n = len(model.circuits)
    ring = EddyCurrents(
        ("eddy_1",),
        model.circuit_names,
        replace(model.magnetics.coordinate, reference_distance_m=REFERENCE_M, kind="distance", distance_shift_m=0.0),
        2,
        np.ones(1),
        knots,
        np.full((3, n, 1), coupling),
        spline_of(lambda u: linkage * u[:, None], knots, 2),
        np.full((3, 1), inductance),
    )
    return replace(model, eddy=ring)


def test_a_ring_takes_inductance_away_as_in_a_transformer(levitation_model):
    """Z = R + j w L (1 - k^2 j w T / (1 + j w T)): L falls to L (1 - k^2), R grows."""
    model = one_ring(levitation_model)
    static, f = float(model.inductance(DISTANCE_M, 0.5)), np.array([0.0, 1.0, 30.0, 300.0, 1e4])
    own = 0.16 * static + 2e-3
    k_squared, s = 0.16 * static / own, 2j * np.pi * f
    wanted = model.circuit.resistance_ohm + s * static * (1.0 - k_squared * s * own / (1.0 + s * own))
    np.testing.assert_allclose(model.impedance(DISTANCE_M, 0.5, f), wanted, rtol=1e-12)
    plain = replace(model, eddy=None).impedance(DISTANCE_M, 0.5, f)
    assert model.impedance(DISTANCE_M, 0.5, f)[0] == pytest.approx(plain[0])
    assert plain.shape == f.shape


@pytest.mark.parametrize("circuits", [1, 2])
def test_impedances_are_those_of_the_simulated_sine(levitation_model, circuits):
    """The equations of motion linearised about the bias give the same impedance."""
    base = levitation_model if circuits == 1 else cut_in_two(levitation_model)
    model, bias, f = held(with_eddies(base)), np.full(circuits, 0.6), 40.0
    taken = bias if circuits > 1 else bias[0]
    z = np.reshape(model.impedance(DISTANCE_M, taken, f), (circuits, circuits))
    np.testing.assert_allclose(np.linalg.inv(by_volt(model, DISTANCE_M, bias, f)[:circuits]), z, rtol=1e-9)


def test_a_magnet_that_passes_a_ring_slowly_is_braked_by_the_linkage_squared_over_the_resistance(levitation_model):
    slope, velocity = 0.02, 0.01  # of the ring's flux linkage, in Wb/m
    model = one_ring(magnets_alone(levitation_model), linkage=slope * REFERENCE_M)
    current = -slope * velocity / 1.0  # steady: 0 = R e + lambda' v
    states = np.array([[DISTANCE_M, velocity, current], [DISTANCE_M, 0.0, 0.0]])
    moving, resting = state_derivative(model, states, np.zeros((2, 0)))
    assert moving[2] == pytest.approx(0.0, abs=1e-12)
    brake = (resting[1] - moving[1]) * model.motion.mass_kg
    assert brake == pytest.approx(slope**2 / 1.0 * velocity, rel=1e-9)


@pytest.mark.parametrize("circuits", [1, 2])
def test_the_field_beside_patterns_is_that_of_the_acting_currents_and_their_own(levitation_model, circuits):
    """Beyond the knots as well. Of two circuits the mean current makes the field of the one."""
    model = with_eddies(levitation_model if circuits == 1 else cut_in_two(levitation_model))
    field = levitation_model.sensor.field
    if circuits == 2:
        spline, ends = field.spline, (CurrentAxis(field.spline.y_knots, 1),) * 2
        means = 0.5 * (spline.coefficients[:, :, None] + spline.coefficients[:, None])
        field = SensedField(field.coordinate, spline.x_knots, spline.x_degree, ends, means)
    states, _ = states_of(model, 300)
    states[:, 0] = np.linspace(0.005, 0.06, 300)
    i, e = states[:, 2 : 2 + circuits], states[:, 2 + circuits :]
    forms = model.eddy.forms(states[:, 0])[0]
    u = (i + (forms.coupling @ e[..., None])[..., 0]).mean(axis=1)
    own = forms.hall if circuits == 1 else np.zeros(e.shape[1])
    wanted = flat(levitation_model.sensor.field).field(states[:, 0], u) + (own * e).sum(axis=1)
    with building():
        d, w = SX.sym("d"), SX.sym("w", circuits + e.shape[1])
        function = GraphFunction([ca.vertcat(d, w)], model.eddy.field(field.expression, d, w))
    found = function(np.column_stack([states[:, 0], states[:, 2:]]).T)[0]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())
    if circuits == 1:
        seen = model.sensor.quiescent_V + model.sensor.sensitivity_V_per_T * wanted
        np.testing.assert_allclose(hall_voltage(model, states), seen, rtol=1e-11)


LAG = ("eddy_current_lag", {"ring_share": 0.1, "diffusion_share": 0.1, "time_s": 2e-3})
HYSTERESIS = ("hysteresis", {"width_medium": 0.005, "width_large": 0.02, "taper": 0.02})
FRICTION, SAG = ("coulomb_friction", {"level": 0.1}), ("supply_sag", {"inner_resistance": 0.2})
TURNS, SATURATION = ("turns", {"turns_error": 0.1}), ("core_saturation", {"mmf_loss_3": 0.1})


@pytest.mark.parametrize(
    "chosen",
    [(SAG,), (LAG,), (HYSTERESIS,), (LAG, HYSTERESIS, FRICTION), (TURNS, SATURATION, LAG)],
    ids=lambda chosen: "-".join(name for name, _ in chosen),
)
def test_under_effects_every_winding_obeys_faraday(levitation_model, chosen):
    """U - R w is the rate of the flux linkages, differenced along the rates that the equations give."""
    model = under_effects(with_eddies(levitation_model), *chosen)
    plain, volts = states_of(model.without_effects)
    volts = voltage_of(model.without_effects, volts)
    memory = 0.05 * np.random.default_rng(2).normal(size=(len(plain), len(model.memory_names)))
    states, end, h = np.column_stack([plain, memory]), model.windings.end, 1e-6
    rates = state_derivative(model, states, volts)
    with building():
        at = SX.sym("d"), SX.sym("u")
        z = SX.sym("z", len(model.memory_names))
        held = replace(model.conditions, memory=dict(zip(model.memory_names, ca.vertsplit(z), strict=True)))
        coenergy = changed_coenergy(coenergy_of(model), model.effects, held)(*at, 0.0)
        linkage = GraphFunction([ca.vertcat(*at, z)], ca.gradient(coenergy, at[1]))

    def flux(x):
        forms = model.eddy.forms(x[:, 0])[0]
        u = x[:, 2] + (forms.coupling[:, 0] * x[:, 3:end]).sum(axis=1)
        phi = linkage(np.column_stack([x[:, 0], u, x[:, end:]]).T)[0]
        q = (forms.inductance @ x[:, 3:end, None])[..., 0]
        return np.column_stack([phi, forms.coupling[:, 0] * phi[:, None] + forms.flux_linkage + q])

    growth = (flux(states + h * rates) - flux(states - h * rates)) / (2.0 * h)
    ohms = np.full(len(states), model.without_effects.circuit.resistance_ohm)
    at = replace(model.conditions, velocity_m_s=states[:, 1])
    ohms, given = circuit_of(model.effects, ohms, volts, states[:, 2], at)
    wanted = -model.windings.resistances_ohm * states[:, 2:end]
    wanted[:, 0] = given - ohms * states[:, 2]
    np.testing.assert_allclose(growth, wanted, rtol=0.0, atol=1e-7 * np.abs(wanted).max())


def test_a_prescribed_current_leaves_the_eddy_currents_to_themselves(levitation_model):
    """With i' given, R_e e + d(flux)/dt = 0 holds for the patterns; the voltage is what it takes."""
    plain = with_eddies(levitation_model)
    model = under_effects(plain, ("supply_sag", {}))
    states, _ = states_of(plain)
    inputs = states.T, np.array([25.0]), np.zeros(1), np.zeros(MODE_NUMBERS)
    found = moment_function(model, (0,))(*inputs).T[:, : model.order]
    np.testing.assert_allclose(found[:, 2], 25.0)
    magnetic = plain.windings.magnetics.state(states[:, 0], states[:, 2:])
    wanted = -states[:, 3:] + magnetic.motional_constant[:, 1:] * states[:, 1:2]
    linked = np.einsum("pjk,pk->pj", magnetic.inductance, found[:, 2:])[:, 1:]
    np.testing.assert_allclose(linked, wanted, atol=1e-11 * np.abs(wanted).max())


def test_a_late_sensor_follows_the_circuit_not_the_core(levitation_model):
    model = under_effects(with_eddies(levitation_model), ("sensor_delay", {"delay_s": 1e-3}))
    states, volts = states_of(model.without_effects)
    volts = voltage_of(model.without_effects, volts)
    states = np.column_stack([states, np.zeros(len(states))])
    rates = state_derivative(model, states, volts)
    peak = model.conditions.nominal.peak_current_A
    np.testing.assert_allclose(rates[:, -1], rates[:, 2] / peak, rtol=1e-12)


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
