"""The bound; late sensors, pickup coils, fine steps, and eddy currents in a filter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import femfit as ff
from femfit.device.electrics import CurrentSensor, Drive, PositionSensor
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.error_bound import bound_along, error_bound, without_stops
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import UnscentedFilter
from femfit.estimate.noise import FilterNoise
from femfit.model.sensors import predict_sensor, sampled_readings, sensor_named
from support.eddies import with_eddies
from support.readings import LASER
from support.solenoids import REACH_H_M, SHIFT_M, inductance, searched, solenoid
from support.solenoids import STEP_S as PICKUP_STEP_S
from support.steps import runge_kutta_step

AMMETER = CurrentSensor(name="current", noise=2e-3, circuit="coil")
FREE = replace(solenoid().motion, near_stop=None, far_stop=None)


@pytest.fixture(scope="module")
def model():
    return replace(solenoid(FREE), sample_time_s=1e-4, other_sensors=(AMMETER, LASER))


def test_without_current_the_coil_s_current_says_nothing_of_the_distance(model):
    """L(d) i and F(d, i) have no slope in the distance at i = 0: self-sensing is blind at rest without excitation."""
    bound = error_bound(model, sensors=("current",), distances_m=(2e-3,), currents_A=(0.0, 1.0))
    assert bound.observed[:, 0].tolist() == [False, True]
    assert error_bound(model, distances_m=(2e-3,), currents_A=(0.0,)).observed[0, 0]  # the laser needs none


SIGMA_A, STEP_S = 4e-3, 2e-5


SILENT = FilterNoise(acceleration_density=1e-24, voltage_V=1e-9, hall_V=1.0)


@pytest.fixture(scope="module")
def sampled():
    shunt = CurrentSensor(name="current", noise=SIGMA_A, circuit="coil")
    return replace(solenoid(FREE), sample_time_s=STEP_S, other_sensors=(shunt,))


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


def test_the_bound_of_a_stroke_is_the_fisher_information_of_simulated_currents(sampled):
    """d z / d(start) and d(end) / d(start) by differences of whole simulations, with no Jacobian of femfit's."""
    volts = np.full(250, 12.0)
    start, spread = np.array([3.5e-3, 0.0, 0.3]), np.array([1e-3, 0.05, 0.1])
    nominal = moved(start, volts)
    steps = 1e-4 * spread
    slopes = np.stack([(moved(start + h, volts) - moved(start - h, volts)) / (2.0 * k)
                       for k, h in zip(steps, np.diag(steps), strict=True)], axis=-1)  # fmt: skip
    information = np.diag(spread**-2.0) + np.einsum("ka,kb->ab", slopes[:, 2], slopes[:, 2]) / SIGMA_A**2
    end = slopes[-1]
    wanted = np.sqrt(np.diag(end @ np.linalg.inv(information) @ end.T))
    process = kalman_filter(sampled, sensors=("current",), noise=SILENT).process
    found = np.sqrt(np.diag(bound_along(process, nominal, volts)[-1]))
    np.testing.assert_allclose(found, wanted, rtol=0.04)  # h R / L = 0.03 of Euler's step


SHUNT = CurrentSensor(name="shunt", circuit="coil", noise=4e-3)


def of(**fields):
    model = searched(noise=2e-3, **fields)
    return replace(model, other_sensors=(*model.other_sensors, SHUNT, LASER))


def late(delay_s):
    model = of()
    return replace(model, other_sensors=(SHUNT, replace(LASER, delay_s=delay_s)))


def run_of(model, samples=200):
    """States and voltages of a body that goes to and fro, by the filter's own steps."""
    process = ff.kalman_filter(model, sensors=("shunt",)).process
    time = PICKUP_STEP_S * np.arange(samples)
    volts = 10.0 + 6.0 * np.sin(700.0 * time)
    states = [np.array([2.5e-3, 0.0, 0.5])]
    for u in volts[1:]:
        states.append(process.transition(states[-1][None], np.array([u]))[0])
    return np.array(states), volts


@pytest.mark.parametrize("name", ["search", "laser"])
@pytest.mark.parametrize("delay", [0.0, 2.0, 2.25])
def test_predicted_readings_are_those_of_the_samples(name, delay):
    model = of()
    model = replace(
        model, other_sensors=tuple(replace(one, delay_s=delay * PICKUP_STEP_S) for one in model.other_sensors)
    )
    states, volts = run_of(of())
    built = ff.kalman_filter(model, sensors=(name,))
    process = built.process
    at, found = built.start(states[0]).mean, []
    for k, u in enumerate(volts):
        at = at if k == 0 else process.transition(at, np.array([u]))
        found.append(process.measure(process.outputs[0].name, at)[0])
    wanted = sampled_readings(model, sensor_named(model, name), states)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.ptp(wanted))


