"""Every sensor of a model reads what its physics says, and the model file keeps it."""

from dataclasses import asdict, replace

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.core.errors import MissingPartError
from femfit.core.graph import GraphFunction, building
from femfit.device.electrics import CurrentSensor, ForceSensor, PickupCoil, PositionSensor
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import recorded_setting, true_setting
from femfit.fit.build import fit_model
from femfit.fit.model_parts import other_sensors_of
from femfit.model.dynamics import state_derivative
from femfit.model.sensors import predict_sensor, reading_of, sample_weights, sampled_value, sensors_of
from femfit.model.with_effects import nominal_of, true_setting_of, with_effects
from support.added_effects import added
from support.bearing import hall_field, table_with_hall
from support.halves import NAMES, cut_in_two
from support.one_current import flat
from support.readings import EVERY_SENSOR, predict_sensors
from support.solenoids import SHARE, STEP_S, inductance, searched, solenoid

*ALL, PROPER = EVERY_SENSOR
SHUNT, LASER, GATE, _, _ = ALL


@pytest.fixture
def model():
    return replace(solenoid(), other_sensors=tuple(ALL))


def test_readings_are_those_of_the_closed_forms(model):
    states = np.array([[2e-3, 0.1, 0.5], [3e-3, -0.2, 1.0]])
    d, _, i = states.T
    read = predict_sensors(model, states)
    assert list(sensors_of(model)) == ["shunt", "laser", "gate", "mems", "cell"]
    np.testing.assert_allclose(read[:, 0], 0.99 * i, rtol=1e-12)
    np.testing.assert_allclose(read[:, 1], d, rtol=1e-12)  # its delay is the samples' affair
    np.testing.assert_allclose(read[:, 2], [3.0, 2.0], rtol=1e-12)
    slope = (inductance(d + 1e-7) - inductance(d - 1e-7)) / 2e-7
    force = -0.5 * slope * i**2
    np.testing.assert_allclose(read[:, 4], force, rtol=1e-5)  # the spline holds W' to rounding, its slope to 1e-6
    np.testing.assert_allclose(read[:, 3], (0.1 - 200.0 * (d - 4e-3) - force) / 0.025, rtol=1e-5)
    np.testing.assert_allclose(read[:, 3], state_derivative(model, states, np.zeros(2))[:, 1], rtol=1e-12)


def test_rounding_is_noise_a_stop_lets_no_body_accelerate_and_a_characteristic_keeps_its_last_slope(model):
    step = 4.0 / 256
    assert reading_of(model, "shunt").white == pytest.approx(np.hypot(1e-3, step / np.sqrt(12.0)), rel=1e-12)
    resting = np.array([[4e-3, 0.0, 0.0]])  # the spring presses it to the far stop
    assert predict_sensors(model, resting, ("mems",)) == 0.0
    state = np.array([[0.5e-3, 0.0, 0.0], [5e-3, 0.0, 0.0]])
    np.testing.assert_allclose(predict_sensor(solenoid(), GATE, state), [6.0, 0.0], atol=1e-12)


def test_an_unknown_sensor_is_refused_with_those_there_are(model):
    with pytest.raises(MissingPartError, match="shunt"):
        predict_sensors(model, np.zeros((1, 3)), ("hall",))


def test_a_drawing_s_sensors_reach_the_model_and_a_pickup_coil_that_was_not_swept_is_said():
    coil = PickupCoil(name="search", vertices_m=((1e-3, 0.0), (2e-3, 0.0), (2e-3, 1e-3)), turns=10.0)
    kept, notes = other_sensors_of({"sensors": [asdict(one) for one in (*ALL, coil)]}, {})
    assert list(kept) == ALL
    assert len(notes) == 1
    assert "search" in notes[0]


def test_a_column_of_a_record_belongs_to_one_sensor_at_most(model):
    twins = {
        "distance_m": replace(LASER, name="second"),
        "force_N": ForceSensor(name="second"),
        "acceleration_m_s2": PROPER,
        "current_A": replace(SHUNT, name="second"),
        "position_V": replace(GATE, name="second"),
    }
    for column, twin in twins.items():
        both = replace(model, other_sensors=(*ALL, twin))
        assert column in {reading_of(model, one.name).column for one in ALL}
        assert column not in {reading_of(both, one.name).column for one in both.other_sensors}


def test_a_current_sensor_reads_the_circuit_that_it_names(model_kind):
    halves = model_kind("halves")
    model = replace(halves, other_sensors=tuple(CurrentSensor(name=f"shunt_{name}", circuit=name) for name in NAMES))
    assert predict_sensors(model, np.array([0.02, 0.0, 0.3, 0.7])).tolist() == [0.3, 0.7]
    assert [reading_of(model, f"shunt_{name}").column for name in NAMES] == ["current_inner_A", "current_outer_A"]
    lost = replace(halves, other_sensors=(CurrentSensor(name="shunt", circuit="middle"),))
    with pytest.raises(MissingPartError, match="inner, outer"):
        predict_sensors(lost, np.array([0.02, 0.0, 0.3, 0.7]))


@pytest.fixture(scope="module")
def searching():
    return searched(noise=1e-3)


def coil(model):
    return model.other_sensors[-1]


