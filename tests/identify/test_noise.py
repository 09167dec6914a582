"""The noise of readings: its variance components, repeats, converters, single sweeps."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from statsmodels.regression.mixed_linear_model import MixedLM

import femfit as ff
from femfit.core.errors import TableError
from femfit.estimate.record import converter_step
from femfit.identify.bench import bench_observations
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.design import ChannelDesign, rho_of, share_of
from femfit.identify.noise.likelihood import Contrasts, Likelihood
from femfit.identify.noise.whitening import Chain, Whitening, setting_errors
from support.campaign import LARGE, NOISE, campaign, noise_of, ripple, rising, without


def design_of(y, fixed, random, cell=None, chain=None):
    """Without a chain no reading follows another."""
    n = len(random)
    columns = np.linalg.qr(fixed)[0] if fixed.shape[1] else fixed
    cell = np.arange(n) if cell is None else cell
    return ChannelDesign(cell, columns, random, chain or Chain(np.arange(n), np.full(n, np.inf)), np.zeros(n), y)


def variances(contrasts, group, scale, weight=None, from_zero=False):
    """Those of random effects, then of the channels."""
    scale = np.asarray(scale, dtype=float)
    weight = np.zeros(len(scale)) if weight is None else np.asarray(weight)
    heavy = np.full(len(scale), from_zero) & (np.arange(len(scale)) < len(scale) - 1)
    likelihood = Likelihood([contrasts], np.asarray(group), np.zeros(len(group), bool), scale, weight, heavy)
    return np.exp(likelihood.maximum()), likelihood


def nested(seed, mounts, runs, readings, missing):
    """Readings of a line in x, by runs within mounts."""
    rng = np.random.default_rng(seed)
    run = np.repeat(np.arange(mounts * runs), readings)
    table = pd.DataFrame({"m": run // runs, "run": run, "x": rng.uniform(-1.0, 1.0, len(run))})
    offsets = rng.normal(0.0, 0.8, mounts)[table["m"]] + rng.normal(0.0, 0.5, mounts * runs)[run]
    table["y"] = 2.0 + 3.0 * table["x"] + offsets + rng.normal(0.0, 0.3, len(table))
    return table[rng.random(len(table)) >= missing].reset_index(drop=True)


def columns_of(table, name):
    return (table[name].to_numpy()[:, None] == np.unique(table[name])).astype(float)


@pytest.mark.parametrize("sloped", [False, True], ids=["mounts and runs", "a slope of each mount"])
@pytest.mark.parametrize("missing", [0.0, 0.35], ids=["balanced", "unbalanced"])
def test_variances_are_those_that_statsmodels_finds(missing, sloped):
    """A body put back elsewhere changes each reading by the slope of its channel: a random slope and no intercept."""
    if sloped:
        table = nested(4, 9, 1, 12, missing)
        table["y"] += np.random.default_rng(9).normal(0.0, 0.6, 9)[table["m"]] * table["x"]
        oracle = MixedLM.from_formula("y ~ x", table, groups="m", re_formula="0 + x")
        random = [columns_of(table, "m") * table[["x"]].to_numpy()]
    else:
        table = nested(3, 7, 4, 6, missing)
        oracle = MixedLM.from_formula("y ~ x", table, groups="m", vc_formula={"run": "0 + C(run)"}, re_formula="1")
        random = [columns_of(table, name) for name in ("m", "run")]
    expected = oracle.fit(reml=True, method="bfgs", gtol=1e-9)
    y, fixed = table["y"].to_numpy(), np.column_stack([np.ones(len(table)), table["x"]])
    design = design_of(y, fixed, np.concatenate(random, axis=1))
    group, count = np.repeat(np.arange(len(random)), [one.shape[1] for one in random]), len(random) + 1
    found, _ = variances(design.contrasts(0, 0), group, np.ones(count))
    want = [float(expected.cov_re.iloc[0, 0]), *map(float, expected.vcomp), expected.scale]
    np.testing.assert_allclose(found, want, rtol=1e-3)


@pytest.mark.parametrize("share", [0, 12], ids=["no share", "a share of the settings"])
def test_the_likelihood_of_correlation_and_share_is_the_normal_density_of_contrasts(share):
    rng = np.random.default_rng(6)
    n, k = 40, 20
    fixed, cell, random = rng.normal(size=(n, 3)), np.arange(n) % 15, rng.normal(size=(n, 4))
    chain = Chain(np.maximum(np.arange(n) - 1, 0), np.where(np.arange(n) == 0, np.inf, 1.0))
    y = rng.normal(size=n)
    design = design_of(y, fixed, random, cell, chain)
    free = np.linalg.svd(fixed, full_matrices=True)[0][:, 3:]  # an orthonormal basis of what fixed columns leave
    repeats = (cell[:, None] == cell) * 1.0

    def density(rho, share, size):
        serial = rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        inside = free.T @ (serial + share**2 * repeats + size**2 * random @ random.T) @ free
        return np.linalg.slogdet(inside)[1] + y @ free @ np.linalg.solve(inside, free.T @ y)

    def cost(memory, share, size):
        contrasts = design.contrasts(memory, share)
        priors = np.ones(2), np.zeros(2), np.zeros(2, bool)
        likelihood = Likelihood([contrasts], np.zeros(4, int), np.zeros(4, bool), *priors)
        return contrasts.log_det + likelihood.cost(np.log([size**2, 1.0]))

    found = cost(k, share, 0.7) - cost(0, 0, 0.2)
    assert found == pytest.approx(density(rho_of(k), share_of(share), 0.7) - density(1e-12, 0.0, 0.2), abs=1e-8)


def test_cost_slope_and_curvature_are_those_of_the_normal_density_of_all_channels():
    rng, group, second = np.random.default_rng(0), np.array([0, 0, 1, 1, 1, 0, 0]), np.repeat([False, True], [5, 2])
    channels = [Contrasts(3.0 * k, 20.0 + k, rng.normal(size=6 + k), rng.normal(size=(6 + k, 7))) for k in (1, 2)]
    scale, weight = np.array([0.5, 0.4, 1.0, 1.0]), np.array([0.0, 0.0, 5.0, 0.0])
    likelihood = Likelihood(channels, group, second, scale, weight, np.arange(4) < 2)
    columns, along = np.vstack([c.columns for c in channels]), np.concatenate([c.along for c in channels])
    of = np.repeat([0, 1], [7, 8])

    def covariance(x):
        v, s = np.exp(x[:2])[group], np.exp(x[2:])
        return np.diag(s[of]) + columns * np.where(second, 2.0 * v**2, v) @ columns.T

    def density(x):
        total = covariance(x)
        own = sum(c.free * x[2 + k] + c.square * np.exp(-x[2 + k]) for k, c in enumerate(channels))
        prior = np.sum(2.0 * np.log1p(np.exp(x) / scale)[:2]) + 5.0 * (x[2] + np.exp(-x[2]) - 1.0)
        return own + np.linalg.slogdet(total)[1] + along @ np.linalg.solve(total, along) + prior

    x, steps = np.array([-0.3, 0.4, 0.2, -0.5]), 1e-5 * np.eye(4)
    assert likelihood.cost(x) == pytest.approx(density(x), rel=1e-12)
    slope, curvature = likelihood(x)
    np.testing.assert_allclose(slope, [(density(x + e) - density(x - e)) / 2e-5 for e in steps], atol=1e-7)
    changes = [np.linalg.solve(covariance(x), (covariance(x + e) - covariance(x - e)) / 2e-5) for e in steps]
    expected = np.array([[np.trace(a @ b) for b in changes] for a in changes])
    ratio = np.exp(x[:2]) / scale[:2]
    expected += np.diag([*(2.0 * ratio / (1.0 + ratio) ** 2), 5.0 + channels[0].free, channels[1].free])
    np.testing.assert_allclose(curvature, expected, atol=1e-7)


def test_where_mounts_have_all_that_repeats_differ_by_the_declared_noise_stands(levitation_model):
    """The body is put back before each of two readings a setting."""
    size = {"runs": 2, "distances": 5, "currents": 4, "rho": 0.0}
    table = campaign(levitation_model, 1, noise={"force_N": NOISE["force_N"]}, **size)
    rows = table.rows.assign(mount=np.arange(1.0, 1.0 + len(table.rows)))
    table = replace(table, rows=rows, declared_noise={"force_N": 4e-4})
    assert noise_of(levitation_model, table).source == {"force_N": "declared"}
    assert ff.compare(levitation_model, table).verdict == "agrees"


@pytest.mark.parametrize("size", [0.0, 3.0], ids=["none", "thirty times the readings'"])
def test_what_readings_do_not_show_is_none_and_what_is_there_is_not_made_smaller(size):
    rng = np.random.default_rng(7)
    mounts = np.kron(np.eye(12), np.ones((50, 1)))
    offsets = rng.normal(0.0, size, 12) if size else np.zeros(12)
    noise = rng.normal(0.0, 0.1, (12, 50))
    y = offsets[:, None] + noise - noise.mean(axis=1, keepdims=True)  # which differ by less than chance, or by far more
    contrasts = design_of(y.ravel(), np.ones((600, 1)), mounts).contrasts(0, 0)
    found, likelihood = variances(contrasts, np.zeros(12, int), [1e-4, 1e-2], from_zero=True)
    if size:
        # The prior costs two of eleven differences; their mean over the posterior lies above the likeliest
        assert found[0] == pytest.approx(np.var(offsets, ddof=1), rel=0.2)
        assert 1.0 < likelihood.mean_variance(np.log(found), 0) / found[0] < 1.5
    else:
        assert found[0] < 1e-7
        assert likelihood.mean_variance(np.log(found), 0) < 1e-4


def test_the_declared_error_of_the_distance_is_how_well_a_body_comes_back(levitation_model):
    """Two runs of one channel say too little of mounts: what is declared stands."""
    table = campaign(levitation_model, 3, runs=2, mount_m=0.0, distances=6, currents=4)
    noise = [noise_of(levitation_model, table, declared_noise=declared) for declared in ({}, {"distance_m": 5e-6})]
    assert noise[0].mount_m == pytest.approx(29e-6, rel=0.2)  # the posterior of two mounts: 20 um and more
    assert noise[1].mount_m == pytest.approx(5e-6, rel=0.4)
    assert [one.mount_assumed for one in noise] == [True, False]


def at_stops(model, seed, stop_m):
    """A campaign whose stage is off by something else at each stop."""
    table = campaign(model, seed, mount_m=10e-6, rho=0.0, runs=3, **LARGE)
    rng, keys = np.random.default_rng(seed), ["run", "distance_m"]
    error = table.rows.groupby(keys).ngroup().map(dict(enumerate(rng.normal(0.0, stop_m, 30)))).to_numpy()
    slope = bench_observations(model, table)
    rows = table.rows.copy()
    for name in slope.channels:
        here = slope.of(name)
        rows.loc[slope.row[here], name] += slope.distance_slope[here] * error[slope.row[here]]
    return replace(table, rows=rows)


@pytest.mark.parametrize("declared", [{}, {"distance_m": 100e-6}], ids=["found", "declared"])
def test_the_error_of_each_stop_of_the_stage_is_told_from_the_scatter_of_readings(levitation_model, declared):
    noise = noise_of(levitation_model, at_stops(levitation_model, 4, 100e-6), declared_noise=declared)
    scatter = noise_of(levitation_model, at_stops(levitation_model, 4, 0.0))
    assert noise.stop_m == pytest.approx(100e-6, rel=0.35)  # 20 differences and a prior: to a fifth
    np.testing.assert_allclose(noise.sigma, scatter.sigma, rtol=0.1)
    assert np.all(noise.rho < 0.3)
    assert scatter.stop_m < 0.2 * noise.stop_m


def test_the_map_to_independent_readings_is_an_inverse_root_of_their_covariance(levitation_model):
    """Readings follow each other; those of a stop share its distance error, those of a row one of the current."""
    declared = {"distance_m": 50e-6, "current_A": 0.01}
    table = replace(at_stops(levitation_model, 5, 50e-6), declared_noise=declared)
    observations = bench_observations(levitation_model, table)
    rho = np.array([0.3, 0.0, 0.6, 0.1])
    noise = replace(estimate_noise(observations), rho=rho, run=np.zeros(4), mount_m=0.0, stop_m=50e-6)
    run, channel = observations.column("run"), observations.channel
    each = (run[:, None] == run) & (channel[:, None] == channel)
    between = np.abs(observations.column("order")[:, None] - observations.column("order"))
    sigma = noise.sigma[channel]
    covariance = np.where(each, rho[channel][:, None] ** between, 0.0) * np.outer(sigma, sigma)
    for number, size in setting_errors(observations, noise.stop_m):
        covariance += np.where(number[:, None] == number, np.outer(size, size), 0.0)
    assert len(setting_errors(observations, noise.stop_m)) == 3  # of the distance to second order
    columns = np.random.default_rng(6).normal(size=(len(covariance), 3)) * sigma[:, None]
    white = Whitening(observations, noise).full(columns)
    np.testing.assert_allclose(white.T @ white, columns.T @ np.linalg.solve(covariance, columns), rtol=1e-8)


def on_a_bad_stage(model, seed, stop_m):
    """A single run at ten stops, up and down; the stage is off by something else at each."""
    table = campaign(model, seed, mount_m=0.0, rho=0.0, runs=1, **LARGE)
    shift = np.random.default_rng(seed).normal(0.0, stop_m, 10)
    stop = table.rows["distance_m"].rank(method="dense").astype(int).to_numpy() - 1
    box, moved = model.validity, table.rows["distance_m"] + shift[stop]
    kept = moved.between(box.distance_min_m, box.distance_max_m)
    rows = table.rows.assign(distance_m=moved)[kept].reset_index(drop=True)
    return replace(table, rows=rows, declared_noise=NOISE)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_single_run_on_a_stage_that_is_off_as_declared_is_not_accused(levitation_model, seed):
    table = on_a_bad_stage(levitation_model, seed, 300e-6)
    table = replace(table, declared_noise=NOISE | {"distance_m": 300e-6})
    comparison = ff.compare(levitation_model, table)
    noise = estimate_noise(comparison.observations)
    assert noise.stop_m == pytest.approx(300e-6, rel=1e-3)  # nothing repeats a stop: what is declared stands
    assert np.all(noise.rho < 0.5)
    assert comparison.channels[0].rms > 2.0 * NOISE["force_N"]
    assert comparison.verdict == "agrees"


def test_a_stage_that_nobody_declared_is_said_to_explain_what_no_effect_does(levitation_model):
    rippled = campaign(levitation_model, 2, runs=1, change=ripple("force_N", 8.0 * NOISE["force_N"]))
    tables = on_a_bad_stage(levitation_model, 2, 150e-6), replace(rippled, declared_noise=NOISE)
    off, other = (ff.diagnose(levitation_model, table) for table in tables)
    assert off.verdict == "unexplained"
    (stage,) = (finding for finding in off.findings if finding.code == "stage-errors")
    assert stage.size == pytest.approx(150e-6, rel=0.4)
    assert "stage-errors" not in [finding.code for finding in other.findings]


def test_a_declared_error_of_the_current_by_which_readings_would_scatter_more_is_not_used(levitation_model):
    table = campaign(levitation_model, 5, rho=0.0, runs=2)
    known = ff.compare(levitation_model, table)
    result = ff.compare(levitation_model, replace(table, declared_noise={"current_A": 0.005}))
    assert result.verdict == known.verdict == "agrees"
    np.testing.assert_allclose(result.noise.sigma, known.noise.sigma, rtol=1e-9)
    (told,) = [finding for finding in result.findings if finding.code == "declared-setting"]
    assert (told.column, told.severity) == ("current_A", "warning")
    less = ff.compare(levitation_model, replace(table, declared_noise={"current_A": 1e-4}))
    assert "declared-setting" not in [finding.code for finding in less.findings]


@pytest.mark.parametrize("by", ["distance_m", "current_A"], ids=["distance by distance", "each row a stop"])
def test_a_declared_error_of_the_distance_hides_no_gain_that_is_far_smaller(levitation_model, by):
    table = campaign(levitation_model, 9, mount_m=0.0, rho=0.0, runs=1, **LARGE)
    rows = table.rows.assign(force_N=1.03 * table.rows["force_N"])
    rows = rows.sort_values([by, "order"], kind="stable", ignore_index=True).assign(order=np.arange(len(rows)))
    result = ff.compare(levitation_model, replace(table, rows=rows, declared_noise=NOISE | {"distance_m": 2e-3}))
    assert result.verdict == "fails"
    (told,) = [finding for finding in result.findings if finding.code == "declared-setting"]
    assert told.column == "distance_m"
    assert "2.0 mm by which" not in str(result)


@pytest.mark.nightly
def test_a_channel_that_was_read_in_one_of_many_runs_is_no_trouble(levitation_model):
    table = campaign(levitation_model, 8, mount_m=0.0, rho=0.0, distances=10, currents=12, runs=1)
    run = 1.0 + np.arange(len(table.rows)) * 60 // len(table.rows)
    rows = table.rows.assign(run=run, hall_V=table.rows["hall_V"].where(run == 5.0))
    assert ff.compare(levitation_model, replace(table, rows=rows, declared_noise=NOISE)).verdict == "agrees"


def test_a_declared_error_as_large_as_the_whole_range_is_refused(levitation_model):
    for name, error in (("distance_m", 20.0), ("current_A", 5.0)):
        table = replace(campaign(levitation_model, 5), declared_noise={name: error})
        with pytest.raises(TableError, match=f"The declared error of {name}"):
            ff.compare(levitation_model, table)


def test_sixty_runs_whose_offsets_differ_are_not_accused(levitation_model):
    """Runs are few readings each: so many columns took a minute, and 48 of them say the noise of all."""
    noise = {"force_N": NOISE["force_N"]}
    table = campaign(levitation_model, 8, mount_m=0.0, rho=0.0, distances=40, currents=12, runs=1, noise=noise)
    run = np.arange(len(table.rows)) * 60 // len(table.rows)
    offset = np.random.default_rng(8).normal(0.0, NOISE["force_N"], 60)
    rows = table.rows.assign(run=run + 1.0, force_N=table.rows["force_N"] + offset[run])
    result = ff.compare(levitation_model, replace(table, rows=rows, given=("run", *table.given)))
    assert result.verdict == "agrees"
    c = result.noise.channels.index("force_N")
    assert result.noise.run[c] == pytest.approx(NOISE["force_N"], rel=0.3)
    assert result.noise.sigma[c] == pytest.approx(NOISE["force_N"], rel=0.15)


def test_declared_offsets_of_runs_stand_whatever_the_runs_differ_by(levitation_model):
    """An error that begins at the second of three runs is no scatter of the runs once that is known."""
    table = campaign(levitation_model, 6, mount_m=5e-6, rho=0.0)
    later = table.rows["run"].to_numpy() > 1.0
    rows = table.rows.assign(hall_V=table.rows["hall_V"] + np.where(later, 0.02, 0.0))
    # Neither a temperature nor the time may be what differs from run to run
    table = without(replace(table, rows=rows), "coil_temperature_C", "magnet_temperature_C", "order", "mount")
    found, declared = (noise_of(levitation_model, table, declared_noise=noise) for noise in ({}, {"run.hall_V": 1e-3}))
    hall = found.channels.index("hall_V")
    assert found.run[hall] > 5e-3
    assert declared.run[hall] == pytest.approx(1e-3, rel=1e-3)


def test_a_channel_that_no_distance_changes_has_neither_mounts_nor_stops(levitation_model):
    table = without(campaign(levitation_model, 7, rho=0.0), "force_N", "flux_linkage_Wb", "hall_V")
    noise = noise_of(levitation_model, table)
    assert noise.channels == ("voltage_V",)
    assert (noise.stop_m, noise.mount_m) == (0.0, 0.0)
    assert noise.sigma[0] == pytest.approx(NOISE["voltage_V"], rel=0.2)


def test_a_converter_is_known_by_its_step_and_readings_that_were_not_rounded_have_none():
    rng = np.random.default_rng(2)
    assert converter_step(np.round(rng.standard_normal(2000) / 0.05) * 0.05) == pytest.approx(0.05)
    settings = np.repeat(rng.normal(size=40), 5)  # settings that repeat exactly are no converter's steps
    even = np.tile(2.75 * np.linspace(0.0, 1.4, 8), 12)  # nor are readings in step with settings evenly apart
    for values in (rng.normal(size=1000), settings, even, np.ones(30), np.zeros(0), np.array([1.0, 2.0])):
        assert converter_step(np.unique(values)) == 0.0


def test_a_converter_coarser_than_the_noise_bounds_it(levitation_model):
    table = campaign(levitation_model, 7, runs=3, mount_m=0.0, noise={"force_N": 1e-6})
    step = 5e-3
    rows = table.rows.assign(force_N=np.round(table.rows["force_N"] / step) * step)
    noise = noise_of(levitation_model, table, rows=rows)
    assert noise.never_varying == ("force_N",)
    assert noise.source == {"force_N": "resolution"}
    assert noise.sigma[0] == pytest.approx(step / np.sqrt(12.0))


def single(model, seed, rho=0.0, **more):
    """One sweep upwards."""
    return rising(campaign(model, seed, runs=1, mount_m=0.0, rho=rho, **more))


@pytest.mark.parametrize(("rho", "rtol"), [(0.0, 0.15), (0.8, 0.25)])
def test_the_noise_of_a_single_sweep_is_what_smooth_patterns_leave_though_it_lasts(levitation_model, rho, rtol):
    noise = noise_of(levitation_model, single(levitation_model, 5, rho, distances=24, currents=16))
    np.testing.assert_allclose(noise.sigma, [NOISE[name] for name in noise.channels], rtol=rtol)
    np.testing.assert_allclose(noise.rho, rho, atol=0.1 if rho else 0.2)
    assert set(noise.source.values()) == {"guess"}


def test_a_smooth_misfit_is_not_taken_for_noise(levitation_model):
    def bent(readings, rows):
        return readings | {"force_N": 1.3 * readings["force_N"] + 0.02 * rows["current_A"].to_numpy() ** 2}

    table = single(levitation_model, 4, distances=16, currents=12, change=bent)
    observations = bench_observations(levitation_model, table)
    assert np.abs(observations.residual[observations.of("force_N")]).max() > 50 * NOISE["force_N"]
    assert estimate_noise(observations).known["force_N"] < 1.5 * NOISE["force_N"]


def test_readings_do_not_seem_to_follow_each_other_because_their_noise_was_declared_too_large(levitation_model):
    sweep = single(levitation_model, 6)
    known, too_large = (
        noise_of(levitation_model, sweep, declared_noise={name: f * NOISE[name] for name in sweep.channels})
        for f in (1.0, 8.0)
    )
    np.testing.assert_allclose(too_large.rho, known.rho, atol=0.02)  # of 0.95 before
    assert np.all(too_large.rho < 0.6)
