"""Records through filters: of several circuits, halves and a bearing; of short ways; and with eddy currents."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.device.electrics import CurrentSensor, Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.found_noise import with_noise
from femfit.estimate.holding import holding_currents
from femfit.estimate.observe import observe
from femfit.estimate.process import FilterOutcome
from femfit.fit.build import fit_model
from femfit.report.motion_figures import replay_figure
from support import replays
from support.bearing import ENTRY, table_of
from support.eddies import magnets_alone, with_eddies
from support.halves import NAMES, cut_in_two
from support.readings import LASER
from support.replays import damped, series
from support.solenoids import solenoid
from support.steps import runge_kutta_step

STEP_S, SAMPLES = 0.5e-3, 400


@pytest.fixture(scope="module")
def whole(levitation_model):
    shunt = CurrentSensor(name="shunt", noise=2e-3, circuit="inner")
    return replace(levitation_model, sensor=None, other_sensors=(LASER, shunt), sample_time_s=STEP_S)


@pytest.fixture(scope="module")
def truth(whole):
    """The body hangs on a weak controller's square wave for a fifth of a second."""
    generator = np.random.default_rng(3)
    states, volts = np.empty((SAMPLES, 3)), np.empty(SAMPLES)
    state = np.array([0.024, 0.0, 0.5])
    for k in range(SAMPLES):
        volts[k] = np.clip(1.6 + 400.0 * (state[0] - 0.024) + 12.0 * state[1] + 0.3 * generator.normal(), 0.5, 3.0)
        states[k] = state
        state = runge_kutta_step(whole, state[None], volts[k : k + 1], STEP_S)[0]
    return states, volts, generator.standard_normal((SAMPLES, 2)) * [2e-5, 2e-3]


def written(path, columns):
    pd.DataFrame({"time_s": STEP_S * np.arange(SAMPLES)} | columns).to_csv(path, index=False)
    return path


