"""The equations of motion of every kind of model: power balance, slopes, exact decays, orders of convergence."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm

from femfit.core.errors import MissingPartError
from femfit.core.numerics import GRAVITY
from femfit.device.electrics import Drive, PositionSensor
from femfit.device.mechanics import Mechanics
from femfit.effects.catalogue import BUILT_IN
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.noise import FilterNoise, default_noise
from femfit.model.with_effects import with_effects
from femfit.simulation.allocation import currents_for_acceleration
from femfit.simulation.gains import design_backstepping
from femfit.simulation.operating_point import operating_point
from femfit.simulation.targets import Reference
from support.added_effects import added, usual
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.model_kinds import (
    KINDS,
    differences,
    field_energy,
    held,
    rates,
    slopes,
    states_of,
    step,
    step_slopes,
    voltage_of,
)
from support.one_current import flat
from support.readings import hall_voltage
from support.solenoids import solenoid
from support.steps import exponential_step, runge_kutta_step

LINEAR = [name for name in KINDS if name not in {"law", "saturating"}]
"""Whose inductances do not depend on the currents."""


@pytest.fixture(params=KINDS)
def model(request, model_kind):
    return model_kind(request.param)


def assert_slopes(found, wanted, tolerance):
    """Relative to the largest of each entry, rounded over steps of 1e-5 of what is large for each state."""
    size = np.abs(wanted).max(axis=0) + 1e-6 * np.abs(wanted).max(axis=(0, 2))[:, None] + 1e-9
    size[0] += 1e-6  # a distance is rounded to 1e-17 m, over steps of 1e-7 of what is large
    assert (np.abs(found - wanted) / size).max() < tolerance


def test_power_in_is_heat_work_and_growth_of_the_field_energy(model):
    """U i = R i^2 + R_e e^2 + dW/dt + F v, at any state."""
    states, volts = states_of(model)
    windings, h, change = model.windings, 1e-6, rates(model, *states_of(model))
    w = states[:, 2:]
    ahead, back = states + h * change, states - h * change
    growth = (field_energy(model, ahead[:, 0], ahead[:, 2:]) - field_energy(model, back[:, 0], back[:, 2:])) / (2.0 * h)
    supplied = (volts * w[:, : len(model.circuits)]).sum(axis=1)
    heat = (windings.resistances_ohm * w**2).sum(axis=1)
    force = windings.magnetics.state(states[:, 0], w).force
    balance = growth + heat - force * states[:, 1]  # F acts towards smaller distance
    size = np.abs(force * states[:, 1]).max() + np.abs(supplied + heat).max()
    np.testing.assert_allclose(balance, supplied, rtol=0.0, atol=1e-6 * size)


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda effect: effect.name)
def test_the_jacobian_under_an_effect_is_the_slope_of_the_rates(effect, levitation_model):
    model = with_effects(levitation_model, [usual(effect, 0.2)])
    states, volts = states_of(model, 8)
    assert_slopes(slopes(model, states, volts), differences(model, rates, states, volts), 1e-5)


@pytest.mark.parametrize("seconds", [5e-4, 5e-3])
def test_the_jacobian_of_a_step_is_the_slope_of_the_step(model, seconds):
    states, volts = states_of(model)

    def stepped(changed, x, u):
        return step(changed, x, u, seconds)

    assert_slopes(step_slopes(model, states, volts, seconds), differences(model, stepped, states, volts), 5e-5)


LONG = ("magnets with eddies", 0.05)
"""Its table of responses asks for 32,436 inductances, the others for 14 to 272: a minute beside the rest."""


@pytest.mark.parametrize(
    ("name", "seconds"), [case for case in product(LINEAR, [1e-5, 5e-4, 5e-3, 0.05]) if case != LONG]
)
def test_currents_of_a_held_body_decay_exactly_whatever_the_step(name, model_kind, seconds):
    """By the matrix exponential; where the midpoint method left 0.50 for 0.37, 0.63 for 0.22 and 0.91 for 0.15."""
    model = held(model_kind(name))
    states, volts = states_of(model, 3)
    states[:, 1] = 0.0
    found, windings = step(model, states, volts, seconds)[:, 2:], model.windings
    in_series = np.diag([*(circuit.inductance_H for circuit in model.circuits), *np.zeros(len(model.eddy_names))])
    for state, fed, after in zip(states, volts, found, strict=True):
        inductance = windings.magnetics.state(state[:1], state[None, 2:]).inductance[0] + in_series
        rest = np.pad(fed, (0, windings.count - len(model.circuits))) / windings.resistances_ohm
        share = expm(-seconds * np.linalg.solve(inductance, np.diag(windings.resistances_ohm)))
        np.testing.assert_allclose(after, rest + share @ (state[2:] - rest), rtol=1e-9, atol=1e-9)


FRICTION = [
    added("viscous_friction", damping_per_s=50.0),
    added("fluid_drag", drag_per_m=50.0),
    added("side_pull_friction", share=0.2),
    added("supply_sag", inner_resistance=0.3),
]


def moved(model, state, volts, seconds, steps):
    for _ in range(steps):
        state = exponential_step(model, state, volts, seconds / steps)
    return state


@pytest.mark.parametrize("name", ["one circuit", "halves", "solenoid with eddies", "lossy driver", "friction"])
def test_steps_converge_with_the_second_order(name, levitation_model):
    """Over many motions, in some of which the errors of one kind make up for those of another."""
    model, low, high, seconds = {
        "one circuit": (levitation_model, [0.022, -0.05, 0.2, 0.2], [0.03, 0.05, 0.8, 0.8], 0.016),
        "halves": (cut_in_two(levitation_model), [0.022, -0.05, 0.2, 0.2], [0.03, 0.05, 0.8, 0.8], 0.016),
        "solenoid with eddies": (
            with_eddies(solenoid(), (8e-3, 2e-3)), [1e-3, -0.3, 0.1, -0.1, -0.1], [3e-3, 0.1, 0.5, 0.1, 0.1], 1.6e-3,
        ),
        "lossy driver": (
            with_effects(with_eddies(levitation_model, (8e-3, 2e-3)), [added("supply_sag", inner_resistance=2.0)]),
            [0.022, -0.05, 0.2, -0.1, -0.1], [0.03, 0.05, 0.8, 0.1, 0.1], 0.004,
        ),
        "friction": (with_effects(levitation_model, FRICTION), [0.022, 0.2, 0.2], [0.026, 0.4, 0.8], 0.004),
    }[name]  # fmt: skip
    generator = np.random.default_rng(1)
    start = generator.uniform(low, high, (30, len(low)))[:, : model.order]
    most = {"halves": 1.2, "solenoid with eddies": 12.0}.get(name, 2.4)
    volts = voltage_of(model, generator.uniform(0.25 * most, most, (30, len(model.circuits))))

    exact = runge_kutta_step(model, start, volts, seconds, substeps=256)
    coarse, fine = (
        np.sqrt(np.mean((moved(model, start, volts, seconds, steps) - exact) ** 2, axis=0)) for steps in (32, 64)
    )
    # Asymptotic ratio 4; down to 0.15 of an order less for the pre-asymptotic part
    assert (np.log2(coarse / fine) > 1.85).all()


def test_states_of_effects_converge_with_the_second_order(levitation_model):
    """A core's play operators beside its eddy currents, while the current rises or falls."""
    effects = [
        added("hysteresis", width_small=0.01, width_medium=0.02),
        added("eddy_current_lag", ring_share=0.2, diffusion_share=0.1),
    ]
    model = held(with_effects(levitation_model, effects))
    start = np.zeros((2, model.order))
    start[:, 0], start[:, 2] = 0.024, (0.3, 0.9)
    volts, seconds = voltage_of(model, np.array([[2.4], [0.0]])), 8e-3

    exact = runge_kutta_step(model, start, volts, seconds, substeps=1024)
    coarse, fine = (
        np.abs(moved(model, start, volts, seconds, steps) - exact)[:, 2:].max(axis=0) for steps in (64, 128)
    )
    assert (coarse < 5e-3 * np.abs(exact - start)[:, 2:].max(axis=0)).all()
    assert (coarse / fine > 3.0).all()  # four of them; a state that a fast change saturates forgets its errors


