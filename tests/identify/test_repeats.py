"""Which readings are repeats of each other, and what steps they are rounded to."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.identify.noise.components import estimate_noise
from femfit.identify.readings.bench import bench_observations
from femfit.identify.readings.settings import quantisation_step, repeat_cells
from support.campaign import NOISE, campaign


def test_readings_with_another_magnetic_history_are_no_repeats(levitation_model):
    """Two of four runs turn at half the current; the way down is then 8 sigma lower, as a minor loop's is."""
    table = campaign(levitation_model, 5, runs=4, distances=8, currents=9, mount_m=0.0, rho=0.0)
    half = (table.rows["run"] > 2.0).to_numpy()
    rows = table.rows[~half | (table.rows["current_A"] < 0.75)].reset_index(drop=True)
    lower = (rows["run"] > 2.0) & (rows["branch"] < 0.0)
    rows = rows.assign(force_N=rows["force_N"] - 8.0 * NOISE["force_N"] * lower, voltage_V=np.nan, hall_V=np.nan)
    observations = bench_observations(levitation_model, replace(table, rows=rows))
    noise = estimate_noise(observations)
    # About 100 repeats: 7 % standard error
    assert noise.sigma[noise.channels.index("force_N")] == pytest.approx(NOISE["force_N"], rel=0.2)
    down = np.flatnonzero(observations.column("branch") < 0.0)
    cells, run = repeat_cells(observations)[down], observations.column("run")[down]
    assert not set(cells[run < 2]) & set(cells[run > 1])


def test_without_an_order_or_branches_a_setting_has_no_history(levitation_model):
    table = campaign(levitation_model, 6, runs=2, distances=4, currents=4)
    for name in ("order", "branch"):
        given = tuple(one for one in table.given if one != name)
        rows = table.rows.assign(branch=0.0) if name == "branch" else table.rows
        observations = bench_observations(levitation_model, replace(table, rows=rows, given=given))
        assert len(np.unique(repeat_cells(observations))) == (4 * 4 if name == "branch" else 4 * 4 * 2)


@pytest.mark.parametrize("step", [1e-4, 0.00122, 3.0])
def test_the_step_of_a_converter_is_recognised(step):
    values = np.random.default_rng(1).normal(0.3, 12.0 * step, 200)
    assert quantisation_step(np.round(values / step) * step) == pytest.approx(step, rel=1e-6)


def test_readings_that_were_not_rounded_have_no_step():
    rng = np.random.default_rng(2)
    settings = np.repeat(rng.normal(size=40), 5)  # settings that repeat exactly are no converter's steps
    for values in (rng.normal(size=1000), settings, np.ones(30), np.zeros(0), np.array([1.0, 2.0])):
        assert quantisation_step(values) == 0.0


def test_a_converter_coarser_than_the_noise_bounds_it(levitation_model):
    table = campaign(levitation_model, 7, runs=3, mount_m=0.0, noise={"force_N": 1e-6})
    step = 5e-3
    rows = table.rows.assign(force_N=np.round(table.rows["force_N"] / step) * step)
    noise = estimate_noise(bench_observations(levitation_model, replace(table, rows=rows)))
    assert noise.never_varying == ("force_N",)
    assert noise.source == {"force_N": "resolution"}
    assert noise.sigma[0] == pytest.approx(step / np.sqrt(12.0))
