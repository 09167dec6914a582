"""Measuring on as advised: a further run of the same device with the same error, and a parameter read directly."""

import numpy as np
import pandas as pd
import pytest

from femfit.identify.experiments.possible import possible_experiments
from femfit.identify.readings.place import placed
from femfit.tables.measurement_file import read_bench_table
from femfit.trial.campaigns import write_campaign
from femfit.trial.device import true_readings
from femfit.trial.hidden import HIDDEN_ERRORS
from femfit.trial.truths.course import acting_only
from femfit.trial.virtual_bench import make_campaign
from support.closed_form_device import closed_form_device
from support.trial_study.advice import Followed, _Bench, _measured_on, advice_lines


@pytest.fixture
def bench(levitation_model, tmp_path):
    """A campaign that hides a force sensor's zero."""
    device, errors = closed_form_device(), {"force_offset": HIDDEN_ERRORS["force_offset"]}
    campaign = make_campaign(device, errors, 3.0, np.random.default_rng(4))
    write_campaign(campaign, tmp_path / "0001", errors, None)
    return _Bench(device, levitation_model, campaign, errors, tmp_path / "0001", np.random.default_rng(1))


def advised(bench, words):
    observations = placed(bench.model, bench.place / "data.csv")
    (found,) = [one for one in possible_experiments(observations, ("force_N",), []) if words in one.text]
    return found


def test_a_further_run_has_the_same_error_and_stands_below_the_others(bench):
    experiment = advised(bench, "once more")
    before, after = pd.read_csv(bench.place / "data.csv"), pd.read_csv(_measured_on(bench, experiment))
    pd.testing.assert_frame_equal(after.iloc[: len(before)], before)
    more = after.iloc[len(before) :]
    assert (more["run"] == before["run"].max() + 1).all()
    assert len(more) == len(experiment.rows)
    assert len(read_bench_table(bench.place / "measured_on.csv").rows) == len(after)


def test_an_error_that_ended_stays_away_and_one_that_lasts_goes_on(bench):
    at, runs = bench.campaign.at, bench.campaign.runs
    clean = true_readings(bench.device, at, {}, {})["force_N"]
    ended = acting_only(bench.errors["force_offset"], (1, max(1, runs - 1)))
    read = true_readings(bench.device, at, bench.campaign.hidden, {"force_offset": ended})["force_N"]
    np.testing.assert_allclose(read[at.run == runs - 1], clean[at.run == runs - 1])
    shift = bench.true(at)["force_N"] - clean
    np.testing.assert_allclose(shift, bench.campaign.hidden["force_offset"])


def test_the_counts_say_what_was_missed():
    kept = Followed(1, ("turns",), "catalogue", ("turns", "remanence"), "Wind.", True, ("turns",), "named")
    lost = Followed(2, ("turns",), "catalogue", ("turns", "remanence"), "Measure.", False, (), "unexplained")
    none = Followed(3, ("turns",), "catalogue", ("turns", "remanence"), "", False)
    lines = advice_lines([kept, lost, none])
    assert lines[0].endswith("3; with advice: 2")
    assert "1 of 2" in lines[1]
    assert [line.split()[0] for line in lines if line.startswith("  ")] == ["0002", "0003"]