def test_the_voltage_is_the_windings_share_of_what_its_resistance_leaves(searching):
    """u = share d(L i)/dt = share (U - R i), whatever the body does."""
    states = np.array([[2e-3, 0.1, 0.5], [3e-3, -0.2, 1.0], [1e-3, 0.0, 0.2]])
    volts = np.array([12.0, -3.0, 0.0])
    found = predict_sensor(searching, coil(searching), states, voltage=volts)
    np.testing.assert_allclose(found, SHARE * (volts - 20.0 * states[:, 2]), rtol=1e-4)  # of the fitted splines


def test_a_late_reading_lies_between_two_samples_and_a_pickup_coil_reads_their_difference(searching):
    laser = PositionSensor(name="laser", distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m", delay_s=2.25e-4)
    np.testing.assert_allclose(sample_weights(laser, 1e-4), [0.0, 0.0, 0.75, 0.25], atol=1e-9)
    np.testing.assert_allclose(sample_weights(replace(laser, delay_s=3e-4), 1e-4), [0.0, 0.0, 0.0, 1.0])
    assert sample_weights(replace(laser, delay_s=0.0), 1e-4).tolist() == [1.0]
    late = replace(coil(searching), delay_s=STEP_S)
    np.testing.assert_allclose(sample_weights(late, STEP_S) * STEP_S, [0.0, 1.0, -1.0], atol=1e-12)


DOUBLING = CurrentSensor(name="shunt", noise=1e-3, circuit="coil", gain=2.0)
CELL = ForceSensor(name="cell", noise=1e-3)
STATES = np.array([[2e-3, 0.1, 0.5], [3e-3, -0.2, 1.0]])
OF_THE_BENCH = [name for name, effect in all_effects().items() if effect.setting is not None]


def with_(*effects):
    return with_effects(replace(solenoid(), other_sensors=(DOUBLING, LASER, CELL)), effects)


def test_what_effects_of_the_bench_record_is_read_in_closed_form():
    model = with_(added("current_gain", gain_error=0.25), added("current_offset", offset=0.01))
    peak = model.conditions.nominal.peak_current_A
    read = predict_sensor(model, DOUBLING, STATES)
    np.testing.assert_allclose(read, 2.0 * (STATES[:, 2] - 0.01 * peak) / 1.25, rtol=1e-9)
    model = with_(added("distance_offset", offset_m=1e-4), added("position_delay", delay_s=2e-3))
    read = predict_sensor(model, LASER, STATES)
    np.testing.assert_allclose(read, STATES[:, 0] - 2e-3 * STATES[:, 1] - 1e-4, rtol=1e-9)
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


def test_of_several_circuits_each_ammeter_reads_its_own_error(levitation_model):
    halves = cut_in_two(levitation_model)
    names = halves.circuit_names
    model = with_effects(halves, [added(f"current_gain:{names[1]}", gain_error=0.25)])
    state = np.array([[0.022, 0.0, 0.4, 0.6]])
    read = [predict_sensor(model, CurrentSensor(name=name, circuit=name), state)[0] for name in names]
    np.testing.assert_allclose(read, [0.4, 0.48], rtol=1e-9)
    distance, currents = true_setting_of(model, state[:, 0], np.array([read]))
    np.testing.assert_allclose(np.append(distance, currents), [0.022, 0.4, 0.6], rtol=1e-9)


D, AMPERES = np.array([2e-3, 3e-3]), np.array([[0.5], [1.0]])
GAP, CURRENTS = np.array([0.3e-3, 0.6e-3]), np.array([[0.7, -0.4], [-1.0, 0.5]])


def linked(model):
    return sampled_value(model, coil(model), np.column_stack([D, 0.0 * D, AMPERES]))


def test_a_pickup_coil_is_linked_by_the_true_number_of_turns_of_the_winding():
    model = searched()
    fewer = with_effects(model, [added("turns", turns_error=-0.1)])
    # The winding itself takes the factor twice, by its current and by its own turns
    np.testing.assert_allclose(linked(fewer) / linked(model), 0.9, rtol=1e-9)
    flux = fewer.magnetics.flux_linkage(D, AMPERES) / model.magnetics.flux_linkage(D, AMPERES)
    np.testing.assert_allclose(flux, 0.81, rtol=1e-6)
    np.testing.assert_allclose(linked(model), SHARE * model.magnetics.flux_linkage(D, AMPERES)[:, 0], rtol=1e-3)


def test_turns_and_remanence_scale_a_hall_elements_field_of_several_circuits():
    model = fit_model(table_with_hall()).model
    circuits = [added("turns:upper", turns_error=0.2), added("remanence", remanence_error=-0.1)]
    changed = with_effects(model, circuits)
    idle = hall_field(GAP, np.zeros((2, 2)))
    expected = 0.9 * idle + hall_field(GAP, CURRENTS * [1.0, 1.2]) - idle
    np.testing.assert_allclose(changed.sensor.field.field(GAP, CURRENTS), expected, rtol=1e-9)
    assert changed.without_effects.sensor is model.sensor


def test_an_effect_that_is_not_followed_to_a_pickup_coil_is_named_when_the_coil_is_read():
    model = with_effects(searched(), [added("core_saturation", mmf_loss_3=0.1)])
    assert model.magnetics.force(D, AMPERES).shape == (2,)
    with pytest.raises(MissingPartError, match=r"pickup coil 'search'.*core_saturation"):
        linked(model)
