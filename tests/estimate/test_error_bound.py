"""The bound; late sensors, pickup coils, fine steps, and eddy currents in a filter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.error_bound import bound_along, error_bound, without_stops
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import UnscentedFilter
from femfit.estimate.noise import FilterNoise
from femfit.model.sensors import predict_sensor, sampled_readings, sensor_named
from femfit.model.with_effects import with_effects
from support.added_effects import added
from support.eddies import with_eddies
from support.parts import with_circuit, with_motion
from support.readings import LASER, SHUNT, read_by
from support.solenoids import REACH_H_M, SHIFT_M, inductance, searched, solenoid
from support.solenoids import STEP_S as PICKUP_STEP_S
from support.steps import runge_kutta_step


def test_without_current_the_coil_s_current_says_nothing_of_the_distance():
    """L(d) i and F(d, i) have no slope in the distance at i = 0: self-sensing is blind at rest without excitation."""
    model = read_by(SHUNT, LASER)
    bound = error_bound(model, sensors=("current",), distances_m=(2e-3,), currents_A=(0.0, 1.0))
    assert bound.observed[:, 0].tolist() == [False, True]
    assert error_bound(model, distances_m=(2e-3,), currents_A=(0.0,)).observed[0, 0]  # the laser needs none


STEP_S = 2e-5


def moved(start, volts):
    """Distance, velocity and current at every sample, from m d'' and U = R i + (L i)' as they stand in a textbook."""

    def rates(_, x, u):
        slope = -REACH_H_M / (x[0] + SHIFT_M) ** 2
        force = -0.5 * slope * x[2] ** 2
        push = 0.1 - 200.0 * (x[0] - 4e-3)
        return [x[1], (push - force) / 0.025, (u - 20.0 * x[2] - slope * x[1] * x[2]) / inductance(x[0])]

    states = [np.asarray(start, float)]
    for u in volts[1:]:
        found = solve_ivp(rates, (0.0, STEP_S), states[-1], args=(u,), rtol=1e-10, atol=1e-14)
        states.append(found.y[:, -1])
    return np.array(states)


def test_the_bound_of_a_stroke_is_the_fisher_information_of_simulated_currents():
    """d z / d(start) and d(end) / d(start) by differences of whole simulations, with no Jacobian of femfit's."""
    volts = np.full(250, 12.0)
    start, spread = np.array([3.5e-3, 0.0, 0.3]), np.array([1e-3, 0.05, 0.1])
    nominal = moved(start, volts)
    offs = np.diag(1e-4 * spread)
    slopes = np.stack([moved(start + h, volts) - moved(start - h, volts) for h in offs], axis=-1) / (2e-4 * spread)
    information = np.diag(spread**-2.0) + slopes[:, 2].T @ slopes[:, 2] / SHUNT.noise**2
    wanted = np.sqrt(np.diag(slopes[-1] @ np.linalg.inv(information) @ slopes[-1].T))
    silent = FilterNoise(acceleration_density=1e-24, voltage_V=1e-9, hall_V=1.0)
    process = kalman_filter(replace(read_by(SHUNT), sample_time_s=STEP_S), noise=silent).process
    found = np.sqrt(np.diag(bound_along(process, nominal, volts)[-1]))
    np.testing.assert_allclose(found, wanted, rtol=0.04)  # h R / L = 0.03 of Euler's step


def run_of(model):
    """States and voltages of a body that goes to and fro, by the filter's own steps."""
    process = kalman_filter(model, sensors=("current",)).process
    volts = 10.0 + 6.0 * np.sin(700.0 * PICKUP_STEP_S * np.arange(200))
    states = [np.array([2.5e-3, 0.0, 0.5])]
    for u in volts[1:]:
        states.append(process.transition(states[-1][None], np.array([u]))[0])
    return np.array(states), volts


@pytest.mark.parametrize("name", ["search", "laser"])
@pytest.mark.parametrize("delay", [0.0, 2.0, 2.25])
def test_predicted_readings_are_those_of_the_samples(name, delay):
    prompt = searched(noise=2e-3)
    sensors = tuple(replace(one, delay_s=delay * PICKUP_STEP_S) for one in (*prompt.other_sensors, LASER))
    model = replace(prompt, other_sensors=sensors)
    states, volts = run_of(read_by(SHUNT))
    built = kalman_filter(model, sensors=(name,))
    process, at, found = built.process, built.start(states[0]).mean, []
    for k, u in enumerate(volts):
        at = at if k == 0 else process.transition(at, np.array([u]))
        found.append(process.measure(process.outputs[0].name, at)[0])
    wanted = sampled_readings(model, sensor_named(model, name), states)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.ptp(wanted))


