"""The noise of readings: its variance components, repeats, converters, and a guess where nothing tells it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from statsmodels.regression.mixed_linear_model import MixedLM

from femfit.identify.bench import bench_observations
from femfit.identify.compare import compare
from femfit.identify.constants import GUESS_WIDER
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.contrasts import Chain, ChannelDesign, Contrasts, restricted_estimate, rho_of
from femfit.identify.noise.scatter import guessed_noise
from femfit.identify.noise.whitening import Whitening, stops
from femfit.identify.settings import quantisation_step
from support.campaign import NOISE, campaign


def alone(n):
    """A chain in which no reading follows another."""
    return Chain(np.arange(n), np.ones(n, dtype=bool), np.ones(n))


def design_of(y, fixed, random, cell=None, chain=None):
    n = len(random)
    cells = 0 if cell is None else int(cell.max()) + 1
    columns = np.linalg.qr(fixed)[0] if fixed.shape[1] else fixed
    cell = np.zeros(n, dtype=int) if cell is None else cell
    return ChannelDesign(np.arange(n), cell, cells, columns, random, chain or alone(n), np.ones(n), y)


def nested(seed, mounts, runs, readings, missing):
    """Readings of a line in x, by runs within mounts."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame(
        [(m, r) for m in range(mounts) for r in range(runs) for _ in range(readings)], columns=["m", "r"]
    )
    table["run"] = table["m"] * runs + table["r"]
    table["x"] = rng.uniform(-1.0, 1.0, len(table))
    table["y"] = (
        2.0
        + 3.0 * table["x"]
        + rng.normal(0.0, 0.8, mounts)[table["m"]]
        + rng.normal(0.0, 0.5, mounts * runs)[table["run"]]
        + rng.normal(0.0, 0.3, len(table))
    )
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
    contrasts = design.contrasts(0)
    found = restricted_estimate([contrasts], group, np.zeros(len(group), bool), np.ones(count), np.zeros(count))
    assert found.converged
    want = [float(expected.cov_re.iloc[0, 0]), *map(float, expected.vcomp), expected.scale]
    np.testing.assert_allclose(found.variance, want, rtol=1e-3)


def test_a_mean_for_each_setting_is_the_same_as_its_column_among_the_fixed_ones():
    table = nested(5, 3, 2, 30, 0.2)
    cell = table["x"].rank().to_numpy().astype(int) // 5
    runs = columns_of(table, "run")
    columns = (cell[:, None] == np.unique(cell)).astype(float)
    follows = np.append(False, np.diff(table["run"]) == 0)
    n = np.arange(len(table))
    chain = Chain(np.where(follows, n - 1, n), ~follows, np.where(n % 7 == 3, 2.0, 1.0))
    y = table["y"].to_numpy()
    sparse = design_of(y, np.zeros((len(table), 0)), runs, cell, chain)
    dense = design_of(y, columns, runs, None, chain)
    assert sparse.free == dense.free
    for k in (0, 10, 30):
        one, other = sparse.contrasts(k), dense.contrasts(k)
        assert one.square == pytest.approx(other.square, rel=1e-9)
        np.testing.assert_allclose(one.columns.T @ one.columns, other.columns.T @ other.columns, atol=1e-8)
        np.testing.assert_allclose(one.columns.T @ one.along, other.columns.T @ other.along, atol=1e-8)
        # The likelihoods differ by the determinant of the orthonormal basis' triangle, the same at every rho
    shift = [sparse.contrasts(k).cost - dense.contrasts(k).cost for k in (0, 10, 30)]
    np.testing.assert_allclose(shift, shift[0], atol=1e-8)


def test_the_likelihood_of_the_correlation_is_the_normal_density_of_contrasts():
    rng = np.random.default_rng(6)
    n, k = 40, 20
    fixed, rho = rng.normal(size=(n, 3)), rho_of(k)
    chain = Chain(np.maximum(np.arange(n) - 1, 0), np.arange(n) == 0, np.ones(n))
    y = rng.normal(size=n)
    design = design_of(y, fixed, np.zeros((n, 0)), None, chain)
    free = np.linalg.svd(fixed, full_matrices=True)[0][:, 3:]  # an orthonormal basis of what fixed columns leave

    def density(rho):
        inside = free.T @ rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) @ free
        square = y @ free @ np.linalg.solve(inside, free.T @ y)
        return np.linalg.slogdet(inside)[1] + (n - 3) * np.log(square)

    found = design.contrasts(k).cost - design.contrasts(0).cost
    assert found == pytest.approx(density(rho) - density(1e-12), abs=1e-8)


