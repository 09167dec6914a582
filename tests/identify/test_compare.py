"""A comparison says how bad, against which noise, where, and whether the law or the physics is to blame."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.effects.conditions import Conditions
from femfit.identify.bench import bench_observations, placed
from femfit.identify.decision.campaign import gather
from femfit.identify.decision.remarks import campaign_remarks
from femfit.identify.lack_of_fit import describe_misfit, where_it_fails
from femfit.identify.misfit import measured_curves
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.readings import predict_readings
from femfit.model.validity import ValidityBox
from femfit.model.with_effects import nominal_of
from support.campaign import LARGE, NOISE, OF_POT, campaign, hidden, observed, rising, without
from support.one_current import flat

HALL = hidden("hall_offset", offset_V=0.02)


def by_channel(comparison):
    return {one.channel: one for one in comparison.channels}


def columns(findings, code):
    return [one.column for one in findings if one.code == code]


@pytest.mark.parametrize("held", [0.0, pytest.param(0.025, marks=pytest.mark.nightly)])
def test_a_channel_that_never_varies_has_no_noise_and_says_so(levitation_model, held):
    table = campaign(levitation_model, 11)
    table = replace(table, rows=table.rows.assign(force_N=held), declared_noise={})
    comparison = ff.compare(levitation_model, table)
    assert by_channel(comparison)["force_N"].noise_floor is None
    assert columns(comparison.findings, "never-varies") == ["force_N"]
    assert by_channel(comparison)["hall_V"].noise_floor == pytest.approx(NOISE["hall_V"], rel=0.2)


def test_a_command_that_repeats_itself_is_no_dead_sensor(levitation_model):
    found = gather(observed(levitation_model, 11), [])
    noise = replace(found.noise, never_varying=("voltage_balance_V", "force_N"))
    remarks = campaign_remarks(replace(found, whitening=replace(found.whitening, noise=noise)))
    assert columns(remarks, "never-varies") == ["force_N"]


def test_rms_and_maximum_are_those_of_recorded_minus_predicted(levitation_model):
    table = campaign(levitation_model, 13)
    rows = table.rows.copy()
    worst = int(rows["force_N"].idxmin())
    near = (rows["distance_m"] == rows["distance_m"][worst]) & (rows["current_A"] == rows["current_A"][worst])
    rows.loc[near, "force_N"] += 0.01  # a single one would be set aside
    one = by_channel(ff.compare(levitation_model, replace(table, rows=rows)))["force_N"]
    assert one.largest.value == pytest.approx(0.01, abs=5 * NOISE["force_N"])
    assert (one.largest.distance_m, one.largest.current_A) == tuple(rows.loc[worst, ["distance_m", "current_A"]])
    assert one.rms**2 * one.readings >= near.sum() * 0.009**2


def test_without_a_noise_floor_there_is_no_verdict_but_a_place(levitation_model):
    table = campaign(levitation_model, 15, [HALL], runs=1)
    comparison = ff.compare(levitation_model, rising(table, every=5))
    assert (comparison.verdict, comparison.where.channel) == ("compare_only", "hall_V")
    assert comparison.structure is None
    assert all(one.noise_floor is None for one in comparison.channels)
    assert comparison.findings[-1].code == "no-noise"
    declared = ff.compare(levitation_model, replace(rising(table), declared_noise=NOISE))
    assert declared.verdict == "fails"
    assert by_channel(declared)["hall_V"].noise_source == "declared"


@pytest.mark.parametrize("unread", [(), ("mount",)])
def test_the_freedom_of_the_mounts_is_said(levitation_model, unread):
    table = without(campaign(levitation_model, 20, mount_m=300e-6, **LARGE), *unread)
    comparison = ff.compare(levitation_model, table)
    assert (comparison.verdict, comparison.where.channel) == ("agrees", "")
    assert comparison.noise.mount_m == pytest.approx(300e-6, rel=0.9)  # three mounts
    assert not comparison.noise.mount_assumed  # they contradict the 20 um that are assumed otherwise


@pytest.mark.nightly
def test_what_assumed_mounts_would_make_is_said_to_rest_on_them(levitation_model):
    """Two runs do not show how well a body comes back: what 20 um make is neither noise nor missing.

    A body that comes back by more than twice as far by chance, one in twenty, is beyond what was declared, too.
    """
    noise, beyond = {name: 0.2 * sd for name, sd in NOISE.items()}, []
    for seed in range(20, 22):
        table = campaign(levitation_model, seed, runs=2, mount_m=20e-6, rho=0.0, noise=noise)
        comparison = ff.compare(levitation_model, table)
        assert comparison.noise.mount_assumed
        assert "(from few mounts and what is usual)" in str(comparison)
        assert ("Declare distance_mm" in str(comparison)) == bool(comparison.beyond_noise)
        declared = ff.compare(levitation_model, replace(table, declared_noise={"distance_m": 20e-6}))
        beyond.append((comparison.verdict == "agrees", bool(comparison.beyond_noise), bool(declared.beyond_noise)))
    agreeing, assumed, known = np.sum(beyond, axis=0)
    assert agreeing == 2
    assert assumed > known


def test_a_channel_that_was_read_in_one_run_is_not_judged(levitation_model):
    """A voltage that was read in one run of three has no repeats; a resistance that is wrong would not be seen."""
    table = campaign(levitation_model, 23, rho=0.0)
    once = table.rows["run"] == 1.0
    rows = table.rows.assign(voltage_V=table.rows["voltage_V"].where(once) * 1.1)
    for one in ff.compare(levitation_model, replace(table, rows=rows)).channels:
        assert (one.noise_floor is None) is (one.channel == "voltage_V")


@pytest.mark.parametrize(("times", "missed"), [(1.8, False), (3.0, True)])
def test_few_readings_that_scatter_as_by_chance_are_within_their_noise(levitation_model, times, missed):
    """Three readings of noise have an rms of more than 1.94 sigma once in a hundred campaigns, of 1.3 in one of six."""
    table = campaign(levitation_model, 24, mount_m=0.0, rho=0.0)
    rows, kept = table.rows.copy(), table.rows.index[[5, 40, 75]]
    distance, current = rows["distance_m"][kept].to_numpy(), rows["current_A"][kept].to_numpy()
    rows["force_N"] = np.nan
    off = times * NOISE["force_N"] * np.array([1.0, -1.0, 1.0])
    rows.loc[kept, "force_N"] = levitation_model.force(distance, current) + off
    comparison = ff.compare(levitation_model, replace(table, rows=rows, declared_noise=NOISE))
    assert ("force_N" in comparison.beyond_noise) is missed
    assert by_channel(comparison)["force_N"].rms == pytest.approx(times * NOISE["force_N"], rel=1e-6)


@pytest.mark.parametrize("offset_m", [0.0, pytest.param(3e-5, marks=pytest.mark.nightly), 5e-5])
def test_compare_and_diagnose_never_disagree(levitation_model, offset_m):
    """Of a single run without mounts, which has no freedom to be put back."""
    table = campaign(levitation_model, 30, [hidden("distance_offset", offset_m=offset_m)], runs=1, mount_m=0.0)
    table = without(replace(table, declared_noise=NOISE), "mount", "run")
    comparison, diagnosis = ff.compare(levitation_model, table), ff.diagnose(levitation_model, table)
    assert (comparison.verdict == "agrees") is (diagnosis.verdict == "nothing_missing")
    assert comparison.p_value == diagnosis.p_value
    assert comparison.noise.mount_m == 0.0
    assert offset_m or comparison.verdict == "agrees"


@pytest.mark.nightly
def test_the_scatter_of_repeats_holds_the_declared_error_of_their_settings_once(levitation_model):
    """Repeats are set anew, so that their scatter is the sensor's noise and what the current's error makes of it."""
    observations = observed(levitation_model, 34, runs=6, mount_m=0.0, rho=0.0, **LARGE)
    columns = np.zeros((len(observations.value), 2))
    columns[observations.of("force_N"), 1] = 4e-4  # what an error of the current makes of the force
    error = np.random.default_rng(1).standard_normal(len(observations.covariates))[observations.row]
    read = observations.with_values(observations.value + error * columns[:, 1])
    for seen, times in ((read, 2**0.5), (replace(read, setting_columns=columns), 1.0)):
        assert estimate_noise(seen).known["force_N"] == pytest.approx(times * NOISE["force_N"], rel=0.1)


def test_the_sidecar_declares_the_uncertainty_of_the_distance(levitation_model, tmp_path):
    table = campaign(levitation_model, 33, distances=6, currents=5)
    table.rows.drop(columns="mount").to_csv(tmp_path / "bench.csv", index=False)
    (tmp_path / "bench.toml").write_text("[noise]\ndistance_mm = 0.6\n")
    observations = placed(levitation_model, tmp_path / "bench.csv")
    assert "unused-setting" not in {one.code for one in observations.findings}
    np.testing.assert_allclose(observations.setting_columns[:, 0], 6e-4 * observations.distance_slope)


def located(model, seed, change, **settings):
    observations = observed(model, seed, change=change, **settings)
    return where_it_fails(observations, Whitening(observations, estimate_noise(observations)))


def changed(channel, by):
    """A campaign's change: ``by`` maps (readings of the channel, rows) to what is added to them."""

    def change(readings, rows):
        return readings | {channel: readings[channel] + by(readings[channel], rows)}

    return change


