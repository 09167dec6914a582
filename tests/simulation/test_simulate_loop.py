"""Closed loops: what holds, what is lost and under which name."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.model.actuator_model import ValidityBox
from femfit.simulation.design import CONTROLLERS, OBSERVERS, design_loop
from femfit.simulation.experiment import Experiment, direct_distance, run_experiments
from femfit.simulation.monte_carlo import monte_carlo
from femfit.simulation.outcome import LoopOutcome
from femfit.simulation.time_series_csv import COLUMNS, write_time_series

SUPPORT = 300


@pytest.fixture(scope="module")
def design(levitation_model):
    return design_loop(levitation_model)


def run(design, *experiments, runs=4, steps=600, seed=1, **options):
    options = {"supported_steps": SUPPORT, "windows": (slice(steps // 2, steps),), **options}
    return run_experiments(design, experiments, np.random.default_rng(seed), runs=runs, steps=steps, **options)


def test_both_controllers_follow_8_mm_steps_on_every_filter(design):
    filters = [name for name in OBSERVERS if name != "direct"]
    experiments = [Experiment(c, f, design.targets_m) for c in CONTROLLERS for f in filters]
    for result in run(design, *experiments, runs=2, steps=1500):
        assert set(result.outcomes()) == {LoopOutcome.HELD}
        series = result.series
        # an eighth of the step: 5 times the noise of 0.1 mm and the lag of the coil on the way
        assert np.abs(series.distance_m - series.reference_m).max() < 1e-3
        assert np.abs(series.estimated_distance_m - series.distance_m).max() < 3e-4  # 6 sigma at 30 mm, 4 states


def test_the_same_seed_gives_the_same_numbers_and_another_seed_others(design):
    experiment = Experiment("backstepping", "ukf", (0.022,))
    first, second, other = (run(design, experiment, steps=50, seed=s)[0].series.distance_m for s in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert np.all(first[-1] != other[-1])


def test_runs_do_not_depend_on_the_batch_they_are_in(design):
    experiments = [Experiment("backstepping", "ukf", (0.022,)), Experiment("pid", "ekf", (0.030,))]
    together = run(design, *experiments, runs=2, steps=100, noise_blocks=2)
    for experiment, result in zip(experiments, together, strict=True):
        (alone,) = run(design, experiment, runs=2, steps=100)
        np.testing.assert_allclose(result.series.distance_m, alone.series.distance_m, rtol=1e-12)


def test_a_sensor_that_sticks_loses_the_magnet_by_name(design):
    (result,) = run(design, Experiment("backstepping", "ukf", (0.022,), stuck_after_s=0.1), steps=1000)
    assert not result.held.any()
    assert set(result.outcomes()) <= {LoopOutcome.PULLED_IN, LoopOutcome.FELL, LoopOutcome.FILTER_DIVERGED}
    assert np.all(result.outcome_time_s > 0.1)


@pytest.mark.parametrize(("scale", "outcome"), [(1.5, LoopOutcome.PULLED_IN), (0.6, LoopOutcome.FELL)])
def test_a_far_too_strong_or_weak_magnet_is_lost_on_its_side(design, scale, outcome):
    (result,) = run(design, Experiment("pid", "direct", (0.026,), force_scale=scale, noise_V=0.0), supported_steps=0)
    assert set(result.outcomes()) == {outcome}
    lost = int(np.round(result.outcome_time_s[0] / design.model.sample_time_s))
    assert np.isfinite(result.series.distance_m[:lost]).all()
    assert np.isnan(result.series.distance_m[lost:]).all()
    assert np.isnan(result.windows[0].tracking_rms_m).all()  # a lost magnet is never a number


def test_a_diverging_filter_is_named_and_says_what_to_do(design):
    (result,) = run(design, Experiment("backstepping", "ukf", (0.022,), offset_V=0.1))
    assert set(result.outcomes()) == {LoopOutcome.FILTER_DIVERGED}
    assert np.isnan(result.windows[0].estimate_rms_m).all()
    assert "4-state" in LoopOutcome.FILTER_DIVERGED.sentence


def test_a_current_beyond_the_model_is_named(levitation_model):
    # The controller asks for 0.2..1.12 A, but the plant is known up to 0.36 A alone.
    narrow = replace(levitation_model, validity=ValidityBox(0.015, 0.045, 0.0, 0.36), reference_distances_m=(0.022,))
    design = replace(design_loop(levitation_model), model=narrow, targets_m=(0.022,))
    (result,) = run(design, Experiment("pid", "direct", (0.022,)), supported_steps=0)
    assert LoopOutcome.CURRENT_OUT_OF_RANGE in set(result.outcomes())


def test_every_outcome_says_what_happened():
    assert all(outcome.sentence.endswith(".") and len(outcome.sentence) > 30 for outcome in LoopOutcome)


def test_without_noise_the_direct_measurement_is_the_distance(levitation_model):
    free = replace(levitation_model, sensor=replace(levitation_model.sensor, adc_bits=0))
    design = design_loop(free)
    (result,) = run(design, Experiment("pid", "direct", (0.022,), noise_V=0.0), runs=1, steps=200, supported_steps=0)
    np.testing.assert_allclose(direct_distance(design, result.series), result.series.distance_m, atol=1e-8)
    np.testing.assert_allclose(result.series.distance_m, 0.022, atol=1e-7)


def test_monte_carlo_counts_every_run_and_stores_none(design):
    summary, result = monte_carlo(
        design, Experiment("backstepping", "ukf", (0.022,)), np.random.default_rng(0), runs=30, duration_s=0.1
    )
    assert dict(summary.outcomes) == {"HELD": 30}
    assert (summary.runs, summary.steps) == (30, 200)
    assert 0.5e-5 < summary.estimate_rms_m.median < summary.estimate_rms_m.upper < 5e-5
    assert result.series.distance_m.shape == (200, 0)


def test_time_series_are_written_up_to_the_loss(design, tmp_path):
    (result,) = run(design, Experiment("backstepping", "direct", (0.022,)), runs=2, supported_steps=0)
    write_time_series(tmp_path / "loops" / "series.csv", result)
    table = np.genfromtxt(tmp_path / "loops" / "series.csv", delimiter=",", names=True)
    assert table.dtype.names == COLUMNS
    assert len(table) == np.isfinite(result.series.distance_m).sum() < 2 * len(result.time_s)
    first = table[table["run"] == 1]
    np.testing.assert_allclose(first["distance_m"], result.series.distance_m[: len(first), 0], rtol=1e-8)
