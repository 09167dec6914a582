"""Bench tables of very many rows, which are averaged before they are compared."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.identify.bench import placed
from femfit.identify.constants import MOST_ROWS
from femfit.identify.settings import AVERAGED_TO, noise_of_means, stretches
from femfit.tables.measurement import BenchTable
from support.campaign import NOISE, settings
from support.campaign import campaign as few

TIMES = 30


def correlated(generator, count, rho):
    """Noise of unit variance of which each value has a share of the one before."""
    fresh = generator.standard_normal(count)
    value = fresh.copy()
    for k in range(1, count):
        value[k] = rho * value[k - 1] + np.sqrt(1.0 - rho**2) * fresh[k]
    return value


def logged(model, folder, seed=3, shuffled=False, rho=0.8):
    """A logger that reads every setting of a campaign thirty times, its noise correlated."""
    generator = np.random.default_rng(seed)
    rows = few(model, seed, mount_m=10e-6, noise={"force_N": 0.0, "hall_V": 0.0}).rows
    rows = rows[["run", "distance_m", "current_A", "branch", "force_N", "hall_V"]]
    rows = rows.loc[rows.index.repeat(TIMES)].reset_index(drop=True)
    for name in ("force_N", "hall_V"):
        rows[name] += 3.0 * NOISE[name] * correlated(generator, len(rows), rho)
    rows = rows.sample(frac=1.0, random_state=1) if shuffled else rows.assign(order=np.arange(len(rows)))
    file = folder / "log.csv"
    rows.to_csv(file, index=False)
    return ff.read_measurement(file)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_the_noise_of_a_mean_is_what_means_scatter_by_whatever_the_correlation(rho):
    generator, count = np.random.default_rng(4), np.full(400, 60)
    number, noise = np.repeat(np.arange(400), 60), correlated(generator, 24_000, rho)
    scatter = np.std(noise.reshape(400, 60).mean(axis=1))
    assert noise_of_means(noise, number, count) == pytest.approx(scatter, rel=0.15)
    assert np.isnan(noise_of_means(noise[:600], number[:600], count[:10]))
    unlike = np.tile([100, 60], 150)  # means of unlike length have the noise of the usual one
    number = np.repeat(np.arange(300), unlike)
    assert noise_of_means(generator.standard_normal(24_000), number, unlike) == pytest.approx(0.1, rel=0.12)


def test_a_stretch_ends_where_a_setting_moves_the_run_or_the_branch_changes_or_it_is_long(levitation_model):
    rows = settings(levitation_model, runs=2, distances=3, currents=4)
    rows = rows.loc[rows.index.repeat(300)].reset_index(drop=True)
    table = BenchTable(rows=rows, given=tuple(rows.columns))
    number = stretches(table, ("current_A",))
    of_each = rows.groupby(number)[["run", "distance_m", "current_A", "branch"]].nunique()
    assert (of_each == 1).all(axis=None)
    most = -(-len(rows) // AVERAGED_TO)
    assert set(np.bincount(number)) <= {most - 1, most}  # evenly
    sometimes = rows.assign(coil_temperature_C=rows["coil_temperature_C"].where(np.arange(len(rows)) % 10 == 0))
    assert np.bincount(stretches(replace(table, rows=sometimes), ("current_A",))).min() >= most - 1
    assert (np.diff(number) >= 0).all()


def test_a_converter_coarser_than_the_noise_and_what_was_declared_are_no_trouble(levitation_model, tmp_path):
    table = logged(levitation_model, tmp_path)
    step = 10.0 * NOISE["force_N"]
    coarse = replace(table, rows=table.rows.assign(force_N=np.round(table.rows["force_N"] / step) * step))
    observations = placed(levitation_model, replace(coarse, declared_noise={"force_N": 1e-3, "distance_m": 1e-5}))
    assert len(observations.covariates) < MOST_ROWS < len(table.rows)
    assert observations.declared_noise["force_N"] >= step / np.sqrt(12.0 * 7.0) * 0.99
    assert observations.declared_noise["distance_m"] == 1e-5
    assert "that was declared" in str(next(f for f in observations.findings if f.code == "averaged"))
    assert ff.compare(levitation_model, coarse).verdict == "agrees"


def test_settings_in_random_order_are_asked_to_be_averaged_by_their_owner(levitation_model, tmp_path):
    with pytest.raises(TableError, match="on end at one setting"):
        placed(levitation_model, logged(levitation_model, tmp_path, shuffled=True))


def test_a_reading_in_twenty_that_drops_out_is_set_aside_and_no_gain(levitation_model, tmp_path):
    """Of thirty readings at each setting some are 0: their mean would be a gain of five per cent."""
    table = logged(levitation_model, tmp_path, rho=0.0)
    dropped = np.random.default_rng(1).random(len(table.rows)) < 0.05
    rows = table.rows.assign(force_N=table.rows["force_N"].where(~dropped, 0.0))
    found = ff.compare(levitation_model, replace(table, rows=rows))
    assert found.verdict == "agrees"
    told = next(finding for finding in found.findings if finding.code == "outliers")
    assert told.severity == "warning"
    clear = dropped & (table.rows["force_N"].abs() > 12.0 * 3.0 * NOISE["force_N"])
    assert told.size == pytest.approx(np.count_nonzero(clear), rel=0.05)