def corner(force, rows):
    return np.where((rows["current_A"] > 0.8) & (rows["distance_m"] < 0.02), -0.06 * force, 0.0)


@pytest.mark.parametrize(
    ("channel", "by", "covariates", "amounts"),
    [
        ("force_N", corner, {"distance_m", "current_A"}, ("up to ", " low, most at 15 mm and 1.4 A")),
        ("flux_linkage_Wb", lambda flux, rows: -1e-4 * rows["branch"], {"branch"}, (" µWb ", "ing current")),
        ("hall_V", lambda hall, rows: 0.02, set(), ("20 mV high everywhere",)),
        ("hall_V", lambda hall, rows: 0.1 * (hall - 2.5), set(), ("10 %",)),  # less its quiescent voltage
    ],
    ids=["corner", "branch", "everywhere", "share of a Hall output"],
)
def test_a_misfit_is_located_and_its_amount_is_said(levitation_model, channel, by, covariates, amounts):
    where = located(levitation_model, 3, changed(channel, by))
    assert where.channel == channel
    assert set(where.covariates) >= covariates
    assert len(where.covariates) == len(covariates) or channel == "hall_V"
    assert all(one in where.sentence for one in amounts)


@pytest.mark.parametrize("seed", [None, 0])
def test_a_share_of_the_force_is_everywhere_in_any_order_of_the_rows_and_without_a_time(ball_model, tmp_path, seed):
    """A force sensor that reads 5 % too much, on a body of steel: without current there is nothing to read."""
    generator = np.random.default_rng(4)
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.016, 0.044, 8), np.linspace(-1.2, 1.4, 14).round(2)))
    force = 1.05 * flat(ball_model.magnetics).force(d, i) + 2e-4 * generator.standard_normal(len(d))
    rows = pd.DataFrame({"distance_m": d, "current_A": i, "force_N": force})
    rows = rows if seed is None else rows.sample(frac=1.0, random_state=seed, ignore_index=True)
    rows.to_csv(tmp_path / "bench.csv", index=False)
    table = ff.read_measurement(tmp_path / "bench.csv", noise={"force_N": 2e-4})
    sentence = ff.compare(ball_model, table).where.sentence
    assert " 5 % high everywhere" in sentence
    assert "time" not in sentence


