"""Beside a model, wrong units, clipped readings and lone outliers show; physical effects do not look like them."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.effects.catalogue import all_effects
from femfit.effects.effect import AddedEffect
from femfit.identify.experiments.plan import possible_experiments
from femfit.identify.readings.bench import bench_observations
from femfit.identify.readings.plausible import plausible_table, suspect_units
from femfit.identify.signatures import why_untestable
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import with_effects
from support.campaign import NOISE, campaign


def with_columns(table, **columns):
    return replace(table, rows=table.rows.assign(**columns))


@pytest.fixture(scope="module")
def table(levitation_model):
    return campaign(levitation_model, 21)


@pytest.mark.parametrize(
    ("column", "change", "words"),
    [
        ("force_N", lambda x: 1e3 * x, "in mN"),
        ("force_N", lambda x: x / 9.80665, "in kgf"),
        ("force_N", lambda x: -1e3 * x / 9.80665, "in gf and of the other sign"),
        ("force_N", lambda x: -x, "of the other sign"),
        ("flux_linkage_Wb", lambda x: 1e3 * x, "in mWb"),
        ("flux_linkage_Wb", lambda x: -x, "of the other sign"),
        ("hall_V", lambda x: 1e3 * x, "in mV"),
        ("hall_V", lambda x: (x - 2.5) / 50.0, "a field in T"),
        ("hall_V", lambda x: 5.0 - x, "of the other polarity"),
        ("hall_V", lambda x: x - 2.5, "without its quiescent voltage"),
        ("distance_m", lambda x: 1e3 * x, "in mm"),
        ("distance_m", lambda x: x / 25.4e-3, "in inch"),
        ("current_A", lambda x: 1e3 * x, "in mA"),
    ],
)
def test_a_wrong_unit_or_sign_is_suspected_by_its_name(levitation_model, table, column, change, words):
    findings = suspect_units(levitation_model, with_columns(table, **{column: change(table.rows[column])}))
    assert len(findings) == 1
    assert str(findings[0]).startswith(f"{column} seems to be {words}")


@pytest.mark.parametrize(
    ("column", "change", "code", "size"),
    [
        ("force_N", lambda x: 2.0 * x, "suspected-scale", 2.0),
        ("flux_linkage_Wb", lambda x: x / 3.0, "suspected-scale", 1.0 / 3.0),
        ("voltage_V", lambda x: 2.5 * x, "suspected-scale", 2.5),
        ("hall_V", lambda x: 2.5 + 0.4 * (x - 2.5), "suspected-scale", 0.4),
        ("force_N", lambda x: x + 4.35e-3 * 9.80665, "suspected-weight", 4.35e-3 * 9.80665),
        ("force_N", lambda x: x - 4.35e-3 * 9.80665, "suspected-weight", -4.35e-3 * 9.80665),
        ("distance_m", lambda x: x - 3e-3, "suspected-zero", 3e-3),
        ("distance_m", lambda x: x + 5e-3, "suspected-zero", -5e-3),
    ],
)
def test_what_a_whole_column_is_wrong_by_is_said(levitation_model, table, column, change, code, size):
    findings = suspect_units(levitation_model, with_columns(table, **{column: change(table.rows[column])}))
    assert [(one.code, one.column) for one in findings] == [(code, column)]
    assert findings[0].size == pytest.approx(size, rel=0.05)


def test_a_sound_table_is_suspected_of_nothing(levitation_model, table):
    assert suspect_units(levitation_model, table) == []


def test_a_table_of_voltages_alone_says_nothing_of_the_distance(levitation_model, table):
    voltages = replace(table, given=("run", "current_A", "distance_m", "voltage_V"))
    assert suspect_units(levitation_model, voltages) == []


def test_a_current_that_counts_the_other_way_is_told_from_turned_channels(levitation_model):
    box = levitation_model.validity
    both = replace(levitation_model, validity=replace(box, current_min_A=-1.4))
    table = campaign(both, 22)
    assert suspect_units(both, table) == []
    (finding,) = suspect_units(both, with_columns(table, current_A=-table.rows["current_A"], voltage_V=np.nan))
    assert str(finding).startswith("current_A seems to be of the other sign")


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
    assert (checked.findings[-1].code, checked.findings[-1].column) == ("clipped", "hall_V")


def test_beside_a_model_an_outlier_of_twenty_sigma_is_found(levitation_model, table):
    rows = table.rows.copy()
    rows.loc[123, "force_N"] += 20 * NOISE["force_N"]
    checked = plausible_table(levitation_model, replace(table, rows=rows))
    assert np.flatnonzero(checked.rows["force_N"].isna()).tolist() == [123]
    assert (checked.findings[-1].code, checked.findings[-1].column) == ("outliers", "force_N")


def test_a_current_in_milliampere_is_suspected_although_none_is_none_in_any_unit(levitation_model, table):
    often = np.where(np.arange(len(table.rows)) % 3 == 0, 0.0, 1e3 * table.rows["current_A"])
    (finding,) = suspect_units(levitation_model, with_columns(table, current_A=often))
    assert str(finding).startswith("current_A seems to be in mA")


def test_amperes_beyond_the_model_are_not_suspected_to_be_milliamperes(levitation_model, table):
    beyond = with_columns(table, current_A=3.0 * table.rows["current_A"] + 1.5)
    assert not [one for one in suspect_units(levitation_model, beyond) if one.column == "current_A"]


def test_a_turned_hall_element_is_told_from_readings_that_were_clipped(levitation_model, table):
    strong = replace(levitation_model, sensor=replace(levitation_model.sensor, sensitivity_V_per_T=300.0))
    rows = campaign(strong, 24).rows
    turned = replace(table, rows=rows.assign(hall_V=np.clip(5.0 - rows["hall_V"], 0.0, 5.0)))
    assert (turned.rows["hall_V"] == 0.0).mean() > 0.2
    (finding,) = suspect_units(strong, turned)
    assert str(finding).startswith("hall_V seems to be of the other polarity")


def test_the_effects_that_a_model_has_belong_to_what_it_predicts(levitation_model):
    """A force sensor that is known to read 0.3 of the largest force more is no reading of another sign."""
    offset = AddedEffect(all_effects()["force_offset"], {"offset": 0.3})
    model = with_effects(levitation_model, [offset])
    table = campaign(levitation_model, 22, [offset])
    rows = table.rows.copy()
    rows.loc[7, "force_N"] *= 1.5  # beside its prediction, and beside its neighbours
    kept = plausible_table(model, replace(table, rows=rows))
    assert kept.rows["force_N"].isna().sum() == 1
    assert not suspect_units(model, table)


def test_currents_beyond_a_linear_models_sweep_are_counted(levitation_model):
    box = levitation_model.validity
    narrow = replace(levitation_model, validity=replace(box, current_max_A=0.5 * box.current_max_A))
    table = campaign(levitation_model, 23)
    (finding,) = [f for f in bench_observations(narrow, table).findings if f.code == "extrapolated"]
    beyond = int((table.rows["current_A"] > 0.51 * box.current_max_A).sum())
    assert str(beyond) in str(finding)


def test_iron_that_saturates_is_not_carried_on_beyond_the_models_currents(levitation_model):
    box, kind = levitation_model.validity, ActuatorKind(False, True, True, False, True, True)
    narrow = replace(levitation_model, validity=replace(box, current_max_A=0.5 * box.current_max_A), kind=kind)
    observations = bench_observations(narrow, campaign(levitation_model, 23))
    assert {"outside-domain"} <= {one.code for one in observations.findings}
    assert "extrapolated" not in {one.code for one in observations.findings}
    assert observations.covariates["current_A"].max() <= 0.52 * box.current_max_A


def test_no_magnet_is_heated_or_blamed_where_none_is_known(levitation_model):
    energised = replace(levitation_model, validity=replace(levitation_model.validity, current_min_A=0.25))
    observations = bench_observations(energised, campaign(levitation_model, 23))
    assert not [one.text for one in possible_experiments(observations, (), []) if "magnet" in one.text]
    assert "unknown" in why_untestable(all_effects()["magnet_temperature"], observations)


def test_every_proposed_setting_lies_in_the_models_validity_domain(levitation_model):
    box = levitation_model.validity
    narrow = replace(levitation_model, validity=replace(box, current_max_A=0.5 * box.current_max_A))
    observations = bench_observations(narrow, campaign(levitation_model, 23))
    assert observations.covariates["current_A"].max() > narrow.validity.current_max_A
    proposed = [one.rows for one in possible_experiments(observations, ("force_N",), []) if one.rows is not None]
    for rows in proposed:
        assert narrow.validity.contains(rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()).all()
