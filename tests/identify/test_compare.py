"""A comparison says how bad, against which noise, and whether the law or the physics is to blame."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from femfit.core.errors import TableError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.compare import compare
from femfit.identify.comparison.lack_of_fit import LackOfFit, PatternSpace
from femfit.identify.decision.campaign import campaign_remarks, gather
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis_text import verdict_sentence
from femfit.identify.noise.components import estimate_noise
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit.add_effects import add_effects
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import Misfit
from support.campaign import NOISE, campaign

HALL = AddedEffect(effect_by_name("hall_offset"), {"offset_V": 0.02})


@pytest.mark.parametrize("held", [0.0, 0.025])
def test_a_channel_that_never_varies_has_no_noise_and_says_so(levitation_model, held):
    table = campaign(levitation_model, 11)
    table = replace(table, rows=table.rows.assign(force_N=held), declared_noise={})
    comparison = compare(levitation_model, table)
    assert by_channel(comparison)["force_N"].noise_floor is None
    assert [one.column for one in comparison.findings if one.code == "never-varies"] == ["force_N"]
    assert by_channel(comparison)["hall_V"].noise_floor == pytest.approx(NOISE["hall_V"], rel=0.2)


def by_channel(comparison):
    return {one.channel: one for one in comparison.channels}


@pytest.fixture(scope="module")
def law_model(levitation_model):
    """F = a d^-4 + m i d^-2 by least squares over the rig's box: a law that cannot follow it."""
    box = levitation_model.validity
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.015, 0.045, 31), np.linspace(0.0, 1.4, 8)))
    force = levitation_model.magnetics.force(d, i)
    columns = np.column_stack([d**-4.0, i * d**-2.0])
    a, m = np.linalg.lstsq(columns, force, rcond=None)[0]
    error = columns @ [a, m] - force
    rms = float(np.sqrt(np.mean(error**2)))
    law = LawMagnetics("F1e", (Coefficient("d^-4", 0, a, "N m^4"), Coefficient("d^-2", 1, m, "N m^2 / A")), {}, 0.016)
    flux = levitation_model.magnetics.flux_linkage(d, i) - law.flux_linkage(d, i)
    flux_rms = float(np.sqrt(np.mean(flux**2)))
    misfit = Misfit(rms, float(np.abs(error).max()), 0.1, None, flux_rms, None, len(d), "sweep")
    return replace(levitation_model, magnetics=law, misfit=misfit, validity=box), rms


@pytest.mark.parametrize("mount_m", [0.0, 50e-6])
def test_clean_data_agree_whatever_the_remounts(levitation_model, mount_m):
    comparison = compare(levitation_model, campaign(levitation_model, 11, mount_m=mount_m))
    assert comparison.verdict == "agrees"
    assert comparison.where.channel == ""
    for one in comparison.channels:
        assert one.noise_floor == pytest.approx(NOISE[one.channel], rel=0.2)  # about 250 repeats, correlated by 0.3
        assert one.lack_of_fit.p_value > 1e-3
    if mount_m:
        assert comparison.mount_m == pytest.approx(mount_m, rel=0.8)  # three mounts


def test_a_pure_error_test_accuses_the_channel_that_is_wrong_and_no_other(levitation_model):
    comparison = compare(levitation_model, campaign(levitation_model, 12, [HALL]))
    assert comparison.verdict == "fails"
    assert comparison.where.channel == "hall_V"
    tests = {name: one.lack_of_fit.p_value for name, one in by_channel(comparison).items()}
    assert tests.pop("hall_V") < 1e-6
    assert min(tests.values()) > 1e-3
    assert by_channel(comparison)["hall_V"].mean == pytest.approx(0.02, abs=1e-3)


def test_a_declared_noise_is_not_called_one_from_repeats(levitation_model):
    table = campaign(levitation_model, 16, runs=1, noise={"force_N": NOISE["force_N"]})
    once = table.rows[table.rows["branch"] > 0].drop_duplicates(["distance_m", "current_A"]).reset_index(drop=True)
    declared = replace(table, rows=once, declared_noise={"force_N": NOISE["force_N"]})
    said = str(by_channel(compare(levitation_model, declared))["force_N"])
    assert "repeats" not in said
    assert "(declared)" in said


@pytest.mark.parametrize(("source", "declared"), [("declared", True), ("samples", False)])
def test_a_noise_that_nobody_declared_is_not_called_declared(levitation_model, source, declared):
    """A record's own samples say a noise too, which its repeats may contradict."""
    table = replace(campaign(levitation_model, 15), declared_noise={name: 3.0 * sigma for name, sigma in NOISE.items()})
    campaigned = gather(replace(bench_observations(levitation_model, table), noise_source=source), ())
    said = [str(one) for one in campaign_remarks(campaigned) if one.code == "declared-noise"]
    assert len(said) == len(NOISE)
    assert all(("declared" in one) is declared for one in said)
    assert not any(name in one for one in said for name in NOISE)