def test_a_misfit_that_halves_over_the_range_is_not_said_to_be_everywhere(levitation_model, tmp_path):
    """A distance 0.1 mm off, which re-mounts may explain: the force is 1.1 % off at 16 mm and 0.6 % at 43 mm."""
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.016, 0.043, 10), [0.2, 0.5, 0.8, 1.1, 1.3]))
    rows = pd.concat([pd.DataFrame({"run": run, "distance_m": d, "current_A": i}) for run in (1.0, 2.0, 3.0)])
    noise = 2e-5 * np.random.default_rng(1).standard_normal(len(rows))
    force = levitation_model.force(rows["distance_m"].to_numpy() + 1e-4, rows["current_A"].to_numpy()) + noise
    rows.assign(force_N=force).to_csv(tmp_path / "bench.csv", index=False)
    sentence = ff.compare(levitation_model, tmp_path / "bench.csv").where.sentence
    assert "everywhere" not in sentence
    assert " low, most at 1" in sentence


def test_one_reading_does_not_say_what_a_misfit_is_everywhere(levitation_model):
    observations = observed(levitation_model, 3)
    low = observations.with_values(observations.base * np.where(observations.of("force_N"), 0.94, 1.0))
    first = low.of("force_N") & (np.cumsum(low.of("force_N")) == 1)
    few = low.select(first | low.of("hall_V"))
    for some, there in ((low, " 6 % low everywhere"), (few, " low, most at 15 mm and 0 A")):
        assert there in describe_misfit(some, estimate_noise(observations), "force_N", (), some.residual)


