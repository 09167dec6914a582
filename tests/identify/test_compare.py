"""A comparison says how bad, against which noise, and whether the law or the physics is to blame."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.finding import Finding
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.compare import compare_bench
from femfit.identify.comparison.compare_text import comparison_lines
from femfit.model.actuator_model import Misfit
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.tables.suspected_units import suspicion
from support.campaign import NOISE, campaign

HALL = AddedEffect(effect_by_name("hall_offset"), {"offset_V": 0.02})


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
    misfit = Misfit(rms, float(np.abs(error).max()), 0.1, None, None, None, len(d), "sweep")
    return replace(levitation_model, magnetics=law, misfit=misfit, validity=box), rms


@pytest.mark.parametrize("mount_m", [0.0, 50e-6])
def test_clean_data_agree_whatever_the_remounts(levitation_model, mount_m):
    comparison = compare_bench(levitation_model, campaign(levitation_model, 11, mount_m=mount_m))
    assert comparison.verdict == "agrees"
    assert comparison.where.channel == ""
    for one in comparison.channels:
        assert one.noise_floor == pytest.approx(NOISE[one.channel], rel=0.2)  # about 250 repeats, correlated by 0.3
        assert one.lack_of_fit.p_value > 1e-3
    if mount_m:
        assert comparison.mount_m == pytest.approx(mount_m, rel=0.8)  # three mounts


def test_a_pure_error_test_accuses_the_channel_that_is_wrong_and_no_other(levitation_model):
    comparison = compare_bench(levitation_model, campaign(levitation_model, 12, [HALL]))
    assert comparison.verdict == "fails"
    assert comparison.where.channel == "hall_V"
    tests = {name: one.lack_of_fit.p_value for name, one in by_channel(comparison).items()}
    assert tests.pop("hall_V") < 1e-6
    assert min(tests.values()) > 1e-3
    assert by_channel(comparison)["hall_V"].mean == pytest.approx(0.02, abs=1e-3)


def test_rms_and_maximum_are_those_of_recorded_minus_predicted(levitation_model):
    table = campaign(levitation_model, 13)
    rows = table.rows.copy()
    worst = int(rows["force_N"].idxmin())
    rows.loc[worst, "force_N"] += 0.05
    one = by_channel(compare_bench(levitation_model, replace(table, rows=rows)))["force_N"]
    assert one.largest.value == pytest.approx(0.05, abs=5 * NOISE["force_N"])
    assert (one.largest.distance_m, one.largest.current_A) == tuple(rows.loc[worst, ["distance_m", "current_A"]])
    assert one.rms**2 * one.readings >= 0.049**2


def test_a_law_is_blamed_for_its_own_shape_before_any_measurement(levitation_model, law_model):
    law, rms = law_model
    comparison = compare_bench(law, campaign(levitation_model, 14))
    assert comparison.verdict == "wrong_shape"
    assert comparison.shape.wrong
    assert comparison.shape.force_rms_N == rms
    assert "wrong shape before any measurement" in comparison.shape.sentence
    beside = compare_bench(law, campaign(levitation_model, 14), levitation_model).shape
    assert beside.against == "co-energy reference"
    assert beside.force_rms_N == pytest.approx(rms, rel=0.1)  # another grid over the same box
    assert "The law's force is " in beside.sentence
    assert compare_bench(levitation_model, campaign(levitation_model, 14)).shape is None


def test_without_a_noise_floor_there_is_no_verdict_but_a_place(levitation_model):
    table = campaign(levitation_model, 15, [HALL], runs=1)
    rising = replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))
    comparison = compare_bench(levitation_model, rising)
    assert (comparison.verdict, comparison.where.channel) == ("compare_only", "hall_V")
    assert comparison.structure is None
    assert all(one.noise_floor is None and one.lack_of_fit is None for one in comparison.channels)
    assert comparison.findings[-1].code == "no-noise-floor"
    declared = compare_bench(levitation_model, replace(rising, declared_noise=NOISE))
    assert declared.verdict == "fails"
    assert by_channel(declared)["hall_V"].noise_source == "declared"


def test_maps_hold_every_reading_once(levitation_model):
    table = campaign(levitation_model, 16)
    maps = compare_bench(levitation_model, table).maps
    count = int(table.rows["force_N"].notna().sum())
    force = {one.along: one for one in maps if one.channel == "force_N"}
    assert {("distance_m", "current_A"), ("branch",), ("run",), ("mount",), ("order",)} <= set(force)
    assert {sum(cell.readings for cell in one.cells) for one in force.values()} == {count}
    assert len(force["distance_m", "current_A"].cells) == 10 * 7
    assert [cell.at for cell in force["branch",].cells] == [(-1.0,), (1.0,)]


def test_the_text_names_channel_noise_and_verdict(levitation_model):
    lines = comparison_lines(compare_bench(levitation_model, campaign(levitation_model, 17, [HALL])))
    assert any(line.startswith("Hall output: rms misfit 20 mV") for line in lines)
    assert "The model fails: Measured Hall output is 20 mV high everywhere, in both branches." in lines


def test_a_channel_of_which_nothing_is_left_is_passed_over(levitation_model):
    table = campaign(levitation_model, 18)
    emptied = replace(table, rows=table.rows.assign(hall_V=np.nan))
    assert "hall_V" not in by_channel(compare_bench(levitation_model, emptied))


def test_a_suspected_unit_comes_before_all_numbers(levitation_model):
    finding = suspicion("force_N", "mN", "it would then fit the model")
    left_out = Finding("copies", "info", "1 row was left out.")
    table = replace(campaign(levitation_model, 19), findings=(left_out, finding))
    lines = comparison_lines(compare_bench(levitation_model, table))
    assert lines[0] == f"check first: {finding}"
    assert lines[-1] == "note: 1 row was left out."


@pytest.mark.parametrize(("given", "words"), [(True, "from mount to mount"), (False, "from run to run")])
def test_the_scatter_of_the_distance_is_of_mounts_only_where_mounts_are_told(levitation_model, given, words):
    table = campaign(levitation_model, 20, mount_m=300e-6)
    columns = table.given if given else tuple(name for name in table.given if name != "mount")
    text = "\n".join(comparison_lines(compare_bench(levitation_model, replace(table, given=columns))))
    assert f"{words} the distance scatters by about" in text
    assert f"agrees with these data within their noise and the distance's scatter {words}." in text