def test_rms_and_maximum_are_those_of_recorded_minus_predicted(levitation_model):
    table = campaign(levitation_model, 13)
    rows = table.rows.copy()
    worst = int(rows["force_N"].idxmin())
    near = (rows["distance_m"] == rows["distance_m"][worst]) & (rows["current_A"] == rows["current_A"][worst])
    rows.loc[near, "force_N"] += 0.01  # a single one would be set aside
    one = by_channel(compare(levitation_model, replace(table, rows=rows)))["force_N"]
    assert one.largest.value == pytest.approx(0.01, abs=5 * NOISE["force_N"])
    assert (one.largest.distance_m, one.largest.current_A) == tuple(rows.loc[worst, ["distance_m", "current_A"]])
    assert one.rms**2 * one.readings >= near.sum() * 0.009**2


def test_a_law_is_blamed_for_its_own_shape_before_any_measurement(levitation_model, law_model):
    law, rms = law_model
    comparison = compare(law, campaign(levitation_model, 14))
    assert comparison.verdict == "wrong_shape"
    said = verdict_sentence(diagnose(law, campaign(levitation_model, 14), bootstrap=0))
    granted = "is missing beyond the model's own misfit"
    assert granted in str(comparison).split("\n")[0]
    assert granted in said
    assert set(comparison.beyond_noise) == {"force_N", "flux_linkage_Wb"}
    assert comparison.shape.wrong
    assert comparison.shape.force_rms_N == rms
    assert "wrong shape before any measurement" in comparison.shape.sentence
    assert compare(levitation_model, campaign(levitation_model, 14)).shape is None


def test_without_a_noise_floor_there_is_no_verdict_but_a_place(levitation_model):
    table = campaign(levitation_model, 15, [HALL], runs=1)
    rising = replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))
    scattered = replace(rising, rows=rising.rows.iloc[::5].reset_index(drop=True))  # no neighbours to guess noise from
    comparison = compare(levitation_model, scattered)
    assert (comparison.verdict, comparison.where.channel) == ("compare_only", "hall_V")
    assert comparison.structure is None
    assert all(one.noise_floor is None and one.lack_of_fit is None for one in comparison.channels)
    assert comparison.findings[-1].code == "no-noise"
    declared = compare(levitation_model, replace(rising, declared_noise=NOISE))
    assert declared.verdict == "fails"
    assert by_channel(declared)["hall_V"].noise_source == "declared"


def test_repeats_and_a_declaration_are_weighed_unless_they_contradict_each_other(levitation_model):
    table = campaign(levitation_model, 15, [HALL], distances=8, currents=5)
    alone = compare(levitation_model, table)
    for factor, sources in ((1.0, {"declared and repeats"}), (0.6, {"repeats"}), (1.7, {"repeats"})):
        declared = {name: factor * sigma for name, sigma in NOISE.items()}
        both = compare(levitation_model, replace(table, declared_noise=declared))
        assert {one.noise_source for one in both.channels} == sources
        said = {finding.column for finding in both.findings if finding.code == "declared-noise"}
        assert said == (set() if factor == 1.0 else set(NOISE))
        for name, one in by_channel(both).items():
            shown, n = by_channel(alone)[name].noise_floor, by_channel(alone)[name].noise_readings
            want = np.sqrt((48.0 * declared[name] ** 2 + n * shown**2) / (48.0 + n)) if factor == 1.0 else shown
            assert one.noise_floor == pytest.approx(want, rel=0.01)


def test_maps_hold_every_reading_once(levitation_model):
    table = campaign(levitation_model, 16)
    maps = compare(levitation_model, table).maps
    count = int(table.rows["force_N"].notna().sum())
    force = {one.along: one for one in maps if one.channel == "force_N"}
    assert {("distance_m", "current_A"), ("branch",), ("run",), ("mount",), ("order",)} <= set(force)
    assert {sum(cell.readings for cell in one.cells) for one in force.values()} == {count}
    assert len(force["distance_m", "current_A"].cells) == 10 * 7
    assert [cell.at for cell in force["branch",].cells] == [(-1.0,), (1.0,)]


