"""What is judged right in a trial, and what is counted."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

import femfit as ff
from femfit.trial.campaigns import diagnose_campaigns
from femfit.trial.counts import Share, counts, judge, trial_lines

KEY = {"level": 1.0, "hidden": {"hall_offset": 0.1}, "over_noise": {"hall_offset": {"hall_V": 1.0, "force_N": 0.0}}}


def answer(*classes, channel="hall_V", certain=False, ranking=(), when=None, tied=1):
    every = [{"name": m[0], "class": list(m), "tie": list(m[:tied]), "when": when} for m in classes]
    return {
        "verdict": "named" if classes else "unexplained",
        "missing": every,
        "where": {"channel": channel},
        "confident": certain,
        "ranking": [{"name": name} for name in ranking],
    }


def shares(outcomes):
    return {(count.group, count.outcome): count.share for count in counts(outcomes)}


def test_the_truth_counts_wherever_it_stands_in_a_class():
    names = ("external_field", "hall_offset"), ("force_gain",)
    outcome = judge(1, KEY, answer(*names))
    assert (outcome.found, outcome.named_first, outcome.spurious) == ((True,), False, 1)
    assert judge(1, KEY, answer(*names, tied=2)).named_first  # what data cannot tell apart is one


def test_a_name_is_alone_where_no_other_gives_the_same_readings():
    outcomes = [judge(k, KEY, answer(names, certain=k == 1)) for k, names in enumerate([("hall_offset",)] * 2)]
    outcomes.append(judge(2, KEY, answer(("hall_offset", "external_field"))))
    assert shares(outcomes)["One error hidden, named alone in its class", "it was called certain"] == Share(1, 2)


def test_what_was_called_certain_and_wrong_is_counted_and_of_a_clean_campaign_any_name_is_wrong():
    clean = KEY | {"level": 0.0, "hidden": {}, "over_noise": {}}
    for key, group in ((KEY, "One error hidden"), (clean, "All campaigns")):
        outcome = judge(1, key, answer(("force_gain",), certain=True))
        assert shares([outcome])[group, "a wrong name was called certain"] == Share(1, 1)
        assert any("hall_offset" in line and "0/1" in line for line in trial_lines([outcome])) is (key is KEY)


def test_a_number_of_the_drawing_is_right_by_any_of_its_key_paths():
    name = "drawing:core.z_mm[1] (final)"
    key = KEY | {"hidden": {name: 0.1}, "right": {name: ["core.z_mm[1]", "coil.z_mm[0]"]}, "group": {name: "drawing"}}
    curve = key | {"right": {name: ["materials.steel.B_T"]}}
    for of, names, right in (
        (key, ("coil.z_mm[0]", "core.z_mm[0]"), True),
        (key, ("core.z_mm[0]",), False),
        (curve, ("materials.steel.H_A_per_m",), True),
    ):
        assert judge(1, of, answer(names)).found == (right,)


def test_what_readings_cannot_show_is_not_counted_as_missed():
    outcome = judge(1, KEY | {"shown": {"hall_offset": 12.0}}, answer(("hall_offset",)))
    assert outcome.could_be_shown == (False,)
    assert {group for group, _ in shares([outcome])} == {"All campaigns"}


def test_a_file_that_the_diagnosis_refuses_is_an_outcome(levitation_model, tmp_path, monkeypatch):
    monkeypatch.setattr("femfit.trial.campaigns.process_pool", ThreadPoolExecutor)  # a process starts in 3 s
    ff.write_model(levitation_model, tmp_path / "model.json")
    place = tmp_path / "campaigns" / "0001"
    place.mkdir(parents=True)
    (place / "data.csv").write_text("current_A,distance_m,colour\n1.0,0.02,3\n")
    (place / "hidden.json").write_text(json.dumps({"level": 0.0, "hidden": {}, "over_noise": {}}))
    (outcome,) = diagnose_campaigns(tmp_path, [1], workers=1)
    assert (outcome.verdict, outcome.classes) == ("refused", ())
    assert shares([outcome])["Nothing hidden", "no verdict was given"] == Share(1, 1)


def test_intervals_are_the_exact_ones():
    # Clopper and Pearson: no hit in n leaves 1 - 0.025^(1/n)
    assert Share(0, 100).ci95 == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / 100.0)))
    assert Share(100, 100).ci95[1] == 1.0
    assert Share(5, 50).ci95 == pytest.approx((0.0333, 0.2181), abs=1e-4)  # as printed in tables
