"""Closed loops about a device with eddy currents or effects."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics
from femfit.model.with_effects import with_effects
from femfit.simulation.design import design_loop
from femfit.simulation.linear_loop import linear_plant
from femfit.simulation.loop import ClosedLoop, run_loop
from femfit.simulation.open_loop import simulate
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant, with_force_scale
from femfit.simulation.profile import Profile
from femfit.simulation.sensor import SensorErrors, loop_sensors
from femfit.simulation.targets import reference_steps
from support.added_effects import added
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.solenoids import solenoid
from support.steps import runge_kutta_step

EFFECTS = [
    added("eddy_current_lag", ring_share=0.2, diffusion_share=0.1),
    added("hysteresis", width_medium=0.02),
    added("sensor_delay", delay_s=1e-3),
    added("magnet_demagnetisation", loss=0.03),
    added("viscous_friction", damping_per_s=3.0),
    added("driver_gain", gain_error=0.03),
    added("hall_saturation", cubic_loss=0.02),
]
DISTANCE_M = 0.024


@pytest.mark.parametrize("times", [(), (20e-3, 2e-3)])
def test_the_plant_follows_a_diode_as_the_open_loop_does(times):
    """The closed loop's steps keep the flux that patterns link where a diode blocks, and let no current turn."""
    model = replace(solenoid(drive=Drive(diode_V=0.7)), sample_time_s=0.1e-3, motion=Mechanics(1e9, 0.0))
    model = with_eddies(model, times) if times else model
    command = Profile("voltage", np.array([0.0, 0.02]), np.array([12.0, 0.0]))
    table = simulate(model, drive=command, duration_s=0.04, start_m=4e-3, sample_time_s=0.1e-3).table
    plant = Plant(model)
    state, found, currents = plant.start(np.array([[4e-3, 0.0, 0.0]])), [], []
    for k in range(400):
        found.append(float(model.windings.magnetics.force(state[:, 0], state[:, 2 : model.windings.end])[0]))
        state = plant.step(state, np.array([12.0 if k < 200 else 0.0]))
        currents.append(state[0, 2])
    wanted = table["force_N"][:400]
    np.testing.assert_allclose(found, wanted, atol=2e-3 * wanted.max())  # the diode blocks within a step
    assert min(currents) >= 0.0
    assert currents[-1] < 1e-12  # of patterns that go on, to rounding


def a_start(model, runs=3):
    point = operating_point(model, DISTANCE_M)
    return np.tile(point.state, (runs, 1)), point


SCALED = {
    "plain": lambda rig: rig,
    "eddy currents": with_eddies,
    "halves with eddy currents": lambda rig: with_eddies(cut_in_two(rig)),
    "effects": lambda rig: with_effects(rig, EFFECTS),
}


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.nightly] * ("eddy currents" in one)) for one in SCALED]
)
def test_runs_with_forces_of_their_own_step_as_each_alone_does(levitation_model, name):
    """By the table of each force; force and motional constant are scaled alike, a force as it is changes nothing."""
    model, scales, random = SCALED[name](levitation_model), np.array([1.1, 1.0, 1.1, 0.95]), np.random.default_rng(2)
    batch, n = with_force_scale(model, scales), len(model.circuits)
    state = random.normal(0.0, 0.05, (4, model.order))
    state[:, 0], state[:, 2 : 2 + n] = 0.022, 0.4
    state[2], volts = state[1], np.full((4, n), 1.1)
    found, same = Plant(batch).step(state, volts), Plant(model).step(state, volts)
    alone = [
        Plant(with_force_scale(model, scale)).step(state[k : k + 1], volts[k : k + 1])[0]
        for k, scale in enumerate(scales)
    ]
    np.testing.assert_allclose(found, alone, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found[1], same[1], rtol=1e-9, atol=1e-12)
    assert found[2, 1] < same[2, 1]  # the stronger one falls more slowly
    if name == "plain":
        base, d, i = model.magnetics, state[:, 0], state[:, 2:]
        np.testing.assert_allclose(batch.magnetics.force(d, i), scales * base.force(d, i), rtol=1e-14)
        motional = batch.magnetics.motional_constant(d, i)
        np.testing.assert_allclose(motional, scales[:, None] * base.motional_constant(d, i), rtol=1e-14)