def test_the_verdict_is_the_first_line(levitation_model):
    comparison = compare(levitation_model, campaign(levitation_model, 17, [HALL]))
    lines = str(comparison).split("\n")
    assert comparison.where.sentence in lines[0]
    assert [one.channel for one in comparison.channels] == list(comparison.observations.channels)
    assert "<pre>" in comparison._repr_html_()


def test_a_channel_of_which_nothing_is_left_is_passed_over(levitation_model):
    table = campaign(levitation_model, 18)
    emptied = replace(table, rows=table.rows.assign(hall_V=np.nan))
    assert "hall_V" not in by_channel(compare(levitation_model, emptied))


def test_a_suspected_unit_comes_before_all_numbers(levitation_model):
    table = campaign(levitation_model, 19)
    wrong = replace(table, rows=table.rows.assign(force_N=1e3 * table.rows["force_N"]))
    comparison = compare(levitation_model, wrong)
    (finding,) = [one for one in comparison.findings if one.code == "suspected-unit"]
    assert finding.column == "force_N"
    assert str(finding) in str(comparison).split("\n")[0]


@pytest.mark.parametrize("given", [True, False])
def test_the_freedom_of_the_mounts_is_said(levitation_model, given):
    table = campaign(levitation_model, 20, mount_m=300e-6)
    columns = table.given if given else tuple(name for name in table.given if name != "mount")
    comparison = compare(levitation_model, replace(table, given=columns))
    assert comparison.verdict == "agrees"
    assert comparison.mount_m == pytest.approx(300e-6, rel=0.9)  # three mounts
    assert not comparison.mount_assumed  # they contradict the 20 um that are assumed otherwise
    assert ("from mount to mount" in str(comparison)) is given


def test_what_assumed_mounts_would_make_is_said_to_rest_on_them(levitation_model):
    """Two runs do not show how well a body comes back: what 20 um make is neither noise nor missing."""
    noise = {name: 0.2 * sd for name, sd in NOISE.items()}
    table = campaign(levitation_model, 22, runs=2, mount_m=20e-6, rho=0.0, noise=noise)
    comparison, diagnosis = compare(levitation_model, table), diagnose(levitation_model, table, bootstrap=0)
    assert comparison.verdict == "agrees"
    assert comparison.mount_assumed
    assert comparison.beyond_noise
    for text in (str(comparison), verdict_sentence(diagnosis)):
        assert text.startswith("Nothing is missing if each time that it is put back the body may stand")
    declared = compare(levitation_model, replace(table, declared_noise={"distance_m": 20e-6}))
    assert not declared.beyond_noise


def test_a_channel_of_unknown_noise_is_said_not_to_be_judged(levitation_model):
    """A voltage that was read in one run of three has no repeats; a resistance that is wrong would not be seen."""
    table = campaign(levitation_model, 23, rho=0.0)
    once = table.rows["run"] == 1.0
    rows = table.rows.assign(voltage_V=table.rows["voltage_V"].where(once) * 1.1)
    comparison = compare(levitation_model, replace(table, rows=rows))
    assert "Not judged: the coil voltage, whose noise nothing says." in str(comparison)
    assert "Not judged" in str(diagnose(levitation_model, replace(table, rows=rows), bootstrap=0))
    assert "Not judged" not in str(compare(levitation_model, table))


@pytest.mark.parametrize(("times", "missed"), [(1.3, False), (1.8, False), (3.0, True)])
def test_few_readings_that_scatter_as_by_chance_are_within_their_noise(levitation_model, times, missed):
    """Three readings of noise have an rms of more than 1.94 sigma once in a hundred campaigns, of 1.3 in one of six."""
    table = campaign(levitation_model, 24, mount_m=0.0, rho=0.0)
    rows, kept = table.rows.copy(), table.rows.index[[5, 40, 75]]
    distance, current = rows["distance_m"][kept].to_numpy(), rows["current_A"][kept].to_numpy()
    rows["force_N"] = np.nan
    off = times * NOISE["force_N"] * np.array([1.0, -1.0, 1.0])
    rows.loc[kept, "force_N"] = levitation_model.force(distance, current) + off
    comparison = compare(levitation_model, replace(table, rows=rows, declared_noise=NOISE))
    assert ("force_N" in comparison.beyond_noise) is missed
    assert ("misses the force" in str(comparison) or comparison.verdict == "fails") is missed
    assert by_channel(comparison)["force_N"].rms == pytest.approx(times * NOISE["force_N"], rel=1e-6)


def test_a_single_run_without_mounts_has_no_freedom_to_be_put_back(levitation_model):
    table = campaign(levitation_model, 11, runs=1, mount_m=0.0)
    once = replace(table, given=tuple(name for name in table.given if name not in ("mount", "run")))
    comparison = compare(levitation_model, replace(once, declared_noise=NOISE))
    assert comparison.verdict == "agrees"
    assert comparison.mount_m is None


