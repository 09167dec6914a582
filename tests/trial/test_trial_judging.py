"""Judging: what counts as right, and with what certainty."""

import pytest

from support.trial_study.judge import judge
from support.trial_study.table import trial_table

KEY = {
    "order": {"number": 1, "actuator": "rig", "effects": ["hall_offset"], "level": 1.0, "seed": 1},
    "all_channels": True,
    "effects": [{"name": "hall_offset", "over_noise": {"hall_V": 1.0, "force_N": 0.0}, "along": []}],
    "unseen_floor": {"hall_V": 1e-3, "force_N": 1e-4},
}


def answer(verdict, *classes, channel="hall_V", covariates=()):
    return {
        "verdict": verdict,
        "missing": [{"name": members[0], "class": list(members)} for members in classes],
        "where": {"channel": channel, "covariates": list(covariates)},
        "seconds": 1.0,
    }


def judged(full, **others):
    return judge(KEY, {"full": full, **others})


def test_the_truth_counts_wherever_it_stands_in_a_class():
    found = judged(answer("named", ("external_field", "hall_offset")))
    assert (found.in_class, found.first, found.spurious) == ((True,), False, 0)


def test_a_name_whose_class_has_no_hidden_effect_is_spurious():
    found = judged(answer("named", ("hall_offset",), ("force_gain",)))
    assert (found.first, found.spurious) == (True, 1)


def test_a_misnaming_within_the_truths_class_is_told_from_one_outside():
    full = answer("named", ("hall_offset", "external_field"))
    inside = judged(full, withheld=answer("named", ("external_field",)))
    outside = judged(full, withheld=answer("named", ("force_gain",)))
    assert (inside.confounded, outside.confounded) == (True, False)


def test_a_misfit_that_is_the_same_everywhere_needs_no_covariate():
    assert judged(answer("unexplained")).right_covariate
    assert not judged(answer("unexplained", covariates=["current_A"])).right_covariate
    assert not judged(answer("unexplained", channel="force_N")).right_channel


def test_a_misfit_needs_no_covariate_in_the_channel_where_the_effect_is_even():
    effect = {"name": "current_offset", "over_noise": {"hall_V": 1.0, "voltage_V": 1.0}, "along": ["current_A"]}
    key = KEY | {"effects": [effect | {"even": ["voltage_V"]}]}
    for channel in ("voltage_V", "hall_V"):
        answers = {"full": answer("unexplained", channel=channel)}
        assert judge(key, answers).right_covariate is (channel == "voltage_V")


def test_the_error_on_the_unseen_run_is_taken_over_that_of_a_perfect_model():
    found = judged(answer("unexplained"), unseen_rms={"hall_V": 2e-3, "force_N": 1e-4})
    assert found.unseen_over_floor == pytest.approx((0.5 * (4.0 + 1.0)) ** 0.5)


def test_the_table_says_what_was_missed():
    named = answer("named", ("force_gain",))
    lines = trial_table([judged(named, withheld=named | {"confident": True}), judged(named, withheld=named)])
    by_what = {(line.group, line.what): line for line in lines}
    assert by_what["one effect, all channels", "truth in the class"].met is False
    assert by_what["effect withheld, 1 sigma", "misnamed, and called sure"].met is False
    assert by_what["effect withheld, 1 sigma", "misnamed, and called sure"].value == 0.5
    assert by_what["effect withheld, 1 sigma", "misnamed at all"].value == 1.0
    assert by_what["no effect", "something named"].met is None
    assert "MISSED" in by_what["effect withheld, 1 sigma", "misnamed, and called sure"].text()