@pytest.mark.nightly
def test_the_halves_are_seen_as_the_whole(whole, truth, tmp_path):
    states, volts, noise = truth
    d, i = states[:, 0] + noise[:, 0], states[:, 2] + noise[:, 1]
    one = observe(whole, written(tmp_path / "one.csv", {"voltage_V": volts, "distance_m": d, "current_A": i}))
    halves = {f"voltage_{name}_V": 0.5 * volts for name in NAMES} | {"distance_m": d, "current_inner_A": i}
    two = observe(cut_in_two(whole), written(tmp_path / "two.csv", halves))
    mine, other = two.filters[0], one.filters[0]
    deviation = other.replayed.deviation[-1, 0]
    late = slice(SAMPLES // 2, None)
    # The drivers of the halves err independently, so that a half's current is believed a little less
    assert np.abs(mine.replayed.mean[late, 0] - other.replayed.mean[late, 0]).max() < 0.1 * deviation
    assert mine.trusted
    assert other.trusted
    np.testing.assert_allclose(mine.replayed.mean[late, 3], states[late, 2], atol=0.02)  # a current that nothing reads
    assert {"ukf_current_inner_A", "ukf_current_outer_A"} <= set(two.table.columns)
    assert [each.column for each in mine.beside] == [each.column for each in other.beside[:1]] + ["current_inner_A"]
    assert len(replay_figure(two).axes) == 3
    found = {each.name: each for each in two.noise.estimates}
    assert found["laser"].low < 2e-5 < found["laser"].high
    assert with_noise(cut_in_two(whole), two.noise).process_noise is not None


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
    for one in seen.filters:
        assert one.lost_at_s is None
        assert one.built.process.names[2:] == ("current_lower_A", "current_upper_A")
    found = {one.name: one for one in seen.noise.estimates}
    for name in ("current_lower", "current_upper"):
        assert found[name].low < 2e-3 < found[name].high


def test_a_circuit_is_named_whose_voltage_is_missing_or_commanded_beyond_its_supply(bearing, bearing_record, tmp_path):
    rows = pd.read_csv(bearing_record).drop(columns="voltage_upper_V")
    rows.to_csv(tmp_path / "lacking.csv", index=False)
    with pytest.raises(TableError, match="voltage_upper_V"):
        observe(bearing, tmp_path / "lacking.csv")
    rows = pd.read_csv(bearing_record)
    rows.loc[50:60, "voltage_upper_V"] = 40.0
    rows.to_csv(tmp_path / "beyond.csv", index=False)
    said = [one.text for one in observe(bearing, tmp_path / "beyond.csv", find=False).findings if "beyond" in one.text]
    assert len(said) == 1
    assert "upper" in said[0]


def test_magnets_alone_need_no_voltage(levitation_model, tmp_path):
    model = replace(magnets_alone(levitation_model), other_sensors=(LASER,), sample_time_s=STEP_S)
    generator, state, read = np.random.default_rng(5), np.array([[0.03, 0.0]]), []
    for _ in range(100):
        read.append(state[0, 0] + 2e-5 * generator.normal())
        state = runge_kutta_step(model, state, np.zeros((1, 0)), STEP_S)
    path = tmp_path / "fall.csv"
    pd.DataFrame({"time_s": STEP_S * np.arange(100), "distance_m": read}).to_csv(path, index=False)
    seen = observe(model, path)
    assert seen.filters[0].trusted
    assert seen.noise is None or all(one.name != "voltage" for one in seen.noise.estimates)


NOISE_A, NOISE_M = 4e-3, 1e-6
NEAR, FAR = 0.2e-3, 0.5e-3


@pytest.fixture(scope="module")
def valve():
    """A solenoid with a way of 0.3 mm, whose current a suppressor of 40 V ends."""
    springs = (Spring(2000.0, 1.0, FAR),)
    mechanics = Mechanics(0.008, 0.0, springs=springs, near_stop=Stop(NEAR, 0.2), far_stop=Stop(FAR, 0.2))
    model = solenoid(mechanics, Drive(diode_V=40.0))
    shunt = CurrentSensor(name="current", noise=NOISE_A, circuit="coil")
    box = replace(model.validity, distance_min_m=NEAR, distance_max_m=FAR)
    return replace(model, sample_time_s=5e-5, validity=box, other_sensors=(shunt,))


@pytest.fixture(scope="module")
def record(valve, tmp_path_factory):
    """Two strokes as femfit itself simulates them, with the noises of the sensors."""
    times = [0.0, 2e-3, 25e-3, 45e-3, 65e-3, 80e-3]
    drive = ff.Profile("voltage", times, [0.0, 12.0, 0.0, 12.0, 0.0, 0.0])
    motion = ff.simulate(valve, drive=drive, duration_s=0.08, sample_time_s=valve.sample_time_s)
    rng, table = np.random.default_rng(3), motion.table
    count = len(table["time_s"])
    assert np.ptp(table["distance_m"]) == pytest.approx(FAR - NEAR)
    path = tmp_path_factory.mktemp("valve") / "log.csv"
    columns = {
        "time_s": table["time_s"],
        "voltage_V": np.array([drive.at(time) for time in table["time_s"] + 1e-9]),
        "current_A": table["current_A"] + NOISE_A * rng.standard_normal(count),
        "distance_m": table["distance_m"] + NOISE_M * rng.standard_normal(count),
    }
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def test_a_first_deviation_is_at_most_that_of_a_body_anywhere_on_its_way(valve):
    first = np.sqrt(ff.kalman_filter(valve, sensors=("current",)).process.require_start_covariance()[0, 0])
    assert first == pytest.approx((FAR - NEAR) / 12.0**0.5)


@pytest.mark.nightly
def test_the_current_alone_is_followed_through_strokes_much_shorter_than_a_millimetre(valve, record):
    seen = ff.observe(valve, record, sensors=("current",), find=False)
    one = seen.filters[0]
    assert one.outcome == FilterOutcome.RUNNING
    assert one.innovations[0].mean_square < 1.2
    distance = pd.read_csv(record)["distance_m"].to_numpy()
    assert np.sqrt(np.mean((one.replayed.mean[:, 0] - distance) ** 2)) < 0.25 * (FAR - NEAR)


@pytest.mark.nightly
def test_a_current_that_a_suppressor_ends_is_no_unknown_voltage(valve, record):
    one = ff.observe(valve, record, find=False).filters[0]
    current = next(each for each in one.innovations if each.sensor == "current")
    assert current.mean_square < 1.1


STEPS = 1500


@pytest.fixture(scope="module")
def model():
    return with_eddies(damped(), (4e-3, 3e-4))


@pytest.fixture(scope="module")
def log(model):
    """A coil fed with a square wave; the sensors' noises alone."""
    generator = np.random.default_rng(3)
    volts = 6.0 + 3.0 * np.sign(np.sin(np.arange(STEPS) / 47.0))
    state, rows = np.array([[3.5e-3, 0.0, 0.0, 0.0, 0.0]]), np.empty((STEPS, 5))
    for k in range(STEPS):
        rows[k] = state[0]
        state = runge_kutta_step(model, state, volts[k : k + 1], replays.STEP_S, 4)
    noise = generator.standard_normal((STEPS, 2)) * [4e-3, 2e-5]
    return series(volts, rows[:, 2] + noise[:, 0], rows[:, 0] + noise[:, 1]), rows


@pytest.mark.nightly
def test_a_filter_estimates_the_eddy_currents_and_the_record_shows_its_noise(model, log):
    record, rows = log
    seen = ff.observe(model, record)
    table, late = seen.table, slice(STEPS // 3, None)
    for k, name in enumerate(("distance_m", "velocity_m_s", "current_A", "eddy_1_A", "eddy_2_A")):
        error = np.sqrt(np.mean((table[f"ukf_{name}"].to_numpy()[late] - rows[late, k]) ** 2))
        assert error < 0.1 * np.ptp(rows[late, k]), name
    assert seen.filters[0].replayed.mean.shape[1] >= 5
    found = {one.name: one for one in seen.noise.estimates}
    assert found["voltage"].assumed == pytest.approx(0.1, rel=1e-6)
    for name, wanted in (("current", 4e-3), ("laser", 2e-5)):
        (one,) = [each for key, each in found.items() if key.endswith(name)]
        assert one.value == pytest.approx(wanted, rel=0.1)
