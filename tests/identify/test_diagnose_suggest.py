"""Advice on the next measurement, and on a plan before anyone measures."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.effect import AddedEffect, Calibration, Effect, EffectParameter
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.experiments.plan import examine_plan
from femfit.identify.experiments.suggest import suggest_measurements
from femfit.identify.experiments.suggest_text import plan_lines, suggestion_lines
from femfit.model.magnetics import CoenergySpline
from support.campaign import NOISE, campaign
from support.splines import REFERENCE_DISTANCE, fitted_spline

AMPLITUDE = EffectParameter("gain", "", (-0.5, 0.5), (-0.05, 0.05), "Relative error.")
FORCE_SCALE = Effect(
    "force_scale", "The force sensor reads too much.", ("sensor",), (AMPLITUDE,), ("force_N",), "Hang a weight.", "",
    readings=lambda values, d, i, at, p: {**values, "force_N": values["force_N"] * (1.0 + p["gain"])},
    calibrations=(Calibration({"gain": 1e-3}, 10.0, "Hang a reference weight on the force sensor."),),
)  # fmt: skip
PULL_SCALE = Effect(
    "pull_scale", "The whole actuator is stronger.", ("magnetics",), (AMPLITUDE,), ("force_N|flux_linkage_Wb",), "", "",
    coenergy=lambda base, d, i, a, b, at, p: (1.0 + p["gain"]) * base(d, i, a, b),
)  # fmt: skip
PAIR = (FORCE_SCALE, PULL_SCALE)


@pytest.fixture
def confounded(levitation_model, monkeypatch):
    """Force readings alone, on which a wrong force sensor and a stronger actuator are the same."""
    monkeypatch.setattr("femfit.identify.decision.diagnose.considered_effects", lambda _=(): list(PAIR))
    table = campaign(
        levitation_model, 21, [AddedEffect(FORCE_SCALE, {"gain": 0.04})], noise={"force_N": NOISE["force_N"]}
    )
    given = tuple(name for name in table.given if name not in NOISE or name == "force_N")
    table = replace(table, rows=table.rows.assign(flux_linkage_Wb=np.nan, hall_V=np.nan, voltage_V=np.nan), given=given)
    examination = diagnose(levitation_model, table, bootstrap=0)
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
        levitation_model, table, examination.campaign.noise, examination.explanations, list(PAIR)
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


@pytest.fixture(scope="module")
def solenoid(levitation_model):
    """A coil that pulls soft iron: on force alone a wrong force scale is a wrong current scale, for F goes with i^2."""
    currents = np.linspace(0.0, 1.4, 8)
    spline = fitted_spline(lambda d, i: 0.5 * (0.016 + 0.05 * np.exp(-d / 0.01)) * i**2, currents, 2)
    return replace(levitation_model, magnetics=CoenergySpline(REFERENCE_DISTANCE, spline), sensor=None)


def force_only(model, seed, hidden, **size):
    """A campaign of force readings with one hidden effect, and its examination."""
    effects = [AddedEffect(e, e.null() | values) for e, values in ((effect_by_name(n), v) for n, v in hidden.items())]
    table = campaign(model, seed, effects, noise={"force_N": NOISE["force_N"]}, **size)
    given = tuple(name for name in table.given if not name.endswith("temperature_C"))
    rows = table.rows.assign(coil_temperature_C=np.nan, magnet_temperature_C=np.nan)
    rows = rows.assign(**{name: np.nan for name in NOISE if name not in rows})
    table = replace(table, rows=rows, given=given)
    return table, diagnose(model, table, bootstrap=0)


def advice_of(model, table, examination):
    return suggest_measurements(
        model, table, examination.campaign.noise, examination.explanations, list(all_effects().values())
    )


def test_a_wrong_force_scale_and_a_wrong_current_scale_call_for_a_reference_weight_or_a_shunt(solenoid):
    table, examination = force_only(solenoid, 1, {"force_gain": {"gain_error": 0.05}})
    assert {fit.names[0] for fit in examination.explanations} == {
        "turns",
        "force_gain",
        "current_gain",
        "distance_offset",
    }
    advice = advice_of(solenoid, table, examination)
    texts = [one.text for one in advice]
    weight, shunt = (next(k for k, text in enumerate(texts) if word in text) for word in ("reference weight", "shunt"))
    for k in (weight, shunt):
        assert {"force_gain", "current_gain"} in [{a, b} for a, b, _ in advice[k].separates]
    # A gauge block is cheaper, but says nothing of these two; a fluxmeter tells all three apart and is the dearest
    assert {"force_gain", "current_gain"} in [set(pair) for pair in advice[0].remains]
    flux = next(one for one in advice if "flux_linkage_Wb" in one.text)
    assert flux.remains == ()
    assert flux.cost > max(advice[weight].cost, advice[shunt].cost)


def test_the_cheapest_measurement_for_each_pair_comes_first(solenoid):
    advice = advice_of(solenoid, *force_only(solenoid, 1, {"force_gain": {"gain_error": 0.05}}))
    prices = [one.cost / len(one.separates) for one in advice]
    assert prices == sorted(prices)
    lines = suggestion_lines(advice, 4)
    assert lines[0].startswith("1. Rest the moving part on a gauge block of known height")
    assert all(name in lines[0] for name in ("distance_offset", "turns", "force_gain", "current_gain"))


def test_a_small_misfit_of_force_alone_calls_for_a_gauge_block_or_a_further_channel(levitation_model):
    table, examination = force_only(
        levitation_model, 1, {"distance_offset": {"offset_m": 8e-5}}, distances=6, currents=4
    )
    left = {fit.names[0] for fit in examination.explanations}
    assert left >= {"distance_offset", "lateral_misalignment"}
    advice = advice_of(levitation_model, table, examination)
    assert "gauge block of known height" in advice[0].text
    assert {frozenset(pair[:2]) for pair in advice[0].separates} == {
        frozenset({"distance_offset", other}) for other in left - {"distance_offset"}
    }
    assert any("hall_V" in one.text or "flux_linkage_Wb" in one.text for one in advice)


def test_a_model_without_a_magnet_is_not_said_to_have_lost_its_magnetisation(solenoid, levitation_model):
    for model, why in ((solenoid, "without current"), (levitation_model, None)):
        plan = campaign(model, 27, runs=1, noise={"force_N": NOISE["force_N"]})
        plan = replace(plan, rows=plan.rows.assign(flux_linkage_Wb=np.nan, hall_V=np.nan, voltage_V=np.nan))
        report = examine_plan(model, plan, [effect_by_name("magnet_demagnetisation")])
        said = report.invisible.get("magnet_demagnetisation")
        assert said is None if why is None else said.startswith(why)


@pytest.mark.parametrize(
    "name",
    ["force_gain", "current_gain", "current_offset", "distance_offset", "distance_scale", "hall_offset", "force_offset",
     "mass_error", "coil_temperature", "hall_temperature", "driver_gain", "sensor_delay"],
)  # fmt: skip
def test_what_a_bench_engineer_calibrates_has_its_measurement(name):
    assert effect_by_name(name).calibrations


def test_a_plan_of_force_alone_names_what_it_leaves_together_and_the_direct_readings_that_would_tell(levitation_model):
    plan = campaign(levitation_model, 25, runs=3)
    force = replace(plan, given=tuple(name for name in plan.given if name not in NOISE or name == "force_N"))
    rows = plan.rows.assign(coil_temperature_C=np.nan, magnet_temperature_C=np.nan)
    report = examine_plan(levitation_model, replace(force, rows=rows), list(all_effects().values()))
    assert ("force_offset", "constant_force") in report.groups
    assert any({"magnet_temperature", "magnet_demagnetisation"} <= set(group) for group in report.groups)
    lines = plan_lines(report)
    below = lines[lines.index("  force_offset, constant_force") + 1 :][:2]
    assert "Take the electromagnet away" in below[0]
    assert "brass" in below[1]


def test_what_a_plan_tells_apart_only_where_it_is_large_is_said(levitation_model):
    plan = campaign(levitation_model, 26, runs=3, distances=6, currents=4)
    force = replace(plan, given=tuple(name for name in plan.given if name not in NOISE or name == "force_N"))
    effects = [effect_by_name(name) for name in ("distance_offset", "lateral_misalignment", "force_gain")]
    report = examine_plan(levitation_model, force, effects)
    assert report.groups == ()
    assert len(report.small_groups) == 1
    assert "Nor these where they are small, at three times the magnitudes below:" in plan_lines(report)
