"""A filter begins within the way of the body, stays between the stops, and knows what a diode does."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor, Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.process import FilterOutcome
from tests.support.solenoids import solenoid

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


def test_the_current_alone_is_followed_through_strokes_much_shorter_than_a_millimetre(valve, record):
    seen = ff.observe(valve, record, sensors=("current",), find=False)
    one = seen.filters[0]
    assert one.outcome == FilterOutcome.RUNNING
    assert one.innovations[0].mean_square < 1.2
    distance = pd.read_csv(record)["distance_m"].to_numpy()
    assert np.sqrt(np.mean((one.replayed.mean[:, 0] - distance) ** 2)) < 0.25 * (FAR - NEAR)


def test_a_current_that_a_suppressor_ends_is_no_unknown_voltage(valve, record):
    one = ff.observe(valve, record, find=False).filters[0]
    current = next(each for each in one.innovations if each.sensor == "current")
    assert current.mean_square < 1.1
