"""Measuring on as advised: a further run of the same device with the same error, and a parameter read directly."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest
from benchmarks.advice import Followed, _Bench, _measured_on, advice_lines

from femfit.identify.bench import placed
from femfit.identify.plan import possible_experiments
from femfit.tables.measurement_file import read_bench_table
from femfit.trial.device import Conditions, true_readings
from femfit.trial.hidden import HIDDEN_ERRORS
from femfit.trial.virtual_bench import make_campaign
from support.closed_form_device import closed_form_device
from support.trial.campaigns import Habits, SetCampaign
from support.trial.sets import TruthSet
from support.trial.truth import acting_only, always


def bench_with(error, model, directory):
    """A campaign that hides a force sensor's zero."""
    device, errors = closed_form_device(), {"force_offset": error}
    campaign = make_campaign(device, errors, 3.0, np.random.default_rng(4))
    measured = SetCampaign(1, campaign, errors, TruthSet("final", {"force_offset": always(error)}), Habits())
    measured.write(directory)
    return _Bench(device, model, measured, directory, np.random.default_rng(1))


@pytest.fixture
def bench(levitation_model, tmp_path):
    return bench_with(HIDDEN_ERRORS["force_offset"], levitation_model, tmp_path / "0001")


def advised(bench, words):
    observations = placed(bench.model, bench.directory / "data.csv")
    experiments = possible_experiments(observations, ("force_N",), [])
    (experiment,) = [experiment for experiment in experiments if words in experiment.text]
    return experiment


def test_a_further_run_has_the_same_error_and_stands_below_the_others(bench):
    experiment = advised(bench, "once more")
    before, after = pd.read_csv(bench.directory / "data.csv"), pd.read_csv(_measured_on(bench, experiment))
    pd.testing.assert_frame_equal(after.iloc[: len(before)], before)
    more = after.iloc[len(before) :]
    assert (more["run"] == before["run"].max() + 1).all()
    assert len(more) == len(experiment.rows)
    assert len(read_bench_table(bench.directory / "measured_on.csv").rows) == len(after)


@pytest.mark.parametrize("ended", [True, False])
def test_an_error_that_ended_stays_away_and_one_that_lasts_goes_on(ended, levitation_model, tmp_path):
    error = acting_only(HIDDEN_ERRORS["force_offset"], lambda runs: (1, 1) if ended else (2, runs))
    bench = bench_with(error, levitation_model, tmp_path)
    campaign = bench.measured.campaign
    settings = campaign.conditions
    further = replace(settings, run=np.full_like(settings.run, campaign.runs))
    joined = Conditions(
        *(np.concatenate([getattr(settings, f.name), getattr(further, f.name)]) for f in fields(settings))
    )
    shift = bench.true(joined)["force_N"] - true_readings(bench.device, joined, {}, {})["force_N"]
    expected = np.where(joined.run == 0, ended, (joined.run > 0) & (not ended)) * campaign.hidden["force_offset"]
    np.testing.assert_allclose(shift, expected, atol=1e-15)


def test_the_counts_say_what_was_missed():
    smaller = Followed(1, ("turns",), "catalogue", ("turns", "remanence"), "Wind.", True, ("turns",), "named")
    lost = Followed(2, ("turns",), "catalogue", ("turns", "remanence"), "Measure.", False, (), "unexplained")
    none = Followed(3, ("turns",), "catalogue", ("turns", "remanence"), "", False)
    lines = advice_lines([smaller, lost, none])
    assert lines[0].endswith("3; with advice: 2")
    assert "1 of 2" in lines[1]
    assert [line.split()[0] for line in lines if line.startswith("  ")] == ["0002", "0003"]