def test_the_fastest_pattern_does_not_shorten_the_steps():
    """0.1 ms against a pattern of 5 us, of which a Runge-Kutta method takes 20 steps at least."""
    model = with_eddies(replace(solenoid(), sample_time_s=1e-4), (8e-3, 5e-6))
    plant, state = Plant(model), np.array([[1e-3, -0.3, 0.4, 0.0, 0.0], [3e-3, 0.1, 0.2, 0.0, 0.0]])
    assert plant.steps == Plant(with_eddies(replace(solenoid(), sample_time_s=1e-4), (8e-3, 2e-3))).steps
    assert plant.steps == Plant(with_force_scale(model, np.array([1.0, 1.1]))).steps
    start, exact, volts = state, state, np.array([12.0, 0.0])
    for _ in range(20):
        state = plant.step(state, volts)
        exact = runge_kutta_step(model, exact, volts, model.sample_time_s, 100)
    moved = np.abs(exact - start).max(axis=0)
    assert (np.abs(state - exact).max(axis=0) < 2e-5 * moved).all()


def test_the_linear_plant_has_the_eddy_currents_modes(levitation_model):
    model = with_eddies(levitation_model, (50e-3, 10e-3))
    _, point = a_start(model)
    sensors = loop_sensors(model, ("hall",), {"hall": 1e-3}, model.sample_time_s)
    plant = linear_plant(model, point, sensors)
    assert plant.A.shape == (5, 5)
    poles = np.log(np.abs(np.linalg.eigvals(plant.A))) / model.sample_time_s
    assert (poles > 0.0).sum() == 1  # one is unstable, as without
    still = linear_plant(levitation_model, operating_point(levitation_model, DISTANCE_M), sensors)
    grows = np.log(np.abs(np.linalg.eigvals(still.A))).max() / model.sample_time_s
    # Conducting parts brake what runs away
    assert 0.0 < poles.max() < grows


STEPS = 300


def held(truth, believed, observer, seed=0):
    """Statistics of the second half of 0.15 s at one place, 8 runs."""
    design, own = design_loop(believed), design_loop(truth)
    point = own.points[4]
    reference = reference_steps([point.distance_m], STEPS, truth.sample_time_s, rate=10.0)
    loop = ClosedLoop(
        Plant(own.model),
        own.loop_sensors(),
        SensorErrors(),
        design.observer(observer),
        own.controller("backstepping"),
        reference,
    )
    start = np.tile([point.distance_m, 0.0, point.currents_A[0]], (8, 1))
    windows = (slice(STEPS // 2, STEPS),)
    return run_loop(loop, start, np.random.default_rng(seed), windows=windows).windows[0]


@pytest.fixture(scope="module")
def knowing(levitation_model):
    truth = with_effects(levitation_model, EFFECTS)
    return functools.cache(lambda observer: held(truth, truth, observer))


@pytest.mark.parametrize("observer", ["ukf", pytest.param("ukf4", marks=pytest.mark.nightly)])
def test_a_filter_that_knows_the_effects_is_consistent(knowing, observer):
    found = knowing(observer)
    # 1200 innovations: three standard errors are 0.12; the converter's rounding is within the noise
    assert 0.82 < found.normalised_innovation_squared.mean() < 1.12
    assert np.abs(found.estimate_bias_m).mean() < 60e-6


def test_a_filter_that_does_not_know_them_sees_the_body_elsewhere(levitation_model, knowing):
    ignorant = held(with_effects(levitation_model, EFFECTS), levitation_model, "ukf")
    assert ignorant.estimate_rms_m.mean() > 3.0 * knowing("ukf").estimate_rms_m.mean()
    assert ignorant.normalised_innovation_squared.mean() > knowing("ukf").normalised_innovation_squared.mean()