def test_a_bound_of_readings_at_every_fourth_sample_is_that_of_a_fourth_of_the_information():
    model = late(0.0)
    slow = replace(model, other_sensors=(SHUNT, replace(LASER, sample_time_s=4.0 * PICKUP_STEP_S)))
    rare = replace(model, other_sensors=(SHUNT, replace(LASER, noise=2.0 * LASER.noise)))
    states, volts = run_of(model)
    found, wanted = (bound_along(ff.kalman_filter(m, sensors=("laser",)).process, states, volts) for m in (slow, rare))
    np.testing.assert_allclose(found[-1], wanted[-1], rtol=1e-9)


def alone(model):
    """A process read by a sensor of the distance."""
    laser = PositionSensor(name="laser", noise=1e-6, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    return ff.kalman_filter(replace(model, other_sensors=(laser,)), sensors=("laser",)).process


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


def resting(model, order=None):
    state = np.zeros(model.order if order is None else order)
    currents = holding_currents(model, DISTANCE_M)
    state[0], state[2 : 2 + len(currents)] = DISTANCE_M, currents
    return state


def with_two_sensors(model):
    return replace(model, other_sensors=(CurrentSensor(name="shunt", noise=2e-3, circuit=model.circuit_names[0]),))


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_filter_at_rest_stays_there_however_fast_the_patterns_are(levitation_model, kind):
    model = with_two_sensors(with_eddies(levitation_model, PATTERNS_S))
    built = kalman_filter(model, kind, sensors=("hall", "shunt"))
    assert built.process.names[3:6] == ("eddy_1_A", "eddy_2_A", "eddy_3_A")
    for name in ("process_covariance", "start_covariance"):
        np.linalg.cholesky(getattr(built.process, name))
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
    model = with_two_sensors(levitation_model)
    solid = with_eddies(model, tuple(np.geomspace(1e-5, 1e-2, patterns)))
    reached = []
    for one in (model, solid):
        process = kalman_filter(one, sensors=("hall", "shunt"), hall_bias=False).process
        asked = []

        def transition(states, volts, move=process.transition, asked=asked):
            asked.append(np.ptp(states[:, 0]))
            return move(states, volts)

        vars(process)["transition"] = transition
        filter_ = UnscentedFilter(process)
        moved = filter_.predict(filter_.start(resting(one)), 1.0)
        assert not moved.outcome.any()
        reached += asked
    assert reached[1] == pytest.approx(reached[0], rel=1e-9)


def tracked(model, filter_model, kind, steps=150):
    """Normalised innovations squared of a filter on a body that nothing moves, while the voltage jumps."""
    held = replace(model, motion=replace(model.motion, mass_kg=1e9, gravity_m_s2=0.0))
    believed = replace(filter_model, motion=held.motion)
    built = kalman_filter(believed, kind, sensors=("hall", "shunt"))
    generator = np.random.default_rng(7)
    noises = [output.variance**0.5 for output in built.process.outputs]
    truth, seen = resting(model), []
    truth[2:] = 0.0
    state = built.start(resting(filter_model) * [1.0, 1.0, *[0.0] * (filter_model.order - 2)])
    for k in range(steps):
        volts = 2.0 if (k // 50) % 2 else 0.5
        truth = runge_kutta_step(held, truth[None], np.array([volts]), held.sample_time_s, 4)[0]
        exact = [float(predict_sensor(held, sensor_named(held, one), truth)) for one in ("hall", "shunt")]
        state = built.step(state, volts, np.array(exact) + generator.standard_normal(2) * noises)
        seen.append((state.innovation**2 / state.innovation_variance).ravel())
    return float(np.mean(seen)), state, truth


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_filter_that_knows_the_eddy_currents_is_consistent_and_one_that_does_not_is_not(levitation_model, kind):
    model = with_two_sensors(with_eddies(levitation_model))
    model = replace(model, eddy=replace(model.eddy, error=None))
    knowing, state, truth = tracked(model, model, kind)
    # Less than one: the process noise allows for patterns that are off by 1 % of the whole swing, and these are not
    assert 0.3 < knowing < 1.1
    deviations = np.sqrt(np.diagonal(state.covariance[0]))
    assert (np.abs(state.mean[0, :6] - truth) < 4.0 * deviations[:6]).all()
    ignorant, *_ = tracked(model, replace(model, eddy=None), kind)
    assert ignorant > 5.0


@pytest.mark.parametrize("drive", [Drive(diode_V=0.7), Drive("current"), Drive("current", bandwidth_Hz=300.0)])
def test_filters_that_are_told_commands_follow_the_driver(levitation_model, drive):
    """The step's current is the amplifier's target, and none flows backwards through a diode."""
    low = 0.0 if drive.kind == "voltage" else -3.0
    circuit = replace(levitation_model.circuit, voltage_min_V=low, voltage_max_V=30.0, drive=drive)
    model = with_eddies(replace(levitation_model, circuits=(circuit,)))
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
