"""Late sensors, pickup coils and fine steps in a filter."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.error_bound import bound_along, without_stops
from femfit.model.sensors import sampled_readings, sensor_named
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


def test_a_bound_of_readings_at_every_fourth_sample_is_that_of_a_fourth_of_the_information():
    model = late(0.0)
    slow = replace(model, other_sensors=(SHUNT, replace(LASER, sample_time_s=4.0 * STEP_S)))
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