def test_a_lost_run_leaves_the_others_their_states(model):
    states, volts = states_of(model, 3)
    wanted, states[1, 0] = step(model, states, volts, 1e-3), np.nan
    found = step(model, states, volts, 1e-3)
    np.testing.assert_array_equal(found[[0, 2]], wanted[[0, 2]])
    assert np.isnan(found[1, :2]).all()


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda effect: effect.name)
def test_at_rest_the_equations_under_an_effect_are_those_of_the_changed_magnetics(effect, levitation_model):
    model = with_effects(levitation_model, [usual(effect, 0.2)])
    d, i = np.array([0.018, 0.023, 0.031]), np.array([0.2, 0.6, 1.1])
    states = np.zeros((3, model.order))
    states[:, 0], states[:, 2] = d, i
    acceleration = rates(model, states, np.full((3, 1), 2.0))[:, 1]
    expected = model.motion.gravity_m_s2 - flat(model.magnetics).force(d, i) / model.motion.mass_kg
    np.testing.assert_allclose(acceleration, expected, rtol=1e-10)
    np.testing.assert_allclose(hall_voltage(model, states), model.sensor.voltage(d, i), rtol=1e-12)


def test_a_model_that_lacks_a_circuit_or_an_inductance_has_no_dynamics(model_kind, levitation_model):
    law = model_kind("law")
    law.require_dynamics()
    forces_alone = replace(law, magnetics=replace(law.magnetics, constant_inductance_H=0.0))
    with pytest.raises(MissingPartError, match=r"inductance > 0.*--inductance-H"):
        forces_alone.require_dynamics()
    with pytest.raises(MissingPartError, match="circuit"):
        replace(levitation_model, circuits=()).require_dynamics()


