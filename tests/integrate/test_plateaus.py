"""Flux linkage on the plateaus of a record, against records whose noise and offset are known."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.integrate.bench_table import PlateauOptions, make_bench_table, plateau_flux

RATE, NOISE = 50.0, 1e-5
LEVEL = np.repeat([0.0, 1.0, 2.0, 1.0, 0.0], 80)
TIME = np.arange(len(LEVEL)) / RATE


def flux(voltage, current=LEVEL, time=None, **options):
    time = np.arange(len(current)) / RATE if time is None else time
    return plateau_flux(time, voltage, current, np.full(len(current), 0.02), PlateauOptions(**options))


def test_the_uncertainty_is_the_scatter_over_many_records_of_white_noise():
    generator = np.random.default_rng(2)
    found = [flux(generator.normal(0.0, NOISE, len(TIME)), settling=0.4) for _ in range(400)]
    scatter = np.sqrt(np.mean([one.flux**2 for one in found], axis=0))[1:]
    # 400 draws tell a standard deviation to 3.5 %; the steps of a plateau (80 or 60 samples) make up to 5 %.
    np.testing.assert_allclose(np.mean([one.sigma for one in found], axis=0)[1:], scatter, rtol=0.15)


def test_samples_that_average_over_the_beginning_of_a_change_lose_no_flux():
    ramp = np.linspace(0.0, 1.0, 21)
    current = np.concatenate([np.zeros(80), ramp[1:-1], np.ones(80), 1.0 - ramp[1:-1], np.zeros(80)])
    # dlambda/dt of each sample's surroundings, as a converter with its filter reads it, at 1 Wb/A.
    found = flux(np.gradient(current, 1.0 / RATE), current)
    # With the samples beside the change in the plateaus' means 1 % would be missing.
    np.testing.assert_allclose(found.flux, [0.0, 1.0, 0.0], atol=1e-12)


def test_the_wander_of_the_offset_between_plateaus_is_covered_by_the_uncertainty():
    generator = np.random.default_rng(6)
    current = np.repeat(np.arange(200) % 2, 200).astype(float)
    current[199::200] = 0.5
    found = []
    for _ in range(20):
        walk = np.cumsum(generator.normal(0.0, 1e-6, len(current)))
        found.append(flux(walk + generator.normal(0.0, 1e-7, len(current)), current, settling=0.5))
    scatter = np.sqrt(np.mean([one.flux[-1] ** 2 for one in found]))
    # Cautious, as neighbouring gaps' errors cancel in part; 20 draws tell the scatter to 16 %. White noise alone: 1 %.
    assert 1.0 < np.mean([one.sigma[-1] for one in found]) / scatter < 2.0


def test_an_offset_that_drifts_is_followed_from_plateau_to_plateau():
    voltage = 1e-3 * TIME / TIME[-1] + np.random.default_rng(4).normal(0.0, 1e-9, len(TIME))
    # What is left is the sag of each plateau's bridge, 1e-3 V / 8 s * (1.6 s)^2 / 12.
    assert np.abs(flux(voltage, settling=0.4).flux).max() < 6e-5


def test_the_branch_is_the_last_change_of_current_and_settling_shortens_plateaus():
    found = flux(np.random.default_rng(5).normal(0.0, NOISE, len(TIME)), settling=0.4)
    assert list(found.branch) == [0.0, 1.0, 1.0, -1.0, -1.0]
    # And by the sample before each change, which may hold a part of it.
    assert list(found.last - found.first) == [79, 59, 59, 59, 60]


def test_a_ramp_slower_than_the_limit_from_sample_to_sample_is_not_taken_for_a_plateau():
    ramp = np.linspace(0.0, 1.0, 2001)[1:-1]  # 0.5 mA a sample
    current = np.concatenate([np.zeros(80), ramp, np.ones(80), np.full(80, 2.0)])
    voltage = np.gradient(current, 1.0 / RATE)
    with pytest.raises(TableError, match="--still-A"):
        flux(voltage, current)
    np.testing.assert_allclose(flux(voltage, current, still_A=1e-4).flux, [0.0, 1.0, 2.0], atol=1e-9)


def test_a_clock_that_steps_back_is_refused():
    back = TIME.copy()
    back[200] = back[199]
    with pytest.raises(TableError, match="rise"):
        flux(LEVEL, time=back)


def test_rows_without_their_run_are_refused(tmp_path):
    rows = {"time_s": TIME, "coil_voltage_V": LEVEL, "current_A": LEVEL, "distance_m": 0.02}
    run = np.where(np.arange(len(TIME)) < 100, np.nan, 1.0)
    pd.DataFrame(rows | {"run": run}).to_csv(tmp_path / "some.csv", index=False)
    with pytest.raises(TableError, match="must say its run, or none; 100 do not"):
        make_bench_table(tmp_path / "some.csv")
