"""A sensor that is read at every few samples: the linear loop's noise and delay against runs and a prompt sensor."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from femfit.core.errors import DomainError
from femfit.device.electrics import PositionSensor
from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment, direct_distance, run_experiments
from femfit.simulation.loop_text import design_lines

PERIOD, NOISE, DISTANCE = 4, 2e-5, 0.026


def design_with(model, noise, period):
    step = model.sample_time_s
    laser = PositionSensor(
        name="laser", noise=noise, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m", sample_time_s=period * step
    )
    return design_loop(replace(model, sensor=None, other_sensors=(laser,), reference_distances_m=(DISTANCE,)))


@pytest.fixture(scope="module")
def slow(levitation_model):
    return design_with(levitation_model, NOISE, PERIOD)


@pytest.fixture(scope="module")
def prompt(levitation_model):
    """Read at each sample, with noise that tells the filter as much."""
    return design_with(levitation_model, NOISE * np.sqrt(PERIOD), 1)


def command_rms(design):
    (result,) = run_experiments(
        design,
        [Experiment("backstepping", "ekf", (DISTANCE,))],
        np.random.default_rng(3),
        runs=16,
        steps=1000,
        supported_steps=300,
    )
    assert result.held.all()
    return result.series.commands[400:, :, 0].std()


def test_the_share_of_noise_grows_with_the_time_between_readings_as_runs_do(slow, prompt):
    one, other = (design.margins("backstepping", "ekf")[0].noise_share for design in (slow, prompt))
    # 16 runs of 0.3 s about a loop of 24 rad/s know their rms to some 5 % each
    assert one / other == pytest.approx(command_rms(slow) / command_rms(prompt), rel=0.15)


def test_noise_that_comes_between_samples_without_a_reading_is_told_as_a_lower_bound(slow, prompt):
    bounds = [any("at least" in line for line in design_lines(one, [("pid", "ekf")])) for one in (slow, prompt)]
    assert bounds == [True, False]


def test_the_age_of_the_readings_is_taken_from_the_delay_margin(slow, prompt):
    """The last of four samples is three samples old, the mean one and a half."""
    one, other = (design.margins("backstepping", "ekf")[0].delay_s for design in (slow, prompt))
    assert other - one == pytest.approx(1.5 * slow.model.sample_time_s, rel=0.02)


def test_the_band_of_the_innovations_counts_the_readings(slow):
    """Two sensors, of which one is read at every fourth of 80 samples: 100 readings of each of three runs."""
    prompt = replace(slow.model.other_sensors[0], name="prompt", sample_time_s=None)
    model = replace(slow.model, other_sensors=(*slow.model.other_sensors, prompt))
    experiment = Experiment("backstepping", "ekf", (DISTANCE,))
    loop = run_loops(
        design_loop(model), experiment, np.random.default_rng(1), runs=3, duration_s=80 * model.sample_time_s
    )
    assert loop.held == 3
    band = chi2.ppf([0.025, 0.975], 300) / 300
    found = loop.innovation_band
    # Wilson and Hilferty's quantiles
    assert (found.lower, found.upper) == pytest.approx(tuple(band), rel=1e-3)
    squared = loop.result.windows[0]
    assert squared.readings.tolist() == [100.0] * 3
    assert loop.normalised_innovation_squared == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 300))


def test_the_direct_measurement_stays_what_the_last_reading_said(slow):
    experiment = Experiment("backstepping", "ekf", (DISTANCE,))
    (result,) = run_experiments(slow, [experiment], np.random.default_rng(5), runs=4, steps=40, supported_steps=300)
    direct = direct_distance(slow, result.series)
    read = result.series.readings[::PERIOD, :, 0]  # The laser says the distance itself
    np.testing.assert_allclose(direct, np.repeat(read, PERIOD, axis=0), rtol=1e-9)


def test_a_sample_time_between_those_of_the_controller_is_refused(levitation_model):
    with pytest.raises(DomainError, match="multiple"):
        design_with(levitation_model, NOISE, 1.5).loop_sensors()


@pytest.mark.parametrize(("times", "period"), [(0.1, 1), (1.0, 1), (3.0, 3)])
def test_a_sensor_is_read_at_whole_samples_and_a_faster_one_at_each(levitation_model, times, period):
    (sensor,) = design_with(levitation_model, NOISE, times).loop_sensors()
    assert sensor.period == period