def test_a_circuit_beside_an_amplifier_decays_as_one_alone_does(levitation_model):
    """Their flux apart, so that neither knows of the other; the amplifier's current comes to what is commanded."""
    whole = cut_in_two(levitation_model)
    laser = PositionSensor(name="laser", noise=1e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    entries = whole.magnetics.coefficients.copy()
    entries[:, 3:] = 0.02, 0.0, 0.02
    first, second = whole.circuits
    quick = replace(first, resistance_ohm=1.5 * 0.02 / whole.sample_time_s)
    amplifier = replace(second, drive=Drive(kind="current", bandwidth_Hz=100.0))
    model = held(replace(whole, circuits=(quick, amplifier), other_sensors=(laser,)))
    model = replace(model, magnetics=replace(whole.magnetics, coefficients=entries))
    noise = FilterNoise(acceleration_density=1e-4, voltage_V=0.01, hall_V=1e-3)
    process = kalman_filter(model, hall_bias=False, noise=noise, commanded=True).process
    moved = process.transition(np.array([[0.03, 0.0, 0.5, 0.3]]), np.array([[0.0, 0.31]]))
    assert moved[0, 2] == pytest.approx(0.5 * np.exp(-1.5), rel=1e-6)
    remaining = np.exp(-2.0 * np.pi * 100.0 * model.sample_time_s)
    assert moved[0, 3] == pytest.approx(0.31 - 0.01 * remaining, rel=1e-9)


def springs_and_load(distance):
    """The force of SPRUNG beside the weight, written out anew."""
    table = np.interp(distance, [0.01, 0.02, 0.04], [2e-3, 1e-3, -3e-3])
    return 2e-3 - 0.4 * (distance - 0.024) + table - 1e-3


def test_weight_springs_load_and_friction_act_on_plant_rest_and_inverse_alike(model_kind):
    model = model_kind("springs")
    acceleration = rates(model, np.array([[0.023, 0.1, 0.5]]), np.ones((1, 1)))[0, 1]
    pushed = springs_and_load(0.023) - 0.02 * 0.1 - float(model.force(0.023, 0.5))
    assert acceleration == pytest.approx(9.80665 + pushed / 4.35e-3, rel=1e-12)
    needed = 4.35e-3 * 9.80665 + springs_and_load(0.025)
    assert float(model.force(0.025, holding_currents(model, 0.025)[0])) == pytest.approx(needed, rel=1e-9)
    driver = [added("driver_gain", gain_error=-0.1), added("supply_sag", inner_resistance=0.3)]
    for device in (model, with_effects(model, [*driver, added("driver_dead_zone", dead_zone=0.05), FRICTION[0]])):
        point = operating_point(device, 0.025)
        state, volts = np.array([[0.025, 0.0, point.currents_A[0]]]), np.array([[point.commands[0]]])
        assert np.abs(rates(device, state, volts)).max() < 1e-9
        np.testing.assert_allclose(point.A, slopes(device, state, volts)[0], rtol=1e-9, atol=1e-9)
        by_volts = rates(device, state, volts + 1e-3)[0] - rates(device, state, volts)[0]
        np.testing.assert_allclose(point.B[:, 0], 1e3 * by_volts, rtol=1e-7, atol=1e-9)
    current = currents_for_acceleration(model, np.array([0.024]), np.array([1.0]), np.array([0.1])).ravel()[0]
    assert rates(model, np.array([[0.024, 0.1, current]]), np.ones((1, 1)))[0, 1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("gravity", [9.80665, 0.0, -9.80665])
def test_a_body_that_hangs_lies_or_stands_is_held_by_the_same_equations(levitation_model, gravity):
    load = 4.35e-3 * (9.80665 - gravity)  # what a string pulls, so that all of them need the same force
    hanging = replace(levitation_model, misfit=None)
    model = replace(hanging, motion=Mechanics(4.35e-3, gravity, load_N=load))
    assert holding_currents(model, 0.024)[0] == pytest.approx(holding_currents(hanging, 0.024)[0], rel=1e-12)
    densities = [default_noise(device).acceleration_density for device in (model, hanging)]
    assert densities[0] == pytest.approx(densities[1], rel=1e-12)
    state = np.array([[0.0242, 0.0, operating_point(model, 0.024).currents_A[0]]])
    rest = Reference(*map(np.asarray, (0.024, 0.0, 0.0, [0.0])))
    commands = [
        design_backstepping(device, [operating_point(device, 0.024)]).command(np.zeros((1, 0)), state, rest)[0]
        for device in (model, hanging)
    ]
    assert commands[0] == pytest.approx(commands[1], rel=1e-9)


@pytest.mark.parametrize("creep", [None, 1e-3, 1e-5])
def test_dry_friction_stops_a_sliding_body_and_does_not_throw_it_back(levitation_model, creep):
    """Drawn, or as an effect whose level begins at a creep that is slower than what a step takes from the body."""
    spline = levitation_model.magnetics.spline
    coefficients = np.zeros_like(spline.coefficients)
    coefficients[:, -1] = 0.5 * 0.01 * spline.y_knots[-1] ** 2  # 10 mH i^2 / 2: no force
    model = replace(levitation_model, motion=Mechanics(4.35e-3, 0.0, coulomb_N=0.0 if creep else 0.2))
    model = replace(model, magnetics=replace(model.magnetics, spline=replace(spline, coefficients=coefficients)))
    if creep:
        friction = added("coulomb_friction", level=0.2 / (4.35e-3 * GRAVITY), creep_m_s=creep)
        model = with_effects(model, [friction])
    state = np.array([[0.02, 0.05, 0.0]])  # m v / F: it stops within 1.1 ms, two samples
    for _ in range(20):
        state = step(model, state, np.zeros((1, 1)), model.sample_time_s)
        assert state[0, 1] >= -1e-12
    assert state[0, 1] < 1e-5
    stopped = 0.02 + 0.05**2 * 4.35e-3 / (2.0 * 0.2)
    assert state[0, 0] == pytest.approx(stopped, abs=0.05 * 4.0 * model.sample_time_s)  # rounded near rest


FEW = ["one circuit", "choke", "springs", "halves", "eddies", "halves with eddies"]


@pytest.mark.parametrize("name", FEW)
def test_a_sample_takes_as_many_steps_as_it_needs_for_half_a_percent_of_its_change(model_kind, name):
    """Half the length is four times as good, but for eddy currents, whose table holds the inductance within a step."""
    model = model_kind(name)
    steps, box, last = model.sample_step.count, model.validity, 2 + len(model.circuits)
    states, volts = states_of(model, 200)
    states[:, last:], volts = 0.0, voltage_of(model, volts)
    wanted = runge_kutta_step(model, states, volts, model.sample_time_s, 400)
    within = box.contains(wanted[:, 0], wanted[:, 2:last])
    assert within.sum() > 50
    changed = np.sqrt(np.square(wanted - states)[within, 1:last].mean(axis=0))
    errors = []
    for count in (steps, 2 * steps):
        found = moved(model, states, volts, model.sample_time_s, count)
        errors.append(np.sqrt(np.square(found - wanted)[within, 1:last].mean(axis=0)) / changed)
    assert (errors[0] < 5.3e-3).all()
    assert (errors[1] < np.maximum((0.35 if model.eddy is None else 0.6) * errors[0], 1e-6)).all()


def test_a_sample_takes_all_the_steps_in_iron_that_saturates_and_where_it_leaves_the_model(model_kind):
    assert model_kind("solenoid").sample_step.count == 4
    assert model_kind("saturating").sample_step.count == 4
    assert replace(model_kind("solenoid"), sample_time_s=1e-5).sample_step.count == 1
    endless = replace(model_kind("solenoid"), sample_time_s=10.0).sample_step
    assert (endless.count, endless.error) == (4, np.inf)
    assert replace(model_kind("solenoid"), sample_time_s=5e-3).sample_step.error > 0.01
