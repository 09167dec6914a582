"""Advice on the next measurement, and on a plan before anyone measures."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import femfit as ff
from effect_signature import typical_parameters
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.effect import AddedEffect, Calibration, Effect, EffectParameter, in_channel
from femfit.identify.bench import bench_observations
from femfit.identify.plan import examine_plan
from femfit.identify.settings import conditions_of
from femfit.identify.signatures import why_untestable
from femfit.identify.suggest import Advice, Suggestion, _isolating, joined, suggest_measurements
from femfit.model.readings import predict_readings
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import nominal_of
from support.campaign import NOISE, campaign, hidden, without

AMPLITUDE = EffectParameter("gain", (-0.5, 0.5), (-0.05, 0.05), "Relative error.")
FORCE_SCALE = Effect(
    "force_scale", "The force sensor reads too much.", ("sensor",), (AMPLITUDE,), ("force_N",), "Hang a weight.", "",
    readings=in_channel("force_N", lambda force, point: force * (1.0 + point.p["gain"])),
    calibrations=(Calibration({"gain": 1e-3}, 10.0, "Hang a reference weight on the force sensor."),),
)  # fmt: skip
PULL_SCALE = Effect(
    "pull_scale", "The whole actuator is stronger.", ("magnetics",), (AMPLITUDE,), ("force_N|flux_linkage_Wb",), "", "",
    coenergy=lambda base, point: (1.0 + point.p["gain"]) * base(point.d, point.i, point.h),
)  # fmt: skip
PAIR = (FORCE_SCALE, PULL_SCALE)
FORCE = {"force_N": NOISE["force_N"]}
SMALL = {"distances": 6, "currents": 4}


def with_channels(table, *channels):
    """The table with some of its channels, and without the temperatures."""
    unread = {*NOISE, "coil_temperature_C", "magnet_temperature_C"} - set(channels)
    return without(table, *unread)


def measured(model, seed, causes, channels=("force_N",), **size):
    """Readings of some channels, of force alone if nothing is said, with hidden effects, and their diagnosis."""
    effects = [hidden(name, **values) for name, values in causes.items()]
    noise = {name: NOISE[name] for name in channels}
    table = with_channels(campaign(model, seed, effects, noise=noise, **size), *channels)
    return table, ff.diagnose(model, table)


def advice_of(model, table, diagnosis):
    return suggest_measurements(model, table, diagnosis.campaign.noise, diagnosis.explanations)


def pairs_of(suggestion):
    """What a measurement tells apart."""
    return [{one, other} for one, other, _ in suggestion.separates]


@pytest.fixture
def confounded(levitation_model, monkeypatch):
    """Force readings alone, on which a wrong force sensor and a stronger actuator are the same."""
    monkeypatch.setattr("femfit.identify.decision.diagnose.considered_effects", lambda *_: list(PAIR))
    effect = AddedEffect(FORCE_SCALE, {"gain": 0.04})
    table = with_channels(campaign(levitation_model, 21, [effect], noise=FORCE), "force_N")
    return table, ff.diagnose(levitation_model, table)


def test_a_further_channel_or_a_reference_weight_separates_twins_and_more_of_the_same_does_not(
    confounded, levitation_model
):
    table, diagnosis = confounded
    assert set(diagnosis.missing[0].members) == {"force_scale", "pull_scale"}
    advice = ff.suggest(levitation_model, table, diagnosis)
    first = advice.suggestions[0]
    assert first.text == "Hang a reference weight on the force sensor."  # ten readings
    (gain,) = next(fit.effects for fit in diagnosis.explanations if fit.names == ("force_scale",))
    error = np.ptp(gain.ci95["gain"]) / (2.0 * 1.96)  # what the readings leave of it, beside the weight's own 1e-3
    assert error > 3e-4
    assert first.separates[0][2] == pytest.approx(gain.parameters["gain"] / np.hypot(error, 1e-3), abs=0.1)
    assert any("flux linkage" in one.text for one in advice.suggestions)
    assert not any("once more" in one.text for one in advice.suggestions)  # more of the same


def test_advice_says_how_many_explanations_it_does_not_compare(confounded, levitation_model, monkeypatch):
    table, diagnosis = confounded
    fits = diagnosis.explanations[:2]
    monkeypatch.setattr(ff.Diagnosis, "explanations", (*fits, *fits, fits[0]))
    monkeypatch.setattr("femfit.identify.suggest.COMPARED", 2)
    advice = ff.suggest(levitation_model, table, diagnosis)
    assert len(advice.explanations) == 2
    assert advice.further == advice.to_dict()["further"] == 3


@pytest.mark.nightly
def test_wrong_scales_call_for_what_reads_them_directly_the_cheapest_first(solenoid):
    table, diagnosis = measured(solenoid, 1, {"force_gain": {"gain_error": 0.05}})
    left = {fit.names[0] for fit in diagnosis.explanations}
    assert left >= {"turns", "force_gain", "current_gain"}
    advice = advice_of(solenoid, table, diagnosis)
    prices = [one.cost / len(one.separates) for one in advice]
    assert prices == sorted(prices)
    words = ("reference weight", "calibrated shunt", "flux linkage")
    weight, shunt, flux = (next(one for one in advice if word in one.text) for word in words)
    for one in (weight, shunt):
        assert {"force_gain", "current_gain"} in pairs_of(one)
    assert {"turns", "current_gain"} in pairs_of(flux)  # what they differ in
    assert flux.cost > max(weight.cost, shunt.cost)
    for one in advice:  # a solenoid has no magnet
        assert "magnet" not in one.text.replace("electromagnet", "").replace("magnetic", "")


def test_a_pull_and_a_sensors_offset_are_never_said_to_be_separated_by_readings_of_force(solenoid):
    """A stop beside them, whose reach was fitted between trial values, made the two look 264 deviations apart."""
    causes = {"force_offset": {"offset": -0.03}, "end_stop_contact": {"near_flat": 0.05, "reach": 0.23}}
    table, diagnosis = measured(solenoid, 3, causes)
    twins = {"force_offset", "constant_force"}
    pairs = [
        (one, pair)
        for one in advice_of(solenoid, table, diagnosis)
        for pair in one.separates
        if set(pair[0].split(" + ")) ^ set(pair[1].split(" + ")) == twins
    ]
    assert pairs
    assert all(one.experiment.calibration is not None for one, _ in pairs)


def test_an_offset_of_the_force_sensor_and_a_pull_are_separated_by_an_empty_sensor(solenoid):
    table, diagnosis = measured(solenoid, 3, {"force_offset": {"offset": 0.004}})
    assert {fit.names[0] for fit in diagnosis.explanations} >= {"force_offset", "constant_force"}
    advice = ff.suggest(solenoid, table, diagnosis)
    assert {"force_offset", "constant_force"} not in [set(pair) for pair in advice.never]
    empty = next(one for one in advice.suggestions if one.text == "Take everything off the force sensor, and read it.")
    assert {"force_offset", "constant_force"} in pairs_of(empty)


def test_of_a_record_each_measurement_is_said_once_the_most_separating_first(levitation_model):
    rivals = ["coulomb_friction", "viscous_friction", "spring_stiffness", "spring_preload"]
    isolating = _isolating([("mass_error", rival) for rival in rivals], nominal_of(levitation_model))
    assert [name for name, _ in isolating] == [*rivals, "mass_error"]
    first, second, *rest = str(Advice(("mass_error + coulomb_friction", "..."), isolating=isolating)).splitlines()
    assert first == f"Next: {all_effects()['coulomb_friction'].experiment}"
    assert second == "  This shows coulomb_friction by itself."
    assert sum("Weigh" in line for line in rest) == 1
    assert all(line.startswith(("Or: ", "  This shows ", "The data leave ")) for line in rest)


def test_what_all_explanations_have_is_said_once_and_rivals_beyond_three_are_counted():
    rest = ("remanence", "turns", "current_gain", "hysteresis", "eddy_lag", "mass_error")
    names = tuple(f"hall_offset + {name}" for name in rest)
    one, *others = names
    apart = tuple((one, other, 9.0) for other in others)
    some = (*((names[1], other, 9.0) for other in names[2:]), (names[2], names[3], 9.0))
    left = tuple((a, b) for a, b in combinations(names, 2) if a != one)
    known = tuple(Suggestion("Read.", 7.0, pairs, left) for pairs in (apart, some))
    text = str(Advice(names, known, never=tuple(combinations(names[3:], 2))))
    assert "separates remanence from every other." in text
    assert "separates turns from current_gain, hysteresis, eddy_lag and 1 more; current_gain from hysteresis." in text
    assert "separate hysteresis, eddy_lag and mass_error from each other." in text
    assert text.endswith(f"leave hall_offset with {', '.join(rest[:-1])} or mass_error.")


def test_a_gaussmeter_does_not_separate_a_weak_grade_from_a_magnet_that_lost_as_much(levitation_model):
    table, diagnosis = measured(levitation_model, 4, {"remanence": {"remanence_error": -0.06}})
    assert {fit.names[0] for fit in diagnosis.explanations} >= {"remanence", "magnet_demagnetisation"}
    for one in advice_of(levitation_model, table, diagnosis):
        assert "anew" in one.text or {"remanence", "magnet_demagnetisation"} not in pairs_of(one)


def simulated(model, table, experiment, effects, seed):
    """The table with the experiment as its last run, as effects would make both be read."""
    more = joined(table, experiment)
    observations = bench_observations(model, replace(more, rows=more.rows.assign(**dict.fromkeys(more.channels, 0.0))))
    covariates, generator = observations.covariates, np.random.default_rng(seed)
    d, i = (covariates[name].to_numpy() for name in ("distance_m", "current_A"))
    d = d + generator.normal(0.0, 5e-6, covariates["mount"].max() + 1)[covariates["mount"]]
    readings = predict_readings(model, d, i, conditions_of(covariates, nominal_of(model)), effects)
    rows = more.rows.copy()
    for name in more.channels:
        value = readings[name] + NOISE[name] * generator.standard_normal(len(rows))
        rows[name] = np.where(more.rows[name].isna(), np.nan, value)
    return replace(more, rows=rows, declared_noise={name: NOISE[name] for name in more.channels})


def broken_promises(model, name, seed, channels):
    """(proposed, truth, rival) of the first runs after which a diagnosis still leaves what they were to separate."""
    effect = effect_by_name(name)
    table, diagnosis = measured(model, seed, {name: typical_parameters(effect)}, channels, **SMALL)
    if diagnosis.campaign is None or len(diagnosis.explanations) < 2:
        return [], 0
    broken, tried, seeds = [], 0, np.random.default_rng(seed)
    runs = [one for one in advice_of(model, table, diagnosis) if one.experiment.rows is not None]
    for one in [one for one in runs if set(one.experiment.channels) <= set(NOISE)]:
        for fit in diagnosis.explanations:
            truth = " + ".join(fit.names)
            rivals = [other for pair in pairs_of(one) if truth in pair for other in pair - {truth}]
            if not rivals:
                continue
            data = simulated(model, table, one.experiment, fit.effects, int(seeds.integers(2**31)))
            left = {" + ".join(other.names) for other in ff.diagnose(model, data).explanations}
            tried += 1
            broken += [(one.text, truth, rival) for rival in rivals if {truth, rival} <= left]
    return broken, tried


@pytest.mark.nightly
@pytest.mark.parametrize(
    "channels",
    [("force_N",), ("flux_linkage_Wb",), ("hall_V",), ("voltage_V",), ("force_N", "flux_linkage_Wb")],
    ids="+".join,
)
def test_the_advice_holds_over_the_whole_catalogue(levitation_model, solenoid, channels):
    """Promised for 19 of 20 campaigns: of n trials at most what a share of one in twenty makes likely (99 %)."""
    broken, tried = [], 0
    for seed, (name, effect) in enumerate(all_effects().items()):
        for model in (levitation_model, solenoid):
            if model is solenoid and "hall_V" in channels:
                continue
            clean = with_channels(campaign(model, 0, noise={c: NOISE[c] for c in channels}, **SMALL), *channels)
            if why_untestable(effect, bench_observations(model, clean)):
                continue
            found, count = broken_promises(model, name, 100 + seed, channels)
            broken, tried = broken + found, tried + count
    assert tried > 0
    assert len({(text, truth) for text, truth, _ in broken}) <= 0.05 * tried + 2.33 * np.sqrt(0.05 * tried), broken


def test_a_plan_says_beforehand_what_it_could_never_separate_or_cannot_show_and_why(levitation_model):
    plan = campaign(levitation_model, 22, runs=1)
    alone = with_channels(plan, "force_N")
    assert examine_plan(levitation_model, alone, PAIR).together == (("force_scale", "pull_scale"),)
    assert examine_plan(levitation_model, plan, PAIR).together == ()
    report = examine_plan(levitation_model, without(plan, "hall_V"), [effect_by_name("hall_offset"), FORCE_SCALE])
    assert set(report.invisible) == {"hall_offset"}
    assert "hall_V" in report.invisible["hall_offset"]
    quiet, loud = (
        examine_plan(levitation_model, replace(plan, declared_noise={"force_N": sigma}), [FORCE_SCALE])
        for sigma in (1e-4, 4e-3)  # more than the model misses its own table by
    )
    assert loud.detectable["force_scale"]["gain"] > 10.0 * quiet.detectable["force_scale"]["gain"] > 0.0


@pytest.mark.parametrize("drawn", [False, True])
def test_a_model_without_a_magnet_has_no_effect_of_a_magnet(solenoid, drawn):
    plan = with_channels(campaign(solenoid, 27, runs=1, noise=FORCE), "force_N")
    steel = ActuatorKind(False, False, fixed_iron=True, moving_iron=True, coil=True, saturates=False)
    model = replace(solenoid, kind=steel) if drawn else solenoid
    names = ("remanence", "magnet_temperature", "magnet_demagnetisation")
    report = examine_plan(model, plan, [effect_by_name(name) for name in names])
    assert set(report.invisible) == set(names)


def test_a_plan_of_force_alone_names_what_it_leaves_together_and_what_would_separate_it(levitation_model):
    report = examine_plan(levitation_model, with_channels(campaign(levitation_model, 25, **SMALL), "force_N"))
    magnet = ("remanence", "magnet_temperature", "magnet_demagnetisation")
    assert {("force_offset", "constant_force"), *combinations(magnet, 2)} <= set(report.together)
    text = str(report)
    for name in ("force_offset", "constant_force"):
        assert effect_by_name(name).calibrations[0].instruction in text


def test_advice_on_one_current_is_sound(solenoid):
    whole = campaign(solenoid, 32, [hidden("force_offset", offset=0.03)], runs=4, noise=FORCE)
    rows = whole.rows[np.isclose(whole.rows["current_A"], 0.7)].reset_index(drop=True)
    assert str(ff.suggest(solenoid, with_channels(replace(whole, rows=rows), "force_N")))
