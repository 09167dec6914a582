"""The trial of records over time: from the drawing to the judgement, with a few levitated bodies."""

import json

import pytest
from benchmarks.hidden_effect_trial import series_kind

from femfit.tables.measurement import TimeSeries
from femfit.tables.measurement_file import read_measurement
from support.trial_study.judge import judge
from support.trial_study.run import TrialOptions, make_trial, run_trial

CASES = 4


@pytest.fixture(scope="module")
def directory(trial_directory):
    return trial_directory / "series"


@pytest.fixture(scope="module")
def judged(trial_directory, directory):
    options = TrialOptions(cases=CASES, seed=2, workers=1, withhold=False, kind=series_kind())
    commitments = make_trial([trial_directory / "rig.toml"], directory, options)
    return run_trial(directory, commitments, options)


@pytest.mark.long
def test_every_record_is_answered_and_its_key_names_the_balance_that_shows_it(judged, directory):
    assert len(judged) >= CASES - 1  # an effect that the loop cannot hold is left out
    assert "error" not in {one.verdict for one in judged}
    for one in judged:
        case = directory / "cases" / f"{one.case:04d}"
        assert isinstance(read_measurement(case / "data.csv"), TimeSeries)
        assert isinstance(read_measurement(case / "unseen.csv"), TimeSeries)
        if one.effects:
            assert one.right_channel is not None


@pytest.mark.long
def test_nothing_is_named_in_a_record_of_the_body_as_drawn(judged):
    clean = [one for one in judged if not one.effects]
    assert clean
    assert not any(one.named for one in clean)  # 1 % each


@pytest.mark.long
def test_the_same_seed_records_the_same_samples(trial_directory, directory, judged):
    again = trial_directory / "again"
    (again / "tables").parent.mkdir(exist_ok=True)
    (again / "tables").symlink_to(directory / "tables")
    options = TrialOptions(cases=1, seed=2, workers=1, kind=series_kind())
    make_trial([trial_directory / "rig.toml"], again, options)
    assert (again / "cases/0001/data.csv").read_bytes() == (directory / "cases/0001/data.csv").read_bytes()
    assert json.loads((again / "manifest.json").read_text())["seed"] == 2


def test_a_balance_of_the_key_counts_as_the_right_channel_though_only_sensors_were_recorded():
    key = {
        "order": {"number": 1, "actuator": "rig", "effects": ["viscous_friction"], "level": 3.0, "seed": 1},
        "all_channels": False,
        "effects": [
            {
                "name": "viscous_friction", "over_noise": {"distance_m": 3.0, "current_A": 0.4},
                "channels": ["force_balance_N"], "along": ["velocity_m_s"],
            }
        ],
        "unseen_floor": {},
    }  # fmt: skip
    full = {
        "verdict": "named",
        "missing": [{"name": "coulomb_friction", "class": ["coulomb_friction", "viscous_friction"]}],
        "where": {"channel": "force_balance_N", "covariates": ["velocity_m_s", "distance_m"]},
        "seconds": 1.0,
    }
    found = judge(key, {"full": full})
    assert (found.right_channel, found.right_covariate) == (True, True)
    assert (found.in_class, found.first, found.spurious) == ((True,), False, 0)
    assert found.unseen_over_floor is None
    elsewhere = judge(key, {"full": full | {"where": {"channel": "hall_V", "covariates": ["distance_m"]}}})
    assert (elsewhere.right_channel, elsewhere.right_covariate) == (False, False)