@pytest.mark.parametrize("offset_m", [0.0, 5e-5, *(pytest.param(one, marks=pytest.mark.long) for one in (3e-5, 8e-5))])
def test_compare_and_diagnose_never_disagree(levitation_model, offset_m):
    offset = AddedEffect(effect_by_name("distance_offset"), {"offset_m": offset_m})
    table = campaign(levitation_model, 30, [offset], runs=1, distances=8, currents=5, mount_m=0.0)
    table = replace(table, declared_noise=NOISE, given=tuple(n for n in table.given if n not in ("mount", "run")))
    comparison, diagnosis = compare(levitation_model, table), diagnose(levitation_model, table, bootstrap=0)
    assert (comparison.verdict == "agrees") is (diagnosis.verdict == "nothing_missing")
    assert comparison.p_value == diagnosis.p_value


def test_the_declared_uncertainty_of_the_distance_is_noise_of_every_reading(levitation_model):
    """0.05 mm of scatter in the distance is not missing physics once it is declared."""
    table = campaign(levitation_model, 31, runs=2, mount_m=0.0)
    moved = table.rows["distance_m"] + np.random.default_rng(0).normal(0.0, 5e-5, len(table.rows))
    given = tuple(name for name in table.given if name not in ("mount", "hall_V"))
    table = replace(table, rows=table.rows.assign(distance_m=moved, hall_V=np.nan), given=given, declared_noise=NOISE)
    declared = replace(table, declared_noise=NOISE | {"distance_m": 5e-5, "current_A": 1e-5})
    assert compare(levitation_model, table).verdict == "fails"
    comparison = compare(levitation_model, declared)
    assert comparison.verdict == "agrees"
    assert "uncertain-setting" in {one.code for one in comparison.findings}


def test_the_scatter_of_repeats_holds_the_declared_error_of_their_settings_once(levitation_model):
    """Repeats are set anew, so that their scatter is the sensor's noise and what the current's error makes of it."""
    observations = compare(levitation_model, campaign(levitation_model, 34, runs=6, mount_m=0.0, rho=0.0)).observations
    columns = np.zeros((len(observations.value), 2))
    columns[observations.of("force_N"), 1] = 4e-4  # what an error of the current makes of the force
    error = np.random.default_rng(1).standard_normal(len(observations.covariates))[observations.row]
    read = observations.with_values(observations.value + error * columns[:, 1])
    scatter, known = (estimate_noise(one) for one in (read, replace(read, setting_columns=columns)))
    force = observations.channels.index("force_N")
    assert scatter.sigma[force] == pytest.approx(2**0.5 * NOISE["force_N"], rel=0.1)
    assert known.sigma[force] == pytest.approx(NOISE["force_N"], rel=0.1)


@pytest.mark.parametrize("count", [1, 5])
def test_too_few_readings_are_neither_a_pass_nor_a_crash(levitation_model, count):
    table = campaign(levitation_model, 32, runs=1)
    few = replace(table, rows=table.rows.iloc[:count].reset_index(drop=True), declared_noise=NOISE)
    comparison, diagnosis = compare(levitation_model, few), diagnose(levitation_model, few, bootstrap=2)
    assert {comparison.verdict, diagnosis.verdict} == {"compare_only"}
    assert comparison.findings[-1].code == diagnosis.findings[-1].code == "too-few-readings"
    with pytest.raises(TableError, match="too few"):
        add_effects(levitation_model, few, ["hall_offset"])


def test_the_sidecar_declares_the_uncertainty_of_the_distance(levitation_model, tmp_path):
    table = campaign(levitation_model, 33, distances=6, currents=5)
    table.rows.drop(columns="mount").to_csv(tmp_path / "bench.csv", index=False)
    (tmp_path / "bench.toml").write_text("[noise]\ndistance_mm = 0.6\n")
    observations = compare(levitation_model, tmp_path / "bench.csv").observations
    assert "unused-setting" not in {one.code for one in observations.findings}
    np.testing.assert_allclose(observations.setting_columns[:, 0], 6e-4 * observations.distance_slope)


def test_the_first_of_groups_that_are_equally_unlikely_to_be_noise_is_reported():
    tests = [LackOfFit(2.0, count, 1e-4 * (1.0 - 1e-9) ** count) for count in (1, 2, 3)]
    groups = tuple(SimpleNamespace(test=lambda *_, one=one: one) for one in tests)
    assert PatternSpace(None, groups).test(np.ones(5)).degrees_of_freedom == 1
