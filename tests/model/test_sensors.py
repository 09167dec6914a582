"""Every sensor of a model reads what its physics says, and the model file keeps it."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError
from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PickupCoil, PositionSensor
from femfit.fit.model_parts import other_sensors_of
from femfit.model.dynamics import state_derivative
from femfit.model.sensors import predict_sensor, reading_of, sensors_of
from support.halves import NAMES
from tests.support.readings import predict_sensors
from tests.support.solenoids import inductance, solenoid

LASER = PositionSensor(name="laser", noise=1e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m", delay_s=1e-3)
SHUNT = CurrentSensor(name="shunt", noise=1e-3, minimum=-2.0, maximum=2.0, bits=8, circuit="coil", gain=0.99)
GATE = PositionSensor(name="gate", distances_m=(1e-3, 2e-3, 4e-3), readings=(5.0, 3.0, 1.0))
ALL = (SHUNT, LASER, GATE, AccelerationSensor(name="mems"), ForceSensor(name="cell"))
PROPER = AccelerationSensor(name="proper", reads_gravity=True)


@pytest.fixture
def model():
    return replace(solenoid(), other_sensors=ALL)


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


def test_a_body_that_a_stop_carries_does_not_accelerate(model):
    resting = np.array([[4e-3, 0.0, 0.0]])  # the spring presses it to the far stop
    assert predict_sensors(model, resting, ("mems",)) == 0.0


def test_a_characteristic_goes_on_with_its_last_slope():
    state = np.array([[0.5e-3, 0.0, 0.0], [5e-3, 0.0, 0.0]])
    np.testing.assert_allclose(predict_sensor(solenoid(), GATE, state), [6.0, 0.0], atol=1e-12)


def test_rounding_adds_to_the_noise_of_a_sample(model):
    step = 4.0 / 256
    assert reading_of(model, "shunt").white == pytest.approx(np.hypot(1e-3, step / np.sqrt(12.0)), rel=1e-12)


def test_an_unknown_sensor_is_refused_with_those_there_are(model):
    with pytest.raises(MissingPartError, match="shunt"):
        predict_sensors(model, np.zeros((1, 3)), ("hall",))


def test_a_drawing_s_sensors_reach_the_model_and_a_pickup_coil_that_was_not_swept_is_said():
    coil = PickupCoil(name="search", vertices_m=((1e-3, 0.0), (2e-3, 0.0), (2e-3, 1e-3)), turns=10.0)
    kept, notes = other_sensors_of({"sensors": [asdict(one) for one in (*ALL, coil)]}, {})
    assert kept == ALL
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