@pytest.mark.parametrize(
    ("offset_V", "gain", "said"),
    [(0.03, 1.0, " 30 mV high everywhere"), (0.0, 0.9, " 10 % nearer to the quiescent voltage than predicted every")],
)
def test_a_hall_output_below_its_quiescent_voltage_that_is_shifted_up_is_high(levitation_model, offset_V, gain, said):
    """A shift is a share of what hardly varies; whichever of the two leaves less is said."""
    observations = bench_observations(levitation_model, campaign(levitation_model, 3, mount_m=0.0))
    quiescent = float(observations.base[observations.of("hall_V")].max()) + 0.5
    low = replace(observations, nominal=replace(observations.nominal, hall_quiescent_V=quiescent))
    error = offset_V + (gain - 1.0) * (low.base - quiescent)
    low = low.with_values(low.value + np.where(low.of("hall_V"), error, 0.0))
    assert said in describe_misfit(low, estimate_noise(observations), "hall_V", (), low.residual)


def test_a_share_that_differs_from_setting_to_setting_by_more_than_noise_is_one_on_average(levitation_model):
    """From 8 % at the smallest force to 5 % at the largest: next to all of one share, but not the same everywhere."""
    observations = bench_observations(levitation_model, campaign(levitation_model, 3, mount_m=0.0))
    force, noise = np.where(observations.of("force_N"), observations.base, 0.0), estimate_noise(observations)
    varied = 0.08 - 0.03 * np.abs(force) / np.abs(force).max()
    for share, there in ((varied, " high on average"), (0.08, " 8 % high everywhere")):
        high = observations.with_values(observations.base + share * force)
        assert there in describe_misfit(high, noise, "force_N", (), high.residual)


@pytest.fixture
def ball_model(levitation_model):
    """F = c i^2 / d^2: no magnet."""
    law = LawMagnetics("F1e", (Coefficient("d^-2", 2, 5e-5, ""),), {}, 0.016, 0.0)
    return replace(levitation_model, magnetics=law, validity=ValidityBox.of_currents((0.015, 0.045), (-1.4, 1.4)))


@pytest.mark.parametrize(
    ("channel", "column", "by"),
    [
        ("force_N", "distance_m", lambda distance: np.sin(distance / 2e-3)),
        ("flux_linkage_Wb", "branch", lambda branch: branch),
        ("hall_V", "coil_temperature_C", lambda temperature: temperature - temperature.mean()),
        ("voltage_V", "current_A", lambda current: current),
    ],
)
def test_the_channel_and_the_covariate_of_a_misfit_of_one_sigma_are_found(levitation_model, channel, column, by):
    def one_sigma(readings, rows):
        shape = np.asarray(by(rows[column]))
        return NOISE[channel] * shape / np.sqrt(np.mean(shape**2))

    # Misfits of one standard deviation rms, re-mounts of 20 um: at least three of four campaigns must be right
    found = [located(levitation_model, seed, changed(channel, one_sigma)) for seed in range(4)]
    right = [one for one in found if one.channel == channel and column in one.covariates[:1]]
    assert len(right) >= 3


