"""A prediction in fine steps follows coils and stops, and their Jacobian is that of these steps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import femfit as ff
from femfit.device.sensors import CurrentSensor, PositionSensor
from femfit.filters.error_bound import without_stops
from femfit.filters.fine_steps import in_fine_steps
from femfit.model.dynamics import state_jacobian
from tests.support.halves import cut_in_two
from tests.support.solenoids import solenoid

AT_REST = np.array([[2e-3, 0.0, 0.8]])


def coarse(samples_per_time_constant):
    """A solenoid whose sample is a part of its coil's time constant."""
    model = solenoid()
    inductance = float(model.magnetics.inductance(AT_REST[:, 0], AT_REST[:, 2])[0])
    step = inductance / model.circuit.resistance_ohm / samples_per_time_constant
    shunt = CurrentSensor(name="current", noise=4e-3, circuit="coil")
    return without_stops(replace(model, sample_time_s=step, other_sensors=(shunt,)))


def test_the_jacobian_is_that_of_the_exact_flow():
    model = coarse(1.0 / 0.43)
    process = in_fine_steps(model, ff.kalman_filter(model, sensors=("current",)).process)
    volts = np.full(1, model.circuit.resistance_ohm * 0.8)
    found = process.state_jacobian(AT_REST, volts)[0]
    still = model.sample_time_s * state_jacobian(model, AT_REST, volts)[0]
    assert found[2, 2] == pytest.approx(expm(still)[2, 2], rel=0.02)  # Euler's is 12 % below, 1 - 0.43


@pytest.mark.parametrize("fine", [False, True])
def test_a_coil_faster_than_the_record_is_no_obstacle(fine):
    model = coarse(1.0 / 3.0)
    built = ff.kalman_filter(model, sensors=("current",))
    if fine:
        built = replace(built, process=in_fine_steps(model, built.process))
    state = built.start(AT_REST[0])
    for _ in range(20):
        state = built.step(state, np.full(1, 0.8 * model.circuit.resistance_ohm), np.full(1, 0.8))
    assert state.mean[0, 2] == pytest.approx(0.8, abs=0.01)


def arriving(model, current):
    """One step of a fast body beyond the near stop: as if there were none, and with it."""
    fine, free = in_fine_steps(model, alone(model)), in_fine_steps(without_stops(model), alone(model))
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


def test_a_stop_within_a_step_leaves_the_flux_linkage_as_it_is():
    model = replace(solenoid(), sample_time_s=2e-4)
    (beyond, kept) = arriving(model, 0.6)
    linked = [float(model.magnetics.flux_linkage(one[:, 0], one[:, 2])[0]) for one in (beyond, kept)]
    assert linked[1] == pytest.approx(linked[0], rel=1e-9)
    assert abs(kept[0, 2] - beyond[0, 2]) > 0.01


def test_the_halves_of_a_coil_arrive_at_a_stop_as_the_whole_does():
    model = replace(solenoid(), sample_time_s=2e-4)
    _, whole = arriving(model, 0.6)
    state = np.array([[0.25e-3, -3.0, 0.6, 0.6]])
    halves = in_fine_steps(cut_in_two(model), alone(cut_in_two(model))).transition(state, np.full((1, 2), 0.25))
    np.testing.assert_allclose(halves[0], whole[0, [0, 1, 2, 2]], rtol=1e-9)


def test_a_body_without_a_circuit_arrives_at_a_stop():
    box = replace(solenoid().validity, current_min_A=0.0, current_max_A=0.0)
    _, kept = arriving(replace(solenoid(), circuits=(), validity=box, sample_time_s=2e-4), 0.0)
    assert kept.shape == (1, 2)