def test_an_estimate_without_a_prior_has_the_degrees_of_freedom_of_its_readings():
    rng = np.random.default_rng(7)
    mounts = np.kron(np.eye(12), np.ones((50, 1)))
    y = mounts @ rng.normal(0.0, 3.0, 12) + rng.normal(0.0, 0.1, 600)
    design = design_of(y, np.ones((600, 1)), mounts)
    found = restricted_estimate([design.contrasts(0)], np.zeros(12, int), np.zeros(12, bool), np.ones(2), np.zeros(2))
    # 12 mounts that the readings resolve: 11 differences; and 600 readings less 12 means
    np.testing.assert_allclose(found.degrees_of_freedom, [11.0, 588.0], rtol=0.01)


def test_a_prior_counts_like_readings_of_its_variance():
    y = np.random.default_rng(8).normal(0.0, 2.0, 30)
    square = float(y @ y)
    none = Contrasts(square, 30.0, np.zeros(0), np.zeros((0, 0)))
    found = restricted_estimate([none], np.zeros(0, int), np.zeros(0, bool), np.array([9.0]), np.array([20.0]))
    assert found.variance[0] == pytest.approx((square + 20.0 * 9.0) / 50.0, rel=1e-6)
    assert found.degrees_of_freedom[0] == pytest.approx(50.0, rel=1e-6)


def test_the_declared_error_of_the_distance_is_how_well_a_body_comes_back(levitation_model):
    """Two runs of one channel say too little of mounts: what is declared stands."""
    table = campaign(levitation_model, 3, runs=2, mount_m=0.0, distances=6, currents=4)
    noise = [
        estimate_noise(bench_observations(levitation_model, replace(table, declared_noise=declared)))
        for declared in ({}, {"distance_m": 5e-6})
    ]
    assert noise[0].mount_m == pytest.approx(20e-6, rel=0.2)
    assert noise[1].mount_m == pytest.approx(5e-6, rel=0.4)
    assert [one.mount_assumed for one in noise] == [True, False]


def at_stops(model, seed, stop_m, **size):
    """A campaign whose stage is off by something else at each stop, and by how much."""
    table = campaign(model, seed, mount_m=10e-6, rho=0.0, distances=10, currents=7, runs=3)
    rng, keys = np.random.default_rng(seed), ["run", "distance_m"]
    error = table.rows.groupby(keys).ngroup().map(dict(enumerate(rng.normal(0.0, stop_m, 30)))).to_numpy()
    slope = bench_observations(model, table)
    rows = table.rows.copy()
    for name in slope.channels:
        here = slope.of(name)
        rows.loc[slope.row[here], name] += slope.distance_slope[here] * error[slope.row[here]]
    return replace(table, rows=rows, **size)


@pytest.mark.parametrize("declared", [{}, {"distance_m": 100e-6}], ids=["found", "declared"])
def test_the_error_of_each_stop_of_the_stage_is_told_from_the_scatter_of_readings(levitation_model, declared):
    observations = bench_observations(levitation_model, at_stops(levitation_model, 4, 100e-6, declared_noise=declared))
    noise = estimate_noise(observations)
    scatter = estimate_noise(bench_observations(levitation_model, at_stops(levitation_model, 4, 0.0)))
    assert noise.stop_m == pytest.approx(100e-6, rel=0.35)  # 20 differences and a prior: to a fifth
    np.testing.assert_allclose(noise.sigma, scatter.sigma, rtol=0.1)
    assert np.all(noise.rho < 0.3)
    assert scatter.stop_m < 0.2 * noise.stop_m


def test_readings_of_a_stop_share_its_error_in_the_tests_too(levitation_model):
    """The map to independent readings is the inverse root of the covariance that it says."""
    observations = bench_observations(levitation_model, at_stops(levitation_model, 5, 50e-6))
    noise = replace(
        estimate_noise(observations), rho=np.zeros(4), test_run=np.zeros(4), test_mount_m=0.0, test_stop_m=50e-6
    )
    of_stop = 50e-6 * observations.distance_slope[:, None] * (stops(observations)[:, None] == np.arange(30))
    covariance = np.diag(noise.sigma[observations.channel] ** 2) + of_stop @ of_stop.T
    whitening = Whitening(observations, noise)
    columns = np.random.default_rng(6).normal(size=(len(covariance), 3)) * noise.sigma[observations.channel][:, None]
    white = whitening.full(columns)
    np.testing.assert_allclose(white.T @ white, columns.T @ np.linalg.solve(covariance, columns), rtol=1e-9)


def test_declared_offsets_of_runs_stand_whatever_the_runs_differ_by(levitation_model):
    """An error that begins at the second of three runs is no scatter of the runs once that is known."""
    table = campaign(levitation_model, 6, mount_m=5e-6, rho=0.0)
    later = table.rows["run"].to_numpy() > 1.0
    rows = table.rows.assign(hall_V=table.rows["hall_V"] + np.where(later, 0.02, 0.0))
    rows[["coil_temperature_C", "magnet_temperature_C", "order"]] = (
        np.nan
    )  # which could be what differs from run to run
    table = replace(table, given=("run", "distance_m", "current_A", "branch", *table.channels))
    hall = bench_observations(levitation_model, table).channels.index("hall_V")

    def noise(**declared):
        read = replace(table, rows=rows, declared_noise={f"run.{name}": sd for name, sd in declared.items()})
        return estimate_noise(bench_observations(levitation_model, read))

    assert noise().run[hall] > 5e-3
    assert noise(hall_V=1e-3).run[hall] == pytest.approx(1e-3, rel=1e-3)
    assert noise(hall_V=1e-3).test_run[hall] == pytest.approx(1e-3, rel=1e-2)


