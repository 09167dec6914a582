"""What must not change a verdict: order that is no evidence, units, names of runs, copies, channels without news."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.identify.bench import placed
from femfit.identify.noise.components import estimate_noise
from support.campaign import NOISE, campaign, hidden, noise_of

HALL = hidden("hall_offset", offset_V=0.02)
COLUMNS = ["run", "mount", "order", "current_A", "distance_m", "branch", *NOISE]
SIZE = {"runs": 3, "distances": 7, "currents": 5}


def written(table, folder, name="bench"):
    """The measurement as the user's file has it."""
    file = folder / f"{name}.csv"
    table.to_csv(file, index=False)
    return ff.read_measurement(file)


def told(model, data):
    """The noise and the comparison of a measurement; a diagnosis rests on what it compares."""
    comparison = ff.compare(model, data)
    noise = estimate_noise(comparison.observations)
    return np.concatenate([noise.sigma, noise.rho, noise.run, [noise.mount_m, noise.stop_m]]), comparison


def assert_same(one, other, rtol=1e-6):
    (noise, before), (same_noise, after) = one, other
    np.testing.assert_allclose(same_noise, noise, rtol=rtol)
    assert (after.verdict, after.where.channel) == (before.verdict, before.where.channel)
    assert after.p_value == pytest.approx(before.p_value, rel=1e-3, abs=1e-12)
    np.testing.assert_allclose([c.rms for c in after.channels], [c.rms for c in before.channels], rtol=rtol)


@pytest.fixture(scope="module")
def offset(levitation_model):
    """Readings of a bench with a Hall offset."""
    return campaign(levitation_model, 71, [HALL], **SIZE).rows[COLUMNS]


@pytest.fixture(scope="module")
def as_read(levitation_model, offset, tmp_path_factory):
    """What is told of them."""
    return told(levitation_model, written(offset, tmp_path_factory.mktemp("bench")))


def test_the_order_of_rows_is_no_evidence_without_a_clock(levitation_model, offset, tmp_path):
    rows = offset.drop(columns="order")
    as_read = told(levitation_model, written(rows, tmp_path, "rows"))
    shuffled = rows.groupby("run").sample(frac=1.0, random_state=1)
    assert_same(as_read, told(levitation_model, written(shuffled, tmp_path)))


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.nightly) for k in (2, 3))])
def test_noise_that_lasts_is_no_misfit_though_no_clock_tells_what_follows_what(levitation_model, tmp_path, seed):
    clean = campaign(levitation_model, seed, rho=0.6, mount_m=0.0, **SIZE).rows[COLUMNS].drop(columns="order")
    data = written(clean.sample(frac=1.0, random_state=seed), tmp_path)
    noise = estimate_noise(placed(levitation_model, data))
    np.testing.assert_allclose(noise.rho.mean(), 0.6, atol=0.2)  # four channels of some 130 repeats each
    assert ff.compare(levitation_model, data).verdict == "agrees"


@pytest.mark.parametrize("clock", [pytest.param(True, marks=pytest.mark.nightly), False])
def test_plateaus_one_after_the_other_do_not_excuse_a_model_that_is_a_quarter_wrong(levitation_model, tmp_path, clock):
    """25 hover plateaus in 9 runs up a staircase of the distance: a misfit of 2.3 sigma that changes slowly."""
    run = np.repeat(np.arange(1.0, 10.0), 3)[:25]
    d = np.linspace(0.018, 0.034, 25)
    force = levitation_model.force(d, np.full(25, 0.5))
    sigma = 0.25 * float(np.sqrt(np.mean(force**2))) / 2.3
    read = 1.25 * force + sigma * np.random.default_rng(3).standard_normal(25)
    rows = pd.DataFrame({"run": run, "current_A": 0.5, "distance_m": d, "force_N": read})
    rows = rows.assign(order=np.arange(25.0)) if clock else rows
    table = replace(written(rows, tmp_path), declared_noise={"force_N": sigma})
    comparison = ff.compare(levitation_model, table)
    assert estimate_noise(comparison.observations).run[0] < 0.5 * sigma  # nor is it an offset of the runs
    assert comparison.verdict == "fails"
    assert ff.diagnose(levitation_model, table).verdict != "nothing_missing"


MILLI = {"force_N": "force_mN", "distance_m": "distance_mm", "current_A": "current_mA"}
NAMES = {1.0: 40.0, 2.0: 7.0, 3.0: 11.0}


