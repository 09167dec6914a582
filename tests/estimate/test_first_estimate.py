"""Records through filters: short ways, eddy currents, several circuits."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor, Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.process import FilterOutcome
from femfit.model.dynamics import runge_kutta_step
from support.eddies import with_eddies
from support.replays import STEP_S, damped, series
from support.solenoids import solenoid

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
        state = runge_kutta_step(model, state, volts[k : k + 1], STEP_S, 4)
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