def test_a_bound_of_readings_at_every_fourth_sample_is_that_of_a_fourth_of_the_information():
    states, volts = run_of(read_by(SHUNT))
    slow, rare = replace(LASER, sample_time_s=4.0 * PICKUP_STEP_S), replace(LASER, noise=2.0 * LASER.noise)
    found, wanted = (bound_along(kalman_filter(read_by(one)).process, states, volts) for one in (slow, rare))
    np.testing.assert_allclose(found[-1], wanted[-1], rtol=1e-9)


def alone(model):
    """A process read by a sensor of the distance."""
    return kalman_filter(replace(model, other_sensors=(LASER,))).process


@pytest.mark.parametrize("velocity", [0.0, -0.02, 0.02])
def test_the_current_of_a_body_pressed_to_its_stop_rises_as_its_inductance_there_says(velocity):
    """A light body that two amperes pull through a tenth of a millimetre in a sample, were there no stop."""
    light = Mechanics(0.5e-3, 0.0, near_stop=Stop(0.2e-3), far_stop=Stop(4e-3))
    model = replace(solenoid(light), sample_time_s=2e-4)
    fine, free = alone(model), alone(without_stops(model))
    state, volts = np.array([[0.2e-3, velocity, 1.8]]), np.full(1, 40.0)
    assert free.transition(state, volts)[0, 0] < 0.0
    decay = np.exp(-20.0 * 2e-4 / inductance(0.2e-3))
    moved = fine.transition(state, volts)[0]
    assert moved[:2].tolist() == [0.2e-3, 0.0]
    assert moved[2] == pytest.approx(2.0 - 0.2 * decay, abs=1e-4)  # a body off the stop by 4 um is not quite there


@pytest.mark.parametrize(("away", "velocity"), [(10e-6, -0.33), (1e-6, -0.33), (2e-6, -0.1), (0.0, 0.1), (0.0, -0.33)])
def test_a_step_in_which_a_body_bounces_is_that_of_many_short_steps(away, velocity):
    """A spring pulls it away from the stop with 80 times its weight meanwhile."""
    swinging = Mechanics(2.2e-3, 0.0, springs=(Spring(1600.0, 0.0, 1.3e-3),), near_stop=Stop(0.2e-3, 0.4))
    model, short = (replace(solenoid(swinging), sample_time_s=5e-5 / parts) for parts in (1, 200))
    state = short_state = np.array([[0.2e-3 + away, velocity, 0.1]])
    moved = alone(model).transition(state, np.zeros(1))[0]
    shortly = alone(short)
    for _ in range(200):
        short_state = shortly.transition(short_state, np.zeros(1))
    assert moved[0] - 0.2e-3 == pytest.approx(short_state[0, 0] - 0.2e-3, rel=0.01)
    assert moved[1] == pytest.approx(short_state[0, 1], rel=1e-3)  # the parabola's time, of which the force knows


DISTANCE_M = 0.022
PATTERNS_S = (1e-5, 2e-5, 0.1)


def resting(model):
    state = np.zeros(model.order)
    currents = holding_currents(model, DISTANCE_M)
    state[0], state[2 : 2 + len(currents)] = DISTANCE_M, currents
    return state


def with_two_sensors(model):
    return replace(model, other_sensors=(replace(SHUNT, name="shunt"),))


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_filter_at_rest_stays_there_however_fast_the_patterns_are(levitation_model, kind):
    model = with_two_sensors(with_eddies(levitation_model, PATTERNS_S))
    built = kalman_filter(model, kind, sensors=("hall", "shunt"))
    assert built.process.names[3:6] == ("eddy_1_A", "eddy_2_A", "eddy_3_A")
    np.linalg.cholesky(np.stack([built.process.process_covariance, built.process.start_covariance]))
    at = resting(model)
    readings = [float(predict_sensor(model, sensor_named(model, one), at)) for one in ("hall", "shunt")]
    state, volts = built.start(at), model.circuit.resistance_ohm * at[2]
    for _ in range(400):
        state = built.step(state, volts, readings)
    assert not state.outcome.any()
    deviations = np.sqrt(np.diagonal(state.covariance[0]))
    assert (np.abs(state.mean[0, :6] - at) < deviations[:6]).all()
    assert (deviations[3:6] < np.sqrt(np.diag(built.process.start_covariance))[3:6]).all()