@pytest.mark.parametrize(
    ("rewritten", "rtol"),
    [
        (lambda rows: rows.groupby("run").sample(frac=1.0, random_state=1), 1e-6),
        # 1e-3 * (1e3 * x) is x to a rounding, which the search's ends may carry on
        (lambda rows: rows.assign(**{name: 1e3 * rows[name] for name in MILLI}).rename(columns=MILLI), 1e-5),
        (lambda rows: rows.assign(run=rows["run"].map(NAMES), mount=rows["mount"].map(NAMES)), 1e-6),
        (lambda rows: pd.concat([rows, rows]), 1e-6),  # rows that stand twice in a file are no repeats
    ],
    ids=["any order with a clock", "other units", "other names of runs", "rows twice"],
)
def test_what_says_the_same_is_told_alike(levitation_model, offset, as_read, tmp_path, rewritten, rtol):
    assert_same(as_read, told(levitation_model, written(rewritten(offset), tmp_path)), rtol)


@pytest.mark.nightly
@pytest.mark.parametrize("shape", ["wave", "offset"])
@pytest.mark.parametrize("declared", [False, True], ids=["repeats", "declared"])
def test_more_structure_never_looks_more_like_noise(levitation_model, declared, shape):
    """A wave is finer than the patterns of the test and the same in every run."""
    clean = campaign(levitation_model, 74, **SIZE | ({"runs": 1, "mount_m": 0.0} if declared else {}))
    clean = replace(clean, declared_noise=NOISE) if declared else clean
    d, i = (clean.rows[name].to_numpy() for name in ("distance_m", "current_A"))
    structure = np.sin(9e2 * d) * np.cos(5.0 * i) if shape == "wave" else np.full(len(d), 0.3)
    p_values = []
    for times in (1.0, 1.5, 2.0, 4.0):
        force = clean.rows["force_N"] + times * NOISE["force_N"] * structure
        comparison = ff.compare(levitation_model, replace(clean, rows=clean.rows.assign(force_N=force)))
        p_values.append(comparison.p_value)
    # Run offsets take up a constant error whole: such p-values are equal within what the variances converge to
    assert all(after <= before + 1e-5 for before, after in pairwise(p_values)), p_values
    assert p_values[-1] < p_values[0]
    if shape == "wave":  # 2 sigma rms: where patterns are too broad to see it, the sentence says it all the same
        assert set(comparison.beyond_noise) == {"force_N"}


@pytest.mark.parametrize("declared", [True, False], ids=["declared", "undeclared"])
@pytest.mark.parametrize("count", [2, 6, *(pytest.param(k, marks=pytest.mark.nightly) for k in (1, 12))])
def test_few_readings_are_neither_a_crash_nor_a_pass(levitation_model, declared, count):
    table = campaign(levitation_model, 75, [HALL], runs=1, distances=4, currents=3)
    few = replace(table, rows=table.rows.iloc[:count].reset_index(drop=True), declared_noise=NOISE if declared else {})
    comparison, diagnosis = ff.compare(levitation_model, few), ff.diagnose(levitation_model, few)
    assert comparison.verdict != "agrees"  # the Hall readings are seven times their noise off
    if count < 6 or not declared:
        assert {comparison.verdict, diagnosis.verdict} == {"compare_only"}
        assert comparison.findings[-1].code == diagnosis.findings[-1].code in {"too-few-readings", "no-noise"}
        with pytest.raises(TableError):
            ff.add_effects(levitation_model, few, ["hall_offset"])


@pytest.mark.parametrize(("effects", "wild"), [([], 3), ([HALL], 1)])
def test_a_wild_reading_neither_names_an_effect_nor_hides_one(levitation_model, effects, wild):
    """A decimal point that slipped, in one and in three of 200 readings of the force."""
    table = campaign(levitation_model, 76, effects, runs=2, distances=8, currents=6)
    rows = table.rows.copy()
    # Where there is a force to slip
    places = np.random.default_rng(wild).choice(np.flatnonzero(rows["force_N"] > 0.02), wild, replace=False)
    rows.loc[places, "force_N"] *= 10.0
    found = ff.diagnose(levitation_model, replace(table, rows=rows))
    assert [one.name for one in found.missing] == [one.effect.name for one in effects]
    (finding,) = [one for one in found.findings if one.code == "outliers"]
    assert finding.size == wild


def test_settings_that_are_measured_twice_leave_the_noise_as_it_is(levitation_model):
    once, rng = campaign(levitation_model, 72, **SIZE), np.random.default_rng(1)
    base, again = placed(levitation_model, once), once.rows.assign(order=once.rows["order"] + 200.0)
    for name, sigma in NOISE.items():
        again[name] = base.base[base.of(name)] + sigma * rng.standard_normal(len(again))
    rows = pd.concat([once.rows, again], ignore_index=True)
    noise, more = noise_of(levitation_model, once), noise_of(levitation_model, once, rows=rows)
    # From some 120 repeats, correlated by 0.3, and from 330: 7 % and 4 % standard errors
    np.testing.assert_allclose(more.sigma, noise.sigma, rtol=0.25)
    assert (more.repeats > 2.0 * noise.repeats).all()
