"""Records of a bearing with two circuits, of magnets alone, and of a position sensor's volts."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.device.electrics import AccelerationSensor, Drive, PositionSensor
from femfit.device.mechanics import Stop
from femfit.estimate.holding import holding_currents
from femfit.estimate.observe import observe
from femfit.estimate.record import distance_of, with_distance
from femfit.fit.build import fit_model
from femfit.model.sensing import characteristic
from femfit.model.sensors import predict_sensor
from femfit.report.motion_figures import replay_figure
from femfit.tables.measurement import TimeSeries
from femfit.tables.measurement_file import read_measurement
from support.bearing import ENTRY, table_of
from support.eddies import magnets_alone
from support.parts import with_motion
from support.readings import LASER
from support.replays import TRUE, damped, logs
from support.solenoids import solenoid
from support.steps import runge_kutta_step

STEP_S = 0.5e-3


@pytest.fixture(scope="module")
def bearing():
    """Nothing reads its upper current by a sensor of the drawing; the record does."""
    gap = {"kind": "position", "name": "gap", "noise": 1e-7, "distances_m": [0, 1], "readings": [0, 1], "unit": "m"}
    model = fit_model(table_of(entry={**ENTRY, "sensors": [gap]})).model
    bridges = tuple(replace(one, voltage_min_V=-24.0, drive=Drive()) for one in model.circuits)
    return replace(model, circuits=bridges, sample_time_s=1e-4)


@pytest.fixture(scope="module")
def bearing_record(bearing, tmp_path_factory):
    """Held for a hundredth of a second by a differential current, with a bias of 1 A."""
    generator, step = np.random.default_rng(4), 1e-4
    hold = holding_currents(bearing, 0.5e-3, np.array([1.0, 1.0]))
    state, rows = np.array([[0.5e-3, 0.0, *hold]]), []
    for k in range(300):
        wanted = 3e3 * (state[0, 0] - 0.5e-3) + 3.0 * state[0, 1]
        error = hold + np.array([wanted, -wanted]) - state[0, 2:]
        volts = np.clip(bearing.resistances_ohm * hold + 40.0 * error + generator.normal(size=2), -24.0, 24.0)
        read = [state[0, 0] + 1e-7 * generator.normal(), *(state[0, 2:] + 2e-3 * generator.normal(size=2))]
        rows.append([k * step, *volts, *read])
        state = runge_kutta_step(bearing, state, volts[None], step, 2)
    columns = ["time_s", "voltage_lower_V", "voltage_upper_V", "distance_m", "current_lower_A", "current_upper_A"]
    path = tmp_path_factory.mktemp("records") / "bearing.csv"
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    return path


def test_a_bearing_is_followed_by_gap_and_currents(bearing, bearing_record):
    assert observe(bearing, bearing_record, find=False).sensors == ("gap",)  # that of the drawing
    sensors = ("gap", "current_lower", "current_upper")  # those that the record alone has, too
    seen = observe(bearing, bearing_record, filter=("ukf", "ekf"), sensors=sensors)
    assert len(replay_figure(seen).axes) == 3
    for one in seen.filters:
        assert one.lost_at_s is None
        assert one.built.process.names[2:] == ("current_lower_A", "current_upper_A")
    found = {one.name: one for one in seen.noise.estimates}
    for name in ("current_lower", "current_upper"):
        assert found[name].low < 2e-3 < found[name].high


def test_a_circuit_is_named_whose_voltage_is_missing_or_commanded_beyond_its_supply(bearing, bearing_record, tmp_path):
    rows = pd.read_csv(bearing_record)
    rows.drop(columns="voltage_upper_V").to_csv(tmp_path / "lacking.csv", index=False)
    with pytest.raises(TableError, match="voltage_upper_V"):
        observe(bearing, tmp_path / "lacking.csv")
    rows.loc[50:60, "voltage_upper_V"] = 40.0
    rows.to_csv(tmp_path / "beyond.csv", index=False)
    found = observe(bearing, tmp_path / "beyond.csv", find=False).findings
    (said,) = [one.text for one in found if "beyond" in one.text]
    assert "upper" in said


def test_magnets_alone_need_no_voltage(levitation_model, tmp_path):
    model = replace(magnets_alone(levitation_model), other_sensors=(LASER,), sample_time_s=STEP_S)
    model = with_motion(model, far_stop=Stop(0.0445))  # beyond the way of its fall
    generator, state, read = np.random.default_rng(5), np.array([[0.03, 0.0]]), []
    for _ in range(100):
        read.append(state[0, 0] + 2e-5 * generator.normal())
        state = runge_kutta_step(model, state, np.zeros((1, 0)), STEP_S)
    path = tmp_path / "fall.csv"
    pd.DataFrame({"time_s": STEP_S * np.arange(100), "distance_m": read}).to_csv(path, index=False)
    seen = observe(model, path)
    assert seen.filters[0].trusted
    assert seen.noise is None or all(one.name != "voltage" for one in seen.noise.estimates)


PROBE = PositionSensor(name="eddy", distances_m=(0.0, 1.0), readings=(1.0, -2e3 + 1.0), noise=2e3 * TRUE["laser"])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The same record with the distance in metres and as volts of a sensor that falls by 2 V/mm."""
    rows = logs(1500, 1, seed=5)[1][0].rows[["time_s", "voltage_V", "current_A", "distance_m"]].copy()
    path = tmp_path_factory.mktemp("volts")
    rows.to_csv(path / "metres.csv", index=False)
    volts = characteristic(PROBE, rows.pop("distance_m").to_numpy())
    rows.assign(**{"Position [V]": volts}).to_csv(path / "volts.csv", index=False)
    return path