@pytest.mark.parametrize("gain", [-0.05, -0.2])
def test_the_share_that_is_said_is_the_true_one_beside_the_freedom_of_the_mounts(pot, gain):
    """The structured part of the misfit lacks what re-mounts may be; its size is not that of the misfit."""
    weak = changed("force_N", lambda force, rows: gain * force)
    where = located(pot, 9, weak, noise={"force_N": 0.02}, mount_m=0.0, rho=0.0)
    share = float(where.sentence.split("force is ")[1].split(" %")[0])
    assert share == pytest.approx(-100.0 * gain, rel=0.06)
    assert "low everywhere" in where.sentence


def test_a_misfit_that_is_rounding_is_none(levitation_model):
    observations = observed(levitation_model, 10)
    same = observations.with_values(observations.base * (1.0 + 1e-14))
    whitening = Whitening(same, estimate_noise(observations))
    assert " 0 " not in where_it_fails(same, whitening).sentence


def test_measured_points_lie_on_the_curves_of_what_was_hidden(levitation_model):
    seen = observed(levitation_model, 21, [HALL])
    curves = {one.channel: one for one in measured_curves(levitation_model, seen, after=[HALL])}
    hall, force = curves["hall_V"], curves["force_N"]
    assert (force.along, force.over) == ("distance_m", "current_A")
    assert force.before.shape == (len(force.levels), len(force.axis))
    np.testing.assert_array_equal(force.before, force.after)
    np.testing.assert_allclose(hall.after - hall.before, 0.02, rtol=1e-9)
    at = Conditions(nominal_of(levitation_model))
    read = predict_readings(levitation_model, force.axis, np.full(len(force.axis), force.levels[0]), at)
    np.testing.assert_allclose(force.before[0], read["force_N"], rtol=1e-9)
    assert np.mean(hall.misfit_before) == pytest.approx(0.02, abs=2e-3)
    assert abs(np.mean(hall.misfit_after)) < 2e-3


@pytest.mark.nightly
def test_repeats_and_a_declaration_are_weighed_unless_they_contradict_each_other(levitation_model):
    table = campaign(levitation_model, 15, [HALL], distances=8, currents=5)
    alone = ff.compare(levitation_model, table)
    for factor, sources in ((1.0, {"declared and repeats"}), (0.6, {"repeats"}), (1.7, {"repeats"})):
        declared = {name: factor * sigma for name, sigma in NOISE.items()}
        both = ff.compare(levitation_model, replace(table, declared_noise=declared))
        assert {one.noise_source for one in both.channels} == sources
        assert set(columns(both.findings, "declared-noise")) == (set() if factor == 1.0 else set(NOISE))
        for name, one in by_channel(both).items():
            shown, n = by_channel(alone)[name].noise_floor, by_channel(alone)[name].noise_readings
            want = np.sqrt((48.0 * declared[name] ** 2 + n * shown**2) / (48.0 + n)) if factor == 1.0 else shown
            assert one.noise_floor == pytest.approx(want, rel=0.02)  # the correlation differs a little, too


@pytest.mark.parametrize(("flux_noise", "worst"), [(2e-5, "flux_linkage_Wb"), (1e-4, "force_N")])
def test_a_core_that_saturates_near_contact_is_said_to_lower_what_it_lowers_most(strong_pot, flux_noise, worst):
    """The force is off by 138 times its noise; the flux linkage by 350 times 20 µWb, and by 70 times 0.1 mWb."""

    def saturated(readings, rows):
        kept = (1.0 + (readings["flux_linkage_Wb"] / 0.15) ** 8) ** -0.125
        flux, force = kept * readings["flux_linkage_Wb"], kept**2 * readings["force_N"]
        return readings | {"flux_linkage_Wb": flux, "force_N": force}

    noise = OF_POT | {"flux_linkage_Wb": flux_noise}
    where = located(strong_pot, 8, saturated, noise=noise, mount_m=0.5e-6, runs=4)
    assert where.channel == worst
    assert " low" in where.sentence
    assert "high" not in where.sentence
