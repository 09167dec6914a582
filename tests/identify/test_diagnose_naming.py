"""The decision on campaigns whose truth is known: nothing, something known, something unknown, too little to say."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.campaign import gather
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis import CleanCampaigns
from femfit.identify.decision.naming import decide
from femfit.identify.noise.components import estimate_noise
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit.refit import refit
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import Misfit, ValidityBox
from support.campaign import NOISE, campaign

QUICK = {"bootstrap": 0}
SATURATION = AddedEffect(
    effect_by_name("core_saturation"), effect_by_name("core_saturation").null() | {"mmf_loss_3": 0.02}
)
HALL = AddedEffect(effect_by_name("hall_offset"), {"offset_V": 0.02})


def decided(model, table):
    return decide(gather(bench_observations(model, table), list(all_effects().values())))


# The gate opens on 1 % of clean campaigns: two openings are less likely than 0.04 % among three, and 0.3 % among eight
@pytest.mark.parametrize("campaigns", [3, pytest.param(8, marks=pytest.mark.long)])
@pytest.mark.parametrize(("rho", "mount_m"), [(0.0, 0.0), (0.6, 50e-6)])
def test_clean_data_with_remounts_and_correlated_noise_name_nothing(levitation_model, rho, mount_m, campaigns):
    verdicts = [
        decided(levitation_model, campaign(levitation_model, seed, rho=rho, mount_m=mount_m)).verdict
        for seed in range(campaigns)
    ]
    assert verdicts.count("nothing_missing") >= campaigns - 1
    assert "named" not in verdicts


def test_a_hidden_effect_is_named_with_its_size(levitation_model):
    result = diagnose(levitation_model, campaign(levitation_model, 3, [HALL]), **QUICK)
    assert (result.verdict, result.missing[0].name) == ("named", "hall_offset")
    low, high = result.missing[0].ci95["offset_V"]
    assert low < 0.02 < high
    assert result.missing[0].explained_share == pytest.approx(1.0, abs=0.1)
    assert result.where.channel == "hall_V"


def test_two_hidden_effects_are_both_named(levitation_model):
    result = diagnose(levitation_model, campaign(levitation_model, 4, [SATURATION, HALL]), **QUICK)
    assert result.verdict == "named"
    assert {"core_saturation", "hall_offset"} == {one.name for one in result.missing}


def test_a_small_effect_beside_a_large_one_is_named_with_its_class_after_few_refits(levitation_model, monkeypatch):
    """What many others stand for as well, beside the same saturation, is small: first order says as much as refits.

    Refitted are the saturation, the offset beside it, and the offset alone, beside which exchanges for the saturation
    are looked for.
    """
    made = []

    def counted(*given):
        made.append(given)
        return refit(*given)

    monkeypatch.setattr("femfit.identify.decision.search.refit", counted)
    small = AddedEffect(HALL.effect, {"offset_V": 1e-3})
    table = campaign(levitation_model, 3, [SATURATION, small])
    result = diagnose(levitation_model, table, **QUICK)
    assert [one.name for one in result.missing] == ["core_saturation", "hall_offset"]
    assert {"hall_temperature", "hall_drift", "external_field"} < set(result.missing[1].members)
    assert len(made) <= 3
    assert not [one for one in result.findings if one.code == "search-ended"]
    monkeypatch.setattr("femfit.identify.decision.search.MOST_REFITS", len(made))  # It ends by itself at the limit
    assert not [one for one in diagnose(levitation_model, table, **QUICK).findings if one.code == "search-ended"]
    monkeypatch.setattr("femfit.identify.decision.search.MOST_REFITS", 2)
    made.clear()
    ended = diagnose(levitation_model, table, **QUICK)
    assert len(made) == 2
    assert [one.size for one in ended.findings if one.code == "search-ended"] == [2]


def test_three_hidden_effects_are_named_though_the_first_alone_explains_little(levitation_model):
    hidden = [HALL, AddedEffect(effect_by_name("turns"), {"turns_error": 0.03}), SATURATION]
    result = diagnose(levitation_model, campaign(levitation_model, 6, hidden), **QUICK)
    assert {"core_saturation", "hall_offset", "turns"} == {one.name for one in result.missing}


def clipped(readings, _):
    """A load cell that ends at half of the largest force."""
    force = readings["force_N"]
    return readings | {"force_N": np.minimum(force, 0.5 * force.max())}


def test_no_name_is_given_that_spoils_a_channel_which_was_right(levitation_model):
    result = diagnose(levitation_model, campaign(levitation_model, 5, change=clipped), **QUICK)
    assert result.verdict in {"unexplained", "form_insufficient"}
    for one in result.error_fall.channels:
        assert one.rms_after <= 1.2 * max(one.rms_before, one.noise)


def crooked(readings, rows):
    """A force sensor whose gain is 10 % wrong and whose characteristic bends: no form of the catalogue is exact."""
    force = readings["force_N"]
    return readings | {"force_N": 1.1 * force - 0.02 * force**2 / np.abs(force).max()}


def test_a_second_effect_is_named_where_the_first_one_changes_nothing(levitation_model):
    small = AddedEffect(HALL.effect, {"offset_V": 0.01})  # a fiftieth of what the force is off by, in units of noise
    alone, beside = (
        diagnose(levitation_model, campaign(levitation_model, 14, effects, change=crooked), **QUICK)
        for effects in ([], [small])
    )
    assert alone.missing[0].name == "force_gain"
    assert not alone.confident
    assert not beside.confident
    assert any("hall_offset" in one.members for one in beside.missing)
    assert any("force_gain" in one.members for one in beside.missing)


def test_something_that_is_no_known_effect_is_unexplained_and_located(levitation_model):
    def ripple(readings, rows):  # a stage's leadscrew of 9 mm pitch felt by the force sensor alone
        wave = 1.2e-3 * np.sin(2.0 * np.pi * rows["distance_m"].to_numpy() / 9e-3)
        return readings | {"force_N": readings["force_N"] + wave}

    result = diagnose(levitation_model, campaign(levitation_model, 5, change=ripple), **QUICK)
    assert (result.verdict, result.missing) == ("unexplained", ())
    assert result.where.channel == "force_N"
    assert result.where.covariates[0] == "distance_m"


def test_an_effect_that_is_left_out_of_the_catalogue_leaves_something_unexplained(levitation_model):
    table = campaign(levitation_model, 6, [SATURATION])
    result = diagnose(levitation_model, table, **QUICK, exclude=("core_saturation",))
    assert result.verdict in {"unexplained", "form_insufficient"}
    assert not result.confident
    assert "core_saturation" not in {score.name for score in result.ranking}


def single_sweep(model, seed, effects=(), **size):
    table = campaign(model, seed, effects, runs=1, rho=0.0, **size)
    return replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))


def test_without_repeats_or_declared_noise_a_guess_serves_and_nothing_is_certain(levitation_model):
    rising = single_sweep(levitation_model, 7, [HALL])
    result = diagnose(levitation_model, rising, **QUICK)
    assert (result.verdict, result.missing[0].name) == ("named", "hall_offset")
    assert not result.confident
    assert [one.code for one in result.findings].count("guessed-noise") == 1
    declared = diagnose(levitation_model, replace(rising, declared_noise=NOISE), **QUICK)
    assert (declared.verdict, declared.missing[0].name) == ("named", "hall_offset")
    assert "guessed-noise" not in {one.code for one in declared.findings}


def test_without_neighbours_on_a_line_the_data_are_compared_only(levitation_model):
    table = single_sweep(levitation_model, 7, [HALL])
    scattered = table.rows.iloc[:: len(table.rows) // 12].reset_index(drop=True)
    result = diagnose(levitation_model, replace(table, rows=scattered), **QUICK)
    assert result.verdict == "compare_only"
    assert result.findings[-1].code == "no-noise"
    without = diagnose(levitation_model, replace(table, rows=scattered), **QUICK, exclude=("hall_offset",))
    assert without.excluded == ("hall_offset",)
    assert {score.name for score in result.ranking} - {score.name for score in without.ranking} == {"hall_offset"}


def test_a_warm_coil_without_a_thermometer_is_one_class_with_a_wrong_resistance(levitation_model):
    table = campaign(
        levitation_model, 13, change=lambda r, rows: r | {"voltage_V": (1.0 + 25 * 3.93e-3) * r["voltage_V"]}
    )
    blind = tuple(name for name in table.given if name != "coil_temperature_C")
    unread = replace(table, rows=table.rows.assign(coil_temperature_C=np.nan), given=blind)
    result = diagnose(levitation_model, unread, **QUICK)
    (named,) = result.missing
    assert set(named.members) == {"resistance", "coil_temperature"}  # the same readings, the commoner cause first
    assert named.plausible


def test_the_noise_model_recovers_what_made_the_data(levitation_model):
    table = campaign(levitation_model, 8, rho=0.6, mount_m=40e-6, runs=6)
    noise = estimate_noise(bench_observations(levitation_model, table))
    truth = np.array([NOISE[name] for name in noise.channels])
    # 840 readings a channel, worth about 400 independent ones: 3.5 % standard error each
    np.testing.assert_allclose(noise.sigma, truth, rtol=0.15)
    np.testing.assert_allclose(noise.rho, 0.6, atol=0.1)
    assert 15e-6 < noise.mount_m < 100e-6  # six mounts and a weak prior


def test_a_hidden_effect_does_not_widen_the_noise(levitation_model):
    clean, changed = (
        estimate_noise(bench_observations(levitation_model, campaign(levitation_model, 9, effects)))
        for effects in ([], [SATURATION])
    )
    np.testing.assert_allclose(changed.sigma, clean.sigma, rtol=0.05)


def test_a_distance_error_of_all_mounts_does_not_widen_their_scatter(levitation_model):
    box = ValidityBox(0.6e-3, 6e-3, 0.0, 2.0)
    pot = LawMagnetics("F1e", (Coefficient("d^-2", 2, 2e-5, "N m^2 / A^2"),), {}, 0.03)
    model = replace(levitation_model, magnetics=pot, validity=box, sensor=None)
    noise = {"force_N": 0.1, "flux_linkage_Wb": 5e-5, "voltage_V": 5e-3}
    offset = AddedEffect(effect_by_name("distance_offset"), {"offset_m": 60e-6})
    clean, moved = (
        estimate_noise(bench_observations(model, campaign(model, 12, e, mount_m=5e-6, noise=noise, runs=4))).mount_m
        for e in ([], [offset])
    )
    # The mounts are 60 um off together and 5 um from each other; over 60 um the steepest slope changes by a quarter
    assert moved == pytest.approx(clean, rel=0.3)


@pytest.fixture(scope="module")
def solenoid(levitation_model):
    """A push solenoid of linear iron whose force falls from 36 N at 0.5 mm to 0.3 N at 5.5 mm."""
    pot = LawMagnetics("F1e", (Coefficient("d^-2", 2, 2.2e-6, "N m^2 / A^2"),), {}, 0.03)
    return replace(levitation_model, magnetics=pot, validity=ValidityBox(0.5e-3, 5.5e-3, 0.5, 2.0), sensor=None)


def test_a_gap_that_all_runs_share_is_named_beside_the_models_own_misfit(solenoid):
    """Three runs that agree to micrometres leave no room for 20 um of re-mount, and the model misses its own table."""

    def coarse(readings, rows):  # what a coarse spline misses: 1.5 % of the force, changing its sign
        wave = np.sin(2e3 * rows["distance_m"].to_numpy()) * np.cos(3.0 * rows["current_A"].to_numpy())
        return {"force_N": readings["force_N"] * (1.0 + 1.5e-2 * wave)}

    gap = AddedEffect(effect_by_name("distance_offset"), {"offset_m": 150e-6})
    table = campaign(solenoid, 15, [gap], change=coarse, noise={"force_N": 0.02}, mount_m=0.5e-6, rho=0.0)
    noise = estimate_noise(bench_observations(solenoid, table))
    assert noise.mount_m < 3e-6
    assert noise.test_mount_m < 15e-6
    rms = 0.01 * float(np.sqrt(np.mean(table.rows["force_N"] ** 2)))
    known = replace(solenoid, misfit=Misfit(rms, 3.0 * rms, 0.01, None, None, None, 99, "sweep"))
    found = diagnose(known, table, **QUICK)
    assert (found.verdict, found.missing[0].members[0]) == ("named", "distance_offset")
    # The model's own misfit is steepest where the force is, and takes its part of the gap
    assert found.missing[0].parameters["offset_m"] == pytest.approx(150e-6, rel=0.1)
    exact = replace(solenoid, misfit=Misfit(0.0, 0.0, 0.0, None, None, None, 99, "sweep"))
    assert diagnose(exact, table, **QUICK).verdict != "named"  # this model would have no such misfit


def test_what_the_data_tell_apart_is_no_class_however_much_both_explain(solenoid):
    turns = AddedEffect(effect_by_name("turns"), {"turns_error": -0.03})
    noise = {"force_N": 0.1, "flux_linkage_Wb": 2e-6}
    found = diagnose(solenoid, campaign(solenoid, 16, [turns], noise=noise, mount_m=0.0, rho=0.0), **QUICK)
    alone = found.decision.posterior.explanations
    behind = alone[frozenset({"turns"})].log_evidence - alone[frozenset({"current_gain"})].log_evidence
    assert 50.0 < behind < 0.005 * found.excess
    assert [one.members for one in found.missing] == [("turns",)]


def test_a_name_with_a_rival_that_fits_as_well_with_more_parameters_is_not_certain(solenoid):
    gap = AddedEffect(effect_by_name("distance_offset"), {"offset_m": 30e-6})
    found = diagnose(solenoid, campaign(solenoid, 17, [gap], noise={"force_N": 0.02}, mount_m=0.5e-6, rho=0.0), **QUICK)
    named = {one.name for one in found.missing}
    assert not found.confident or all(named <= set(one.names) for one in found.explanations)


def test_the_false_naming_rate_of_clean_campaigns_is_small_and_reproducible(levitation_model):
    table = campaign(levitation_model, 10, distances=5, currents=4)
    first, again = (diagnose(levitation_model, table, bootstrap=8, rng=1) for _ in range(2))
    assert first.clean == again.clean
    assert first.clean.named <= 1


@pytest.mark.parametrize(("named", "campaigns", "bound"), [(0, 40, 0.088), (2, 40, 0.169), (40, 40, 1.0)])
def test_a_bootstrap_is_a_count_with_the_end_of_its_interval(named, campaigns, bound):
    # Exact binomial intervals at 95 % (Clopper and Pearson, 1934)
    clean = CleanCampaigns(named, campaigns)
    assert clean.bound == pytest.approx(bound, abs=5e-4)
    assert f"{named} of {campaigns}" in str(clean)


def test_what_the_data_could_show_scales_with_the_noise(levitation_model):
    quiet, loud = (
        diagnose(
            levitation_model,
            campaign(levitation_model, 11, mount_m=0.0, rho=0.0, noise={k: f * v for k, v in NOISE.items()}),
            **QUICK,
        )
        for f in (1.0, 4.0)
    )
    ratio = loud.detectable["core_saturation"]["mmf_loss_3"] / quiet.detectable["core_saturation"]["mmf_loss_3"]
    assert ratio == pytest.approx(4.0, rel=0.25)  # up to what re-mounts take, and the noise estimate's own error


def test_the_result_is_json_with_the_class_under_its_own_name(levitation_model):
    data = diagnose(levitation_model, campaign(levitation_model, 3, [HALL]), **QUICK).to_dict()
    assert data["missing"][0]["class"][0] == "hall_offset"
    assert set(data) >= {
        "verdict",
        "missing",
        "ranking",
        "where",
        "noise_floor",
        "error_fall",
        "detectable",
        "false_naming_rate",
    }
