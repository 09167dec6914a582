"""Sensors of a model read what an effect has recorded: the effect's closed form undone."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.device.electrics import CurrentSensor, ForceSensor, PositionSensor
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import recorded_setting, true_setting
from femfit.estimate.kalman_filter import kalman_filter
from femfit.model.sensed_effects import true_setting_of
from femfit.model.sensors import predict_sensor
from femfit.model.with_effects import nominal_of, with_effects
from support.added_effects import added
from support.halves import cut_in_two
from support.one_current import flat
from support.solenoids import solenoid

LASER = PositionSensor(name="laser", noise=1e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
SHUNT = CurrentSensor(name="shunt", noise=1e-3, circuit="coil", gain=2.0)
CELL = ForceSensor(name="cell", noise=1e-3)
STATES = np.array([[2e-3, 0.1, 0.5], [3e-3, -0.2, 1.0]])
OF_THE_BENCH = [name for name, effect in all_effects().items() if effect.setting is not None]


def with_(*effects):
    return with_effects(replace(solenoid(), other_sensors=(SHUNT, LASER, CELL)), effects)


def test_a_zero_and_a_scale_of_the_ammeter_are_read():
    model = with_(added("current_gain", gain_error=0.25), added("current_offset", offset=0.01))
    peak = model.conditions.nominal.peak_current_A
    read = predict_sensor(model, SHUNT, STATES)
    np.testing.assert_allclose(read, 2.0 * (STATES[:, 2] - 0.01 * peak) / 1.25, rtol=1e-9)


def test_a_late_and_displaced_laser_is_read():
    model = with_(added("distance_offset", offset_m=1e-4), added("position_delay", delay_s=2e-3))
    read = predict_sensor(model, LASER, STATES)
    np.testing.assert_allclose(read, STATES[:, 0] - 2e-3 * STATES[:, 1] - 1e-4, rtol=1e-9)


def test_a_force_sensor_reads_its_gain_and_zero():
    model = with_(added("force_gain", gain_error=0.1), added("force_offset", offset=0.02))
    force = flat(model.magnetics).force(STATES[:, 0], STATES[:, 2])
    expected = 1.1 * force + 0.02 * model.conditions.nominal.force_N
    np.testing.assert_allclose(predict_sensor(model, CELL, STATES), expected, rtol=1e-12)


@pytest.mark.parametrize("name", OF_THE_BENCH)
def test_what_is_recorded_leads_back_to_the_truth(name):
    effect = effect_by_name(name)
    one = AddedEffect(effect, {p.name: p.plausible[1] for p in effect.parameters})
    conditions = Conditions(nominal_of(solenoid()), velocity_m_s=STATES[:, 1])
    with building():
        x = SX.sym("x", 3)
        read = recorded_setting([one], x[0], x[2], replace(conditions, velocity_m_s=x[1]))
        function = GraphFunction([x], ca.vertcat(*read))
    distance, current = function(STATES.T)
    assert np.abs([distance - STATES[:, 0], current - STATES[:, 2]]).max() > 1e-6
    again = true_setting([one], distance, current[:, None], conditions)
    np.testing.assert_allclose(again[0], STATES[:, 0], rtol=1e-9)
    np.testing.assert_allclose(again[1][:, 0], STATES[:, 2], rtol=1e-9)


def test_the_extended_filter_sees_the_slope_of_an_ammeter_that_reads_too_little():
    process = kalman_filter(with_(added("current_gain", gain_error=0.25)), "ekf", sensors=("shunt",)).process
    slope = process.output_jacobian(STATES, process.outputs[0])
    np.testing.assert_allclose(slope, [[0.0, 0.0, 1.6]] * 2, atol=1e-6)  # of a central difference


def test_of_several_circuits_each_ammeter_reads_its_own_error(levitation_model):
    halves = cut_in_two(levitation_model)
    names = halves.circuit_names
    model = with_effects(halves, [added(f"current_gain:{names[1]}", gain_error=0.25)])
    state = np.array([[0.022, 0.0, 0.4, 0.6]])
    read = [predict_sensor(model, CurrentSensor(name=name, circuit=name), state)[0] for name in names]
    np.testing.assert_allclose(read, [0.4, 0.48], rtol=1e-9)
    distance, currents = true_setting_of(model, state[:, 0], np.array([read]))
    np.testing.assert_allclose(np.append(distance, currents), [0.022, 0.4, 0.6], rtol=1e-9)