@pytest.mark.parametrize("patterns", [1, 9])
def test_sigma_points_lie_as_far_out_as_without_eddy_currents(levitation_model, patterns):
    """Of nine patterns, points sqrt(12) deviations of 1 mm away would lie behind the face that a body is 2 mm off."""
    model, reached = with_two_sensors(levitation_model), []
    for one in (model, with_eddies(model, tuple(np.geomspace(1e-5, 1e-2, patterns)))):
        process = kalman_filter(one, sensors=("hall", "shunt"), hall_bias=False).process

        def transition(states, volts, move=process.transition):
            reached.append(np.ptp(states[:, 0]))
            return move(states, volts)

        vars(process)["transition"] = transition
        filter_ = UnscentedFilter(process)
        assert not filter_.predict(filter_.start(resting(one)), 1.0).outcome.any()
    assert reached[1] == pytest.approx(reached[0], rel=1e-9)


def tracked(model, filter_model, kind):
    """Normalised innovations squared of a filter on a body that nothing moves, while the voltage jumps."""
    held = with_motion(model, mass_kg=1e9, gravity_m_s2=0.0)
    believed = replace(filter_model, motion=held.motion)
    built = kalman_filter(believed, kind, sensors=("hall", "shunt"))
    generator = np.random.default_rng(7)
    noises = [output.variance**0.5 for output in built.process.outputs]
    truth, seen = DISTANCE_M * np.eye(1, model.order)[0], []
    state = built.start(DISTANCE_M * np.eye(1, filter_model.order)[0])
    for k in range(150):
        volts = 2.0 if (k // 50) % 2 else 0.5
        truth = runge_kutta_step(held, truth[None], np.array([volts]), held.sample_time_s, 4)[0]
        exact = [float(predict_sensor(held, sensor_named(held, one), truth)) for one in ("hall", "shunt")]
        state = built.step(state, volts, np.array(exact) + generator.standard_normal(2) * noises)
        seen.append((state.innovation**2 / state.innovation_variance).ravel())
    return float(np.mean(seen)), state, truth


EFFECTS = [
    added("eddy_current_lag", ring_share=0.2, diffusion_share=0.1),
    added("hysteresis", width_medium=0.02),
    added("sensor_delay", delay_s=1e-3),
    added("magnet_demagnetisation", loss=0.03),
    added("viscous_friction", damping_per_s=3.0),
    added("driver_gain", gain_error=0.03),
    added("hall_saturation", cubic_loss=0.02),
]


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
@pytest.mark.parametrize("effects", [(), EFFECTS], ids=["eddy currents", "effects"])
def test_a_filter_that_knows_what_lags_and_errs_is_consistent_and_one_that_does_not_is_not(
    levitation_model, kind, effects
):
    rig = with_two_sensors(levitation_model)
    solid = with_eddies(rig)
    model = with_effects(rig, effects) if effects else replace(solid, eddy=replace(solid.eddy, error=None))
    knowing, state, truth = tracked(model, model, kind)
    # Less than one: the process noise allows for patterns that are off by 1 % of the whole swing, and these are not
    assert 0.3 < knowing < 1.1
    deviations = np.sqrt(np.diagonal(state.covariance[0]))
    assert (np.abs(state.mean[0, : len(truth)] - truth) < 4.0 * deviations[: len(truth)]).all()
    ignorant, *_ = tracked(model, rig, kind)
    assert ignorant > 5.0


@pytest.mark.parametrize("drive", [Drive(diode_V=0.7), Drive("current"), Drive("current", bandwidth_Hz=300.0)])
def test_filters_that_are_told_commands_follow_the_driver(levitation_model, drive):
    """The step's current is the amplifier's target, and none flows backwards through a diode."""
    low = 0.0 if drive.kind == "voltage" else -3.0
    model = with_eddies(with_circuit(levitation_model, voltage_min_V=low, voltage_max_V=30.0, drive=drive))
    process = kalman_filter(model, hall_bias=False, commanded=True).process
    states = np.tile(resting(model), (2, 1))
    states[1, 2:] = [0.0, 0.4, -0.2, 0.1]
    moved = process.transition(states, np.array([0.0, 0.0]) if drive.kind == "voltage" else np.array([0.5, 0.05]))
    if drive.kind == "voltage":
        assert 0.0 < moved[0, 2] < states[0, 2]
        assert moved[1, 2] >= 0.0
    else:
        kept = 0.0 if drive.bandwidth_Hz is None else np.exp(-2.0 * np.pi * 300.0 * model.sample_time_s)
        wanted = np.array([0.5, 0.05]) + kept * (states[:, 2] - [0.5, 0.05])
        np.testing.assert_allclose(moved[:, 2], wanted, rtol=2e-2)  # its voltage is that of a body that has half moved
