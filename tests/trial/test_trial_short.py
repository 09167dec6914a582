"""The hidden-effect trial itself, with few cases: the whole way from the drawing to the table."""

import csv
import json

import pytest

from support.trial import FAMILIES
from support.trial_study.run import CampaignKind, TrialOptions, make_trial, run_trial, write_cases_csv
from support.trial_study.table import trial_table


@pytest.fixture(scope="module")
def judged(trial_directory, rig_truth):
    options = TrialOptions(cases=10, seed=4, workers=1, withhold=False, kind=CampaignKind(families=FAMILIES))
    commitments = make_trial([trial_directory / "rig.toml"], trial_directory, options)
    return run_trial(trial_directory, commitments, options)


def test_nothing_is_named_where_nothing_is_hidden(judged):
    # 2 % may be named: one of three cases in 6 % of seeds, two in 0.1 %
    clean = [j for j in judged if not j.effects]
    assert len(clean) >= 3
    assert sum(bool(j.named) for j in clean) <= 1


def test_what_is_hidden_is_mostly_found(judged):
    # 97 % of single effects are asked for: fewer than four of five in a handful is no chance
    single = [j for j in judged if len(j.effects) == 1 and j.level >= 1.0]
    assert len(single) >= 3
    assert sum(j.in_class[0] for j in single) >= 0.8 * len(single)


def test_every_case_is_answered_and_listed(judged, trial_directory):
    assert [j.case for j in judged] == list(range(1, 11))
    assert "error" not in {j.verdict for j in judged}
    answers = json.loads((trial_directory / "answers" / "0001.json").read_text())
    assert answers["full"]["verdict"] == judged[0].verdict
    write_cases_csv(judged, trial_directory / "cases.csv")
    with (trial_directory / "cases.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 10
    assert {line.group for line in trial_table(judged)} >= {"no effect", "two effects"}