def test_a_channel_that_no_distance_changes_has_neither_mounts_nor_stops(levitation_model):
    table = campaign(levitation_model, 7, rho=0.0)
    given = tuple(name for name in table.given if name not in {"force_N", "flux_linkage_Wb", "hall_V"})
    noise = estimate_noise(bench_observations(levitation_model, replace(table, given=given)))
    assert noise.channels == ("voltage_V",)
    assert (noise.stop_m, noise.mount_m) == (0.0, 0.0)
    assert noise.sigma[0] == pytest.approx(NOISE["voltage_V"], rel=0.2)


def test_readings_that_were_not_rounded_have_no_step():
    rng = np.random.default_rng(2)
    settings = np.repeat(rng.normal(size=40), 5)  # settings that repeat exactly are no converter's steps
    even = np.tile(2.75 * np.linspace(0.0, 1.4, 8), 12)  # nor are readings in step with settings evenly apart
    for values in (rng.normal(size=1000), settings, even, np.ones(30), np.zeros(0), np.array([1.0, 2.0])):
        assert quantisation_step(values) == 0.0


def test_a_converter_coarser_than_the_noise_bounds_it(levitation_model):
    table = campaign(levitation_model, 7, runs=3, mount_m=0.0, noise={"force_N": 1e-6})
    step = 5e-3
    rows = table.rows.assign(force_N=np.round(table.rows["force_N"] / step) * step)
    noise = estimate_noise(bench_observations(levitation_model, replace(table, rows=rows)))
    assert noise.never_varying == ("force_N",)
    assert noise.source == {"force_N": "resolution"}
    assert noise.sigma[0] == pytest.approx(step / np.sqrt(12.0))


def rising(model, seed, **more):
    table = campaign(model, seed, **({"runs": 1, "mount_m": 0.0, "rho": 0.0} | more))
    return replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))


def test_white_noise_is_guessed_and_widened(levitation_model):
    observations = bench_observations(levitation_model, rising(levitation_model, 3, distances=24, currents=16))
    for name, sigma in NOISE.items():
        guess, degrees = guessed_noise(observations, name)
        # The larger of two medians of 350 pseudo-residuals each is known to 10 %
        assert guess == pytest.approx(GUESS_WIDER * sigma, rel=0.25)
        assert 20 < degrees < len(observations.value)


def test_a_smooth_misfit_is_not_taken_for_noise(levitation_model):
    def bent(readings, rows):
        return readings | {"force_N": 1.3 * readings["force_N"] + 0.02 * rows["current_A"].to_numpy() ** 2}

    observations = bench_observations(
        levitation_model, rising(levitation_model, 4, distances=16, currents=12, change=bent)
    )
    assert np.abs(observations.residual[observations.of("force_N")]).max() > 50 * NOISE["force_N"]
    assert guessed_noise(observations, "force_N")[0] < 2.5 * NOISE["force_N"]


def test_noise_that_lasts_along_a_sweep_shows_across_it(levitation_model):
    table = rising(levitation_model, 5, distances=24, currents=16, rho=0.8)
    guess, _ = guessed_noise(bench_observations(levitation_model, table), "hall_V")
    assert guess > 0.9 * NOISE["hall_V"]


def test_a_declaration_or_repeats_leave_no_room_for_a_guess(levitation_model):
    table = rising(levitation_model, 6)
    assert set(estimate_noise(bench_observations(levitation_model, table)).source.values()) == {"guess"}
    declared = replace(table, declared_noise={"force_N": 4e-4})
    assert estimate_noise(bench_observations(levitation_model, declared)).source == {"force_N": "declared"}
    repeated = campaign(levitation_model, 6, runs=3)
    assert set(estimate_noise(bench_observations(levitation_model, repeated)).source.values()) == {"repeats"}


@pytest.mark.parametrize("name", ["levitation_model", pytest.param("solenoid", marks=pytest.mark.nightly)])
def test_a_clean_sweep_is_not_accused(request, name):
    model = request.getfixturevalue(name)
    noise = {channel: sigma for channel, sigma in NOISE.items() if channel != "hall_V" or model.sensor}
    verdicts = [
        compare(model, rising(model, seed, rho=0.5, noise=noise, distances=8, currents=6)).verdict for seed in range(2)
    ]
    assert verdicts == 2 * ["agrees"]