def test_the_distance_is_the_inverse_of_the_characteristic_beyond_its_ends_too():
    curve = PositionSensor(name="gate", distances_m=(1e-3, 2e-3, 4e-3), readings=(5.0, 3.0, 1.0))
    for sensor in (curve, replace(curve, readings=(1.0, 3.0, 5.0))):
        d = np.array([0.5e-3, 1.0e-3, 1.7e-3, 3e-3, 4e-3, 4.5e-3])
        np.testing.assert_allclose(distance_of(sensor, characteristic(sensor, d)), d, rtol=1e-12)


def test_observe_by_volts_is_observe_by_the_distance(recorded):
    model = replace(damped(), other_sensors=(damped().other_sensors[0], PROBE))
    series = read_measurement(recorded / "volts.csv", noise={"position_V": 0.04})
    assert with_distance(model, series).declared_noise["distance_m"] == pytest.approx(2e-5)
    by_volts = observe(model, recorded / "volts.csv", find=False).filters[0]
    by_metres = observe(damped(), recorded / "metres.csv", find=False).filters[0]
    assert "eddy" in [one.sensor for one in by_volts.innovations]
    difference = by_volts.replayed.mean[:, 0] - by_metres.replayed.mean[:, 0]
    assert np.abs(difference).max() < 0.05 * TRUE["laser"]
    assert by_volts.trusted


def placed(sensor, volts, segment=0):
    """Distances from volts of every millisecond."""
    rows = pd.DataFrame({"time_s": 1e-3 * np.arange(len(volts)), "position_V": volts, "segment": segment})
    record = TimeSeries(rows, given=("time_s", "position_V"))
    return with_distance(replace(solenoid(), other_sensors=(sensor,)), record).rows["distance_m"].to_numpy()


def test_a_distance_from_volts_is_of_the_instant_that_the_late_reading_belongs_to():
    gate = PositionSensor(name="gate", distances_m=(0.0, 1.0), readings=(0.0, 1e3), delay_s=2.5e-3)
    true = 1e-3 + 1e-4 * np.arange(20)
    late = characteristic(gate, true - 0.1 * gate.delay_s)
    for segment, unknown in ((0, range(17, 20)), (np.repeat([0, 1], 10), [7, 8, 9, 17, 18, 19])):
        wanted = np.where(np.isin(np.arange(20), unknown), np.nan, true)
        np.testing.assert_allclose(placed(gate, late, segment), wanted, rtol=1e-9)


def test_volts_at_the_rails_and_repeated_readings_tell_no_distance():
    gate = PositionSensor(name="gate", distances_m=(0.0, 1e-2), readings=(0.0, 10.0), minimum=1.0, maximum=9.0)
    np.testing.assert_allclose(placed(gate, [1.0, 2.0, 5.0, 9.0, 8.0]), [np.nan, 2e-3, 5e-3, np.nan, 8e-3])
    found = placed(replace(gate, sample_time_s=3e-3), [2.0, 2.0, 2.0, 4.0, 4.0, 4.0])
    np.testing.assert_allclose(found, [2e-3, np.nan, np.nan, 4e-3, np.nan, np.nan])


def test_an_accelerometer_of_silicon_reads_gravity_at_rest():
    weighing = AccelerationSensor(name="mems", reads_gravity=True)
    assert predict_sensor(
        with_motion(solenoid(), gravity_m_s2=9.81), weighing, np.array([[4e-3, 0.0, 0.0]])
    ) == pytest.approx(-9.81)
