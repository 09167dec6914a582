"""What tables tell beside a model: units, rails, outliers, reach, the path of the current, a bridge's readings."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.bench import bench_observations
from femfit.identify.plan import possible_experiments
from femfit.identify.plausible import plausible_table, suspect_units
from femfit.identify.settings import conditions_of
from femfit.identify.signatures import why_untestable
from femfit.model.readings import predict_readings
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import nominal_of, with_effects
from support.campaign import NOISE, campaign, settings
from support.one_current import within


def with_columns(table, **columns):
    return replace(table, rows=table.rows.assign(**columns))


def told(findings):
    return [(one.code, one.column) for one in findings]


@pytest.fixture(scope="module")
def table(levitation_model):
    return campaign(levitation_model, 21)


@pytest.mark.parametrize(("factor", "words"), [(1e3, "in mN"), (-1.0, "of the other sign")])
def test_one_run_in_another_unit_is_named_with_its_rows(levitation_model, factor, words):
    table = campaign(levitation_model, 22, runs=3)
    last = table.rows["run"] == table.rows["run"].max()
    force = table.rows["force_N"] * np.where(last, factor, 1.0)
    (finding,) = suspect_units(levitation_model, with_columns(table, force_N=force))
    assert str(finding).startswith(f"force_N of run 3 seems to be {words}: it is {factor:g}")
    assert str(finding).endswith("Convert these rows alone.")


@pytest.mark.parametrize(
    ("column", "change", "words", "size"),
    [
        ("force_N", lambda x: 1e3 * x, "in mN", None),
        ("force_N", lambda x: x / 9.80665, "in kgf", None),
        ("force_N", lambda x: -1e3 * x / 9.80665, "in gf", None),
        ("force_N", lambda x: -x, "other sign", None),
        ("flux_linkage_Wb", lambda x: 1e3 * x, "in mWb", None),
        ("flux_linkage_Wb", lambda x: -x, "other sign", None),
        ("hall_V", lambda x: 1e3 * x, "in mV", None),
        ("hall_V", lambda x: (x - 2.5) / 50.0, "in T", None),
        ("hall_V", lambda x: 5.0 - x, "other polarity", None),
        ("hall_V", lambda x: x - 2.5, "quiescent voltage", None),
        ("distance_m", lambda x: 1e3 * x, "in mm", None),
        ("distance_m", lambda x: x / 25.4e-3, "in inch", None),
        ("current_A", lambda x: 1e3 * x, "in mA", None),
        ("force_N", lambda x: 2.0 * x, "suspected-scale", 2.0),
        ("flux_linkage_Wb", lambda x: x / 3.0, "suspected-scale", 1.0 / 3.0),
        ("voltage_V", lambda x: 2.5 * x, "suspected-scale", 2.5),
        ("hall_V", lambda x: 2.5 + 0.4 * (x - 2.5), "suspected-scale", 0.4),
        ("distance_m", lambda x: x - 3e-3, "suspected-zero", 3e-3),
        ("distance_m", lambda x: x + 5e-3, "suspected-zero", -5e-3),
    ],
)
def test_a_wrong_unit_or_sign_and_what_a_whole_column_is_wrong_by_are_said(
    levitation_model, table, column, change, words, size
):
    (finding,) = suspect_units(levitation_model, with_columns(table, **{column: change(table.rows[column])}))
    assert str(finding).startswith(column)
    assert words in f"{finding} {finding.code}"
    assert size is None or finding.size == pytest.approx(size, rel=0.05)


def test_a_channel_of_zeros_has_no_signal_and_is_no_factor_of_the_models(levitation_model, table):
    (finding,) = suspect_units(levitation_model, with_columns(table, force_N=0.0))
    assert str(finding) == "force_N has no signal at any setting. Connect the sensor, or leave the column out."


def test_a_sound_table_and_one_of_voltages_alone_are_suspected_of_nothing(levitation_model, table):
    assert suspect_units(levitation_model, table) == []
    voltages = replace(table, given=("run", "current_A", "distance_m", "voltage_V"))
    assert suspect_units(levitation_model, voltages) == []


def test_a_current_that_counts_the_other_way_is_told_from_turned_channels(levitation_model):
    both = replace(levitation_model, validity=within(levitation_model.validity, low=-1.4))
    table = campaign(both, 22)
    assert suspect_units(both, table) == []
    turned = with_columns(table, current_A=-table.rows["current_A"], voltage_V=np.nan)
    assert told(suspect_units(both, turned)) == [("suspected-sign", "current_A")]


@pytest.mark.parametrize("name", all_effects())
def test_no_effect_at_the_end_of_its_usual_range_looks_like_a_wrong_unit_or_an_outlier(levitation_model, name):
    effect = all_effects()[name]
    largest = {p.name: p.null if p.nonlinear else p.plausible[1] for p in effect.parameters}
    table = campaign(levitation_model, 23, [AddedEffect(effect, largest)], distances=8, currents=6)
    checked = plausible_table(levitation_model, table)
    assert {one.code for one in checked.findings} <= {"clipped"}
    for channel in ("force_N", "flux_linkage_Wb", "voltage_V"):
        assert checked.rows[channel].notna().all()


def test_readings_at_the_rails_are_set_aside(levitation_model, table):
    clipped = with_columns(table, hall_V=np.clip(table.rows["hall_V"] + 2.2, None, 5.0))
    checked = plausible_table(levitation_model, clipped)
    assert (checked.rows["hall_V"].isna() == (clipped.rows["hall_V"] >= 5.0 - 5.0 / 4096)).all()
    assert told(checked.findings)[-1] == ("clipped", "hall_V")
    assert "there it is clipped" in str(checked.findings[-1])
    beyond = plausible_table(levitation_model, with_columns(table, hall_V=table.rows["hall_V"] + 2.2)).findings[-1]
    assert ("No clipped output reads beyond its range" in str(beyond), beyond.severity) == (True, "warning")


def test_beside_a_model_an_outlier_of_twenty_sigma_is_found(levitation_model, table):
    rows = table.rows.copy()
    rows.loc[123, "force_N"] += 20 * NOISE["force_N"]
    checked = plausible_table(levitation_model, replace(table, rows=rows))
    assert np.flatnonzero(checked.rows["force_N"].isna()).tolist() == [123]
    assert told(checked.findings)[-1] == ("outliers", "force_N")


def test_milliamperes_are_suspected_although_none_is_none_in_any_unit_and_amperes_beyond_the_model_are_not(
    levitation_model, table
):
    often = np.where(np.arange(len(table.rows)) % 3 == 0, 0.0, 1e3 * table.rows["current_A"])
    thousand = with_columns(table, current_A=often)
    assert told(suspect_units(levitation_model, thousand)) == [("suspected-unit", "current_A")]
    found = ff.diagnose(levitation_model, thousand)  # whose columns are 1e5 times the noise
    assert str(found).startswith("Check first: current_A seems to be in mA")
    beyond = with_columns(table, current_A=3.0 * table.rows["current_A"] + 1.5)
    assert "current_A" not in {one.column for one in suspect_units(levitation_model, beyond)}


def test_the_effects_that_a_model_has_belong_to_what_it_predicts(levitation_model):
    """A force sensor that is known to read 0.3 of the largest force more is no reading of another sign."""
    offset = AddedEffect(all_effects()["force_offset"], {"offset": 0.3})
    model, table = with_effects(levitation_model, [offset]), campaign(levitation_model, 22, [offset])
    rows = table.rows.copy()
    rows.loc[7, "force_N"] *= 1.5  # beside its prediction, and beside its neighbours
    kept = plausible_table(model, replace(table, rows=rows))
    assert kept.rows["force_N"].isna().sum() == 1
    assert not suspect_units(model, table)


@pytest.fixture(scope="module")
def narrow(levitation_model):
    """Of half the largest current."""
    box = levitation_model.validity
    return replace(levitation_model, validity=within(box, high=0.5 * box.current_max_A))


def test_currents_beyond_a_linear_models_sweep_are_counted_and_no_setting_beyond_is_proposed(narrow, table):
    observations, most = bench_observations(narrow, table), narrow.validity.current_max_A
    (finding,) = (one for one in observations.findings if one.code == "extrapolated")
    assert str(int((table.rows["current_A"] > 1.02 * most).sum())) in str(finding)
    assert observations.covariates["current_A"].max() > most
    proposed = [one.rows for one in possible_experiments(observations, ("force_N",), []) if one.rows is not None]
    for rows in proposed:
        assert narrow.validity.contains(rows["distance_m"].to_numpy(), rows[["current_A"]].to_numpy()).all()


def test_iron_that_saturates_is_not_carried_on_beyond_the_models_currents(narrow, table):
    kind = ActuatorKind(False, True, True, False, True, True)
    observations = bench_observations(replace(narrow, kind=kind), table)
    codes = {one.code for one in observations.findings}
    assert "outside-domain" in codes
    assert "extrapolated" not in codes
    assert observations.covariates["current_A"].max() <= 1.04 * narrow.validity.current_max_A


def test_no_magnet_is_heated_or_blamed_where_none_is_known(levitation_model):
    energised = replace(levitation_model, validity=within(levitation_model.validity, low=0.25))
    observations = bench_observations(energised, campaign(levitation_model, 23))
    assert not [one.text for one in possible_experiments(observations, (), []) if "magnet" in one.text]
    assert "unknown" in why_untestable(all_effects()["magnet_temperature"], observations)


def test_a_table_of_other_distances_is_refused_with_both_ranges_and_the_unit(levitation_model, table):
    box = levitation_model.validity
    with pytest.raises(TableError, match=r"distance_m.* in mm"):
        bench_observations(levitation_model, with_columns(table, distance_m=1e3 * table.rows["distance_m"]))
    with pytest.raises(TableError) as caught:
        bench_observations(levitation_model, with_columns(table, distance_m=1.5 * box.distance_max_m))
    for range_m in (f"{box.distance_min_m:g} to {box.distance_max_m:g} m", f"{1.5 * box.distance_max_m:g}"):
        assert range_m in str(caught.value)


@pytest.fixture
def recalled(levitation_model):
    """What the iron recalls of rows with these currents and branches, which stand in a table in an order."""

    def of(current, branch, order=slice(None)):
        time = np.arange(float(len(current)))
        rows = pd.DataFrame({"current_A": current, "branch": branch, "order": time, "elapsed": time, "run": 1.0})
        unread = dict.fromkeys(("coil_temperature_C", "magnet_temperature_C"), np.nan)
        rows = rows.assign(mount=1.0, distance_m=0.02, **unread).iloc[order].reset_index(drop=True)
        return conditions_of(rows, nominal_of(levitation_model)).recalled

    return of


CURRENT = np.array([0.2, 0.6, 1.0, 1.4, 1.0, 0.6, 0.2])
BRANCH = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0])


def test_rows_in_the_order_of_measuring_tell_the_path_wherever_they_stand_and_rows_sorted_by_current_do_not(recalled):
    there, order = recalled(CURRENT, BRANCH), np.array([3, 0, 6, 2, 5, 1, 4])
    virgin = there["hysteresis_medium_virgin"]
    assert virgin[1] > 0.0 > virgin[-1]
    assert virgin[2] > virgin[4]  # at the same current on the way up and on the way down
    here = recalled(CURRENT, BRANCH, order)
    for name, values in there.items():
        np.testing.assert_array_equal(here[name], values[order])
    by_current = np.argsort(CURRENT, kind="stable")
    assert not recalled(CURRENT[by_current], BRANCH[by_current])


def test_an_ammeter_that_trembles_moves_no_wall(recalled):
    currents, branch = np.repeat(CURRENT, 2), np.repeat(BRANCH, 2)
    seen = recalled(currents + np.tile([0.0, 1e-3], 7), branch)
    for name, values in recalled(currents, branch).items():
        np.testing.assert_allclose(seen[name], values, atol=1e-12)


BOTH = ("inductance_H", "resistance_ohm")


def bridge_file(model, path):
    """An LCR sweep of four runs, in millihenry and ohm."""
    rows = settings(model, runs=4, distances=8, currents=5)
    rows = rows[rows["branch"] > 0].reset_index(drop=True)
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    read = predict_readings(model, d, i, Conditions(nominal_of(model)), channels=BOTH)
    noise = np.random.default_rng(1).standard_normal((2, len(rows)))
    table = {"run": rows["run"], "mount": 1, "gap [mm]": 1e3 * d, "I [A]": i}
    table["L [mH]"] = 1e3 * (read["inductance_H"] + 2e-6 * noise[0])
    table["R [Ohm]"] = read["resistance_ohm"] + 2e-3 * noise[1]
    pd.DataFrame(table).to_csv(path, index=False)
    return path


def test_a_sweep_of_a_bridge_is_compared(levitation_model, tmp_path):
    comparison = ff.compare(levitation_model, bridge_file(levitation_model, tmp_path / "lcr.csv"))
    assert comparison.verdict == "agrees"
    noise = {one.channel: one.noise_floor for one in comparison.channels}
    assert set(noise) == set(BOTH)
    assert noise["inductance_H"] == pytest.approx(2e-6, rel=0.3)
    assert noise["resistance_ohm"] == pytest.approx(2e-3, rel=0.3)


def test_a_turned_hall_element_is_told_from_readings_that_were_clipped(levitation_model, table):
    strong = replace(levitation_model, sensor=replace(levitation_model.sensor, sensitivity_V_per_T=300.0))
    rows = campaign(strong, 24).rows
    turned = replace(table, rows=rows.assign(hall_V=np.clip(5.0 - rows["hall_V"], 0.0, 5.0)))
    assert (turned.rows["hall_V"] == 0.0).mean() > 0.2
    assert told(suspect_units(strong, turned)) == [("suspected-unit", "hall_V")]


def test_a_misfit_that_no_effect_changes_is_unexplained(levitation_model, tmp_path):
    rows = pd.read_csv(bridge_file(levitation_model, tmp_path / "lcr.csv"))
    rows["R [Ohm]"] *= 1.0 + 0.02 * rows["gap [mm]"] / 45.0
    rows.drop(columns="L [mH]").to_csv(tmp_path / "r.csv", index=False)
    found = ff.diagnose(levitation_model, tmp_path / "r.csv", exclude=("resistance", "coil_temperature"))
    assert found.verdict == "unexplained"
