"""Advice on the next measurement, and on a plan before anyone measures."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.diagnose.diagnose import DiagnosisOptions, examine
from femfit.diagnose.observations import bench_observations
from femfit.diagnose.plan import examine_plan
from femfit.diagnose.suggest import suggest_measurements
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect, Calibration, Effect, EffectParameter
from support.campaign import NOISE, campaign

AMPLITUDE = EffectParameter("gain", "", -0.5, 0.5, (-0.05, 0.05), "Relative error.")
FORCE_SCALE = Effect(
    "force_scale", "The force sensor reads too much.", ("sensor",), (AMPLITUDE,), ("force_N",), "Hang a weight.", "",
    readings=lambda values, d, i, at, p: {**values, "force_N": values["force_N"] * (1.0 + p["gain"])},
    calibrations=(Calibration("gain", 1e-3, 10.0, "Hang a reference weight on the force sensor."),),
)  # fmt: skip
PULL_SCALE = Effect(
    "pull_scale", "The whole actuator is stronger.", ("magnetics",), (AMPLITUDE,), ("force_N|flux_linkage_Wb",), "", "",
    coenergy=lambda base, d, i, a, b, at, p: (1.0 + p["gain"]) * base(d, i, a, b),
)  # fmt: skip
PAIR = (FORCE_SCALE, PULL_SCALE)


@pytest.fixture
def confounded(levitation_model, monkeypatch):
    """Force readings alone, on which a wrong force sensor and a stronger actuator are the same."""
    monkeypatch.setattr("femfit.diagnose.diagnose.considered_effects", lambda _=(): list(PAIR))
    table = campaign(
        levitation_model, 21, [AddedEffect(FORCE_SCALE, {"gain": 0.04})], noise={"force_N": NOISE["force_N"]}
    )
    given = tuple(name for name in table.given if name not in NOISE or name == "force_N")
    table = replace(table, rows=table.rows.assign(flux_linkage_Wb=np.nan, hall_V=np.nan, voltage_V=np.nan), given=given)
    examination = examine(bench_observations(levitation_model, table), DiagnosisOptions(bootstrap=0))
    return table, examination


def test_two_names_for_one_column_are_one_class(confounded):
    _, examination = confounded
    assert examination.diagnosis.verdict == "named"
    assert set(examination.diagnosis.missing[0].members) == {"force_scale", "pull_scale"}


def test_a_further_channel_or_a_reference_weight_separates_them_and_more_of_the_same_does_not(
    confounded, levitation_model
):
    table, examination = confounded
    advice = suggest_measurements(
        levitation_model, table, examination.evidence.noise, examination.explanations, list(PAIR)
    )
    texts = [one.text for one in advice]
    assert texts[0] == "Hang a reference weight on the force sensor."  # ten readings, 40 standard deviations
    assert advice[0].separates[0][2] == pytest.approx(0.04 / 1e-3, rel=0.1)
    assert any("flux_linkage_Wb" in text for text in texts)
    assert not any("once more" in text for text in texts)


def test_a_plan_tells_beforehand_what_it_could_never_tell_apart(levitation_model):
    plan = campaign(levitation_model, 22, runs=1)
    force_only = replace(plan, given=tuple(name for name in plan.given if name not in NOISE or name == "force_N"))
    assert examine_plan(levitation_model, force_only, PAIR).groups == (("force_scale", "pull_scale"),)
    assert examine_plan(levitation_model, plan, PAIR).groups == ()


def test_a_plan_says_what_it_cannot_show_and_why(levitation_model):
    plan = campaign(levitation_model, 23, runs=1)
    no_hall = replace(plan, given=tuple(name for name in plan.given if name != "hall_V"))
    report = examine_plan(levitation_model, no_hall, [effect_by_name("hall_offset"), FORCE_SCALE])
    assert report.invisible == {"hall_offset": "these data lack hall_V"}
    assert report.detectable["force_scale"]["gain"] > 0.0


def test_declared_noise_of_a_plan_counts(levitation_model):
    plan = campaign(levitation_model, 24, runs=1)
    quiet, loud = (
        examine_plan(levitation_model, replace(plan, declared_noise={"force_N": sigma}), [FORCE_SCALE])
        for sigma in (1e-5, 1e-3)
    )
    assert loud.detectable["force_scale"]["gain"] > 10.0 * quiet.detectable["force_scale"]["gain"]
