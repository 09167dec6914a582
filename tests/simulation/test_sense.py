"""Self-sensing in simulation: the filter is as good as its bound, and tells nothing where it must not."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import femfit as ff
from femfit.core.errors import FilterError, UsageError
from femfit.device.electrics import CurrentSensor
from femfit.simulation.sense import MOVES
from support.command import worked
from support.readings import LASER
from support.solenoids import solenoid

RUNS = 100


@pytest.fixture(scope="module")
def model():
    shunt = CurrentSensor(name="current", noise=4e-3, circuit="coil")
    return replace(solenoid(), sample_time_s=1e-4, other_sensors=(shunt,))


@pytest.fixture(scope="module")
def found(model):
    return ff.sense(model, runs=RUNS)


def test_before_the_command_the_filter_knows_no_more_than_before(found):
    before = found.time_s < 0.02
    assert found.rms_m[before].min() > 0.3e-3  # of 1 mm, half of which the stop cuts off


def test_in_the_middle_of_the_stroke_the_error_is_near_the_bound_and_as_claimed(found):
    middle = (found.distance_m > 0.8e-3) & (found.distance_m < 3e-3)
    error, bound, claimed = (
        np.sqrt(np.mean(one[middle] ** 2)) for one in (found.rms_m, found.bound_m, found.claimed_m)
    )
    # An error of the distance lasts through a run: as many independent ones as runs; 0.1 % of such sets are outside
    low, high = np.sqrt(chi2.ppf([1e-3, 1.0 - 1e-3], RUNS) / RUNS)
    assert low < error / bound < high
    assert low < error / claimed < high


def test_a_test_voltage_lets_the_filter_see_at_rest(model, found):
    tested = ff.sense(model, test_voltage_V=4.0, runs=40)
    rest = (tested.time_s > 0.015) & (tested.time_s < 0.02)
    assert np.sqrt(np.mean(tested.rms_m[rest] ** 2)) < 0.5 * np.sqrt(np.mean(found.rms_m[rest] ** 2))


def test_the_command_writes_numbers_and_picture(model, tmp_path):
    ff.write_model(model, tmp_path / "model.json")
    done = worked(
        "sense", tmp_path / "model.json", "--voltage", 9, "--test-voltage", 2, "--runs", 3,
        "--picture", tmp_path / "sense.png", "--csv", tmp_path / "sense.csv", "--json", tmp_path / "sense.json",
    )  # fmt: skip
    assert MOVES in done.stdout
    for name in ("sense.png", "sense.csv"):
        assert (tmp_path / name).stat().st_size > 1000
    assert set(json.loads((tmp_path / "sense.json").read_text())["errors"]) >= {MOVES}


@pytest.mark.parametrize(
    ("error", "words", "options"),
    [
        (UsageError, "voltage_V", {"drive": ff.Profile("voltage", [0.0, 0.1], [12.0, 0.0]), "voltage_V": 3.0}),
        (FilterError, "sampling rate", {"test_voltage_V": 1.0, "test_frequency_Hz": 6e3}),
    ],
)
def test_two_commands_and_a_frequency_beyond_half_of_the_sampling_rate_are_refused(model, error, words, options):
    with pytest.raises(error, match=words):
        ff.sense(model, **options)


def test_the_current_is_read_by_the_sensor_of_that_kind_whatever_its_name(model):
    shunt = CurrentSensor(name="shunt", noise=4e-3, circuit="coil")
    assert ff.sense(replace(model, other_sensors=(shunt,)), runs=1).sensors == ("shunt",)


def test_what_a_filter_remembers_of_a_late_sensor_begins_where_the_body_was(model):
    laser = replace(LASER, noise=1e-5, delay_s=0.5e-4)
    found = ff.sense(replace(model, other_sensors=(laser,)), sensors=("laser",), runs=100)
    # Half of the reading is what was remembered; a first estimate off by 1 mm must not make it more wrong
    assert found.rms_m[0] < found.claimed_m[0] < 1e-3


@pytest.mark.nightly
def test_a_slow_sensor_is_not_read_between_its_readings(model):
    laser = replace(LASER, noise=5e-5)
    slow = replace(laser, sample_time_s=20.0 * model.sample_time_s)
    prompt, seldom = (
        ff.sense(replace(model, other_sensors=(one,)), sensors=("laser",), runs=40).errors[MOVES]
        for one in (laser, slow)
    )
    assert seldom[0] > 0.9 * seldom[2]  # the bound, of one reading in 20; 40 runs of one error each vary by 11 %
    assert seldom[0] > 2.0 * prompt[0]
