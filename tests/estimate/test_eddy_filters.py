"""Filters with eddy currents among their states."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import CurrentSensor, Drive
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import UnscentedFilter, kalman_filter
from femfit.estimate.levitation import levitation_process
from femfit.model.sensors import predict_sensor, sensor_named
from support.eddies import with_eddies
from support.halves import cut_in_two, halves_with_eddies
from support.solenoids import solenoid
from support.steps import between_rigid_stops, runge_kutta_step

DISTANCE_M = 0.022
PATTERNS = [(10e-3, 3e-3, 0.5e-3), (1e-5, 2e-5, 0.1)]


def resting(model, order=None):
    state = np.zeros(model.order if order is None else order)
    currents = holding_currents(model, DISTANCE_M)
    state[0], state[2 : 2 + len(currents)] = DISTANCE_M, currents
    return state


def with_two_sensors(model):
    return replace(model, other_sensors=(CurrentSensor(name="shunt", noise=2e-3, circuit=model.circuit_names[0]),))


@pytest.mark.parametrize("times", PATTERNS)
@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_a_filter_at_rest_stays_there_however_fast_the_patterns_are(levitation_model, kind, times):
    model = with_two_sensors(with_eddies(levitation_model, times))
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
        process = levitation_process(one, sensors=("hall", "shunt"))
        asked = []

        def transition(states, volts, move=process.transition, asked=asked):
            asked.append(np.ptp(states[:, 0]))
            return move(states, volts)

        filter_ = UnscentedFilter(replace(process, transition=transition))
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


@pytest.mark.parametrize("circuits", [1, pytest.param(2, marks=pytest.mark.nightly)])
def test_a_filter_s_step_up_to_a_stop_and_back_is_that_of_runge_and_kutta(circuits):
    """Bodies that meet a stop within the sample, that lie on one, and that are pressed to it; patterns of 20 us.

    The short steps are an eight-hundredth of a sample, each with its own contact.
    """
    base = replace(solenoid(), sample_time_s=2e-4)
    model = with_eddies(base if circuits == 1 else cut_in_two(base), (8e-3, 2e-5))
    states = np.zeros((4, model.order))
    states[:, 0], states[:, 1] = [0.25e-3, 0.2e-3, 3.95e-3, 4e-3], [-1.0, 0.0, 0.8, 0.1]
    states[:, 2:] = [0.4] * circuits + [0.05, -0.02]
    volts = np.full((4, circuits) if circuits > 1 else 4, 3.0)
    found = kalman_filter(with_two_sensors(model), sensors=("shunt",)).process.transition(states, volts)
    wanted = between_rigid_stops(model, states, volts, model.sample_time_s / 800, 800)
    size = np.abs(wanted - states).max(axis=0)
    assert (np.abs(found - wanted)[:, :2] < 2e-3 * size[:2]).all()
    # The way up to the stop and back counts as gone evenly over the sample, in which the fast pattern decays
    assert np.abs(found - wanted)[:, 2:].max() < (0.015 if circuits == 1 else 0.03) * size[2:].max()


@pytest.mark.parametrize("eddies", [(), (8e-3, 2e-4)])
@pytest.mark.parametrize("circuits", [1, 2])
def test_a_diode_has_its_drop_until_its_current_is_zero(circuits, eddies):
    """Where the voltage is exactly nought: against the same windings at the drop, and against short steps."""
    diode = replace(solenoid(drive=Drive(diode_V=0.7)), sample_time_s=1e-4)
    bridge = replace(diode, circuits=(replace(diode.circuit, drive=Drive()),))
    short = replace(diode, sample_time_s=1e-4 / 200)

    def transition(model):
        model = with_eddies(model, eddies) if eddies else model
        model = model if circuits == 1 else halves_with_eddies(model) if eddies else cut_in_two(model)
        return kalman_filter(with_two_sensors(model), sensors=("shunt",)).process.transition

    states = np.zeros((4, 2 + circuits + len(eddies)))
    states[:, 0], states[:, 2 : 2 + circuits] = 2e-3, np.array([[1.0], [2e-3], [1e-9], [0.0]])
    states[:, 2 + circuits :] = -0.02  # holds the flux up as the current falls
    volts = np.zeros((4, circuits) if circuits > 1 else 4)
    found, in_short, moved = transition(diode)(states, volts), states, transition(short)
    np.testing.assert_allclose(found[0], transition(bridge)(states, volts - 0.7 / circuits)[0], rtol=1e-12)
    for _ in range(200):
        in_short = moved(in_short, volts)
    assert (np.abs(found - in_short).max(axis=0) < 0.01 * np.abs(in_short - states).max(axis=0)).all()
    assert (found[:, 2 : 2 + circuits] >= 0.0).all()
    assert found[1:, 2 : 2 + circuits].max() < 1e-9
    np.testing.assert_allclose(found[2], found[3], rtol=1e-6, atol=1e-9)  # as much noise moves nothing


@pytest.mark.parametrize("drive", [Drive(diode_V=0.7), Drive("current"), Drive("current", bandwidth_Hz=300.0)])
def test_filters_that_are_told_commands_follow_the_driver(levitation_model, drive):
    """The step's current is the amplifier's target, and none flows backwards through a diode."""
    low = 0.0 if drive.kind == "voltage" else -3.0
    circuit = replace(levitation_model.circuit, voltage_min_V=low, voltage_max_V=30.0, drive=drive)
    model = with_eddies(replace(levitation_model, circuits=(circuit,)))
    process = levitation_process(model, commanded=True)
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
