"""Late sensors, pickup coils and fine steps in a filter."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.error_bound import bound_along, without_stops
from femfit.model.sensors import sampled_readings, sensor_named
from support.halves import cut_in_two
from support.one_current import flat
from support.pickups import STEP_S, searched
from support.readings import LASER
from support.solenoids import inductance, solenoid

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
    time = STEP_S * np.arange(samples)
    volts = 10.0 + 6.0 * np.sin(700.0 * time)
    states = [np.array([2.5e-3, 0.0, 0.5])]
    for u in volts[1:]:
        states.append(process.transition(states[-1][None], np.array([u]))[0])
    return np.array(states), volts


def test_a_filter_remembers_one_flux_linkage_of_a_pickup_coil():
    process = ff.kalman_filter(of(), sensors=("search", "shunt")).process
    assert process.names == ("distance_m", "velocity_m_s", "current_A", "search_before_1_Wb")


@pytest.mark.parametrize("name", ["search", "laser"])
@pytest.mark.parametrize("delay", [0.0, 2.0, 2.25])
def test_predicted_readings_are_those_of_the_samples(name, delay):
    model = of()
    model = replace(model, other_sensors=tuple(replace(one, delay_s=delay * STEP_S) for one in model.other_sensors))
    states, volts = run_of(of())
    built = ff.kalman_filter(model, sensors=(name,))
    process = built.process
    at, found = built.start(states[0]).mean, []
    for k, u in enumerate(volts):
        at = at if k == 0 else process.transition(at, np.array([u]))
        found.append(process.outputs[0].measure(at)[0])
    wanted = sampled_readings(model, sensor_named(model, name), states)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.ptp(wanted))


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_filter_follows_a_body_by_a_late_laser_where_a_prompt_one_is_believed_in_vain(kind):
    """The body moves on by more than the laser's noise within the delay."""
    model = late(2.0e-3)
    states, volts = run_of(of())
    noise = np.random.default_rng(7)
    read = sampled_readings(model, sensor_named(model, "laser"), states) + 2e-5 * noise.standard_normal(len(states))
    errors = []
    for told in (model, late(0.0)):
        built = ff.kalman_filter(told, kind, sensors=("laser",))
        state, seen = built.start(states[0]), []
        for k, u in enumerate(volts):
            state = state if k == 0 else built.predict(state, u)
            state = built.update(state, read[k])
            seen.append(state.mean[0, 0])
        errors.append(np.sqrt(np.mean((np.array(seen) - states[:, 0])[50:] ** 2)))
    assert errors[0] < 2e-5
    assert errors[1] > 3.0 * errors[0]


def test_a_bound_of_readings_at_every_fourth_sample_is_that_of_a_fourth_of_the_information():
    model = late(0.0)
    slow = replace(model, other_sensors=(SHUNT, replace(LASER, sample_time_s=4.0 * STEP_S)))
    rare = replace(model, other_sensors=(SHUNT, replace(LASER, noise=2.0 * LASER.noise)))
    states, volts = run_of(model)
    found, wanted = (bound_along(ff.kalman_filter(m, sensors=("laser",)).process, states, volts) for m in (slow, rare))
    np.testing.assert_allclose(found[-1], wanted[-1], rtol=1e-9)


def test_a_pickup_coil_tells_the_distance_that_a_current_alone_tells_less_well():
    model = of()
    states, volts = run_of(model)
    bounds = []
    for names in (("shunt",), ("shunt", "search")):
        built = ff.kalman_filter(model, sensors=names)
        path = built.process.begun(states)
        bounds.append(np.sqrt(bound_along(built.process, path, volts)[-1, 0, 0]))
    assert bounds[1] < bounds[0]


def arriving(model, current):
    """One step of a fast body beyond the near stop: as if there were none, and with it."""
    fine, free = alone(model), alone(model).predicting(model=without_stops(model))
    circuits = len(model.circuits)
    state = np.array([[0.25e-3, -3.0, *(current,) * circuits]])
    volts = np.full((1, circuits) if circuits != 1 else 1, 0.5)
    beyond, kept = free.transition(state, volts), fine.transition(state, volts)
    assert beyond[0, 0] < model.motion.near_stop.distance_m <= kept[0, 0]
    return beyond, kept


def alone(model):
    """A process read by a sensor of the distance."""
    laser = PositionSensor(name="laser", noise=1e-6, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    return ff.kalman_filter(replace(model, other_sensors=(laser,)), sensors=("laser",)).process


def linked(model, state):
    """Flux linkage of one state."""
    return float(flat(model.magnetics).flux_linkage(state[:1], state[2:3])[0])


def test_a_stop_within_a_step_changes_the_flux_linkage_by_nothing_but_the_voltage():
    model = replace(solenoid(), sample_time_s=1e-4)
    (beyond, kept) = arriving(model, 0.6)
    before, after = (linked(model, one) for one in (np.array([0.25e-3, -3.0, 0.6]), kept[0]))
    least, most = ((0.5 - 20.0 * current) * 1e-4 for current in (0.6, kept[0, 2]))  # U - R i, which falls meanwhile
    assert min(least, most) < after - before < max(least, most)
    assert abs(kept[0, 2] - beyond[0, 2]) > 0.01


@pytest.mark.parametrize("velocity", [0.0, -0.02, 0.02])
def test_the_current_of_a_body_pressed_to_its_stop_rises_as_its_inductance_there_says(velocity):
    """A light body that two amperes pull through a tenth of a millimetre in a sample, were there no stop."""
    light = Mechanics(0.5e-3, 0.0, near_stop=Stop(0.2e-3), far_stop=Stop(4e-3))
    model = replace(solenoid(light), sample_time_s=2e-4)
    fine, free = alone(model), alone(model).predicting(model=without_stops(model))
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


def test_the_halves_of_a_coil_arrive_at_a_stop_as_the_whole_does():
    model = replace(solenoid(), sample_time_s=1e-4)
    _, whole = arriving(model, 0.6)
    state = np.array([[0.25e-3, -3.0, 0.6, 0.6]])
    cut = cut_in_two(model)
    assert model.sample_step.count == cut.sample_step.count
    halves = alone(cut).transition(state, np.full((1, 2), 0.25))
    np.testing.assert_allclose(halves[0], whole[0, [0, 1, 2, 2]], rtol=1e-9)


def test_a_body_without_a_circuit_arrives_at_a_stop():
    box = replace(solenoid().validity, current_limits_A=np.zeros((0, 2)))
    _, kept = arriving(replace(solenoid(), circuits=(), validity=box, sample_time_s=2e-4), 0.0)
    assert kept.shape == (1, 2)
