"""A record whose distance is known by a position sensor's volts alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.device.electrics import AccelerationSensor, PositionSensor
from femfit.estimate.record import distance_of, with_distance
from femfit.model.sensing import characteristic
from femfit.model.sensors import predict_sensor, reading_of
from femfit.tables.measurement import TimeSeries
from femfit.tables.measurement_file import read_measurement
from support.replays import TRUE, damped, logs
from support.solenoids import solenoid

LASER = PositionSensor(name="eddy", distances_m=(0.0, 1.0), readings=(1.0, -2e3 + 1.0), noise=2e3 * TRUE["laser"])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The same record with the distance in metres and as volts of a sensor that falls by 2 V/mm."""
    series = logs(1500, 1, seed=5)[1][0]
    rows = series.rows[["time_s", "voltage_V", "current_A", "distance_m"]]
    path = tmp_path_factory.mktemp("volts")
    rows.to_csv(path / "metres.csv", index=False)
    volts = rows.drop(columns="distance_m").assign(
        **{"Position [V]": characteristic(LASER, rows["distance_m"].to_numpy())}
    )
    volts.to_csv(path / "volts.csv", index=False)
    return path


def model():
    shunt, _ = damped().other_sensors
    return replace(damped(), other_sensors=(shunt, LASER))


def test_the_distance_is_the_inverse_of_the_characteristic_beyond_its_ends_too():
    curve = PositionSensor(name="gate", distances_m=(1e-3, 2e-3, 4e-3), readings=(5.0, 3.0, 1.0))
    for sensor in (curve, replace(curve, readings=(1.0, 3.0, 5.0))):
        d = np.array([0.5e-3, 1.0e-3, 1.7e-3, 3e-3, 4e-3, 4.5e-3])
        np.testing.assert_allclose(distance_of(sensor, characteristic(sensor, d)), d, rtol=1e-12)


def test_observe_by_volts_is_observe_by_the_distance(recorded):
    by_volts = ff.observe(model(), recorded / "volts.csv", find=False).filters[0]
    by_metres = ff.observe(damped(), recorded / "metres.csv", find=False).filters[0]
    assert "eddy" in [one.sensor for one in by_volts.innovations]
    difference = by_volts.replayed.mean[:, 0] - by_metres.replayed.mean[:, 0]
    assert np.abs(difference).max() < 0.05 * TRUE["laser"]
    assert by_volts.trusted


@pytest.mark.nightly
def test_compare_takes_the_distance_from_the_sensor_and_says_so(recorded):
    compared = ff.compare(model(), read_measurement(recorded / "volts.csv"))
    plain = ff.compare(model(), read_measurement(recorded / "metres.csv"))
    assert any("position_V" in str(one) for one in compared.findings)
    for one, other in zip(compared.channels, plain.channels, strict=True):
        assert one.rms == pytest.approx(other.rms, rel=1e-3)


def test_noise_of_the_volts_is_noise_of_the_distance(recorded):
    series = read_measurement(recorded / "volts.csv", noise={"position_V": 0.04})
    assert with_distance(model(), series).declared_noise["distance_m"] == pytest.approx(2e-5)


def series_of(volts, step_s=1e-3, segment=None):
    rows = pd.DataFrame({"time_s": step_s * np.arange(len(volts)), "position_V": volts})
    rows["segment"] = 0 if segment is None else segment
    return TimeSeries(rows, given=("time_s", "position_V"))


def placed(sensor, series):
    return with_distance(replace(solenoid(), other_sensors=(sensor,)), series).rows["distance_m"].to_numpy()


def test_a_distance_from_volts_is_of_the_instant_that_the_late_reading_belongs_to():
    gate = PositionSensor(name="gate", distances_m=(0.0, 1.0), readings=(0.0, 1e3), delay_s=2.5e-3)
    time = 1e-3 * np.arange(20)
    true = 1e-3 + 0.1 * time
    late = characteristic(gate, true - 0.1 * gate.delay_s)
    np.testing.assert_allclose(placed(gate, series_of(late))[:-3], true[:-3], rtol=1e-9)
    assert np.isnan(placed(gate, series_of(late))[-3:]).all()
    cut = placed(gate, series_of(late, segment=np.repeat([0, 1], 10)))
    assert np.isnan(cut[7:10]).all()
    np.testing.assert_allclose(cut[10:17], true[10:17], rtol=1e-9)


def test_volts_at_the_rails_and_repeated_readings_tell_no_distance():
    gate = PositionSensor(name="gate", distances_m=(0.0, 1e-2), readings=(0.0, 10.0), minimum=1.0, maximum=9.0)
    found = placed(gate, series_of(np.array([1.0, 2.0, 5.0, 9.0, 8.0])))
    np.testing.assert_allclose(found, [np.nan, 2e-3, 5e-3, np.nan, 8e-3])
    slow = replace(gate, sample_time_s=3e-3)
    found = placed(slow, series_of(np.array([2.0, 2.0, 2.0, 4.0, 4.0, 4.0])))
    np.testing.assert_allclose(found, [2e-3, np.nan, np.nan, 4e-3, np.nan, np.nan])


def test_an_accelerometer_of_silicon_reads_gravity_at_rest():
    plain = AccelerationSensor(name="mems")
    weighing = replace(plain, reads_gravity=True)
    base = solenoid()
    hanging = replace(
        base,
        motion=replace(base.motion, gravity_m_s2=9.81),
        other_sensors=(plain,),
    )
    resting, falling = np.array([[4e-3, 0.0, 0.0]]), np.array([[2e-3, 0.0, 0.0]])
    assert predict_sensor(hanging, plain, resting) == 0.0
    assert predict_sensor(hanging, weighing, resting) == pytest.approx(-9.81)
    free = replace(hanging, motion=replace(hanging.motion, springs=(), load_N=0.0))
    assert predict_sensor(free, plain, falling) == pytest.approx(9.81)
    assert predict_sensor(free, weighing, falling) == pytest.approx(0.0, abs=1e-9)  # weightless
    assert reading_of(hanging, "mems").column == "acceleration_m_s2"
