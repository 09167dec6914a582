"""What a record costs in one filter: a million samples in 50 s is the aim, 20,000 a second."""

from dataclasses import replace
from time import perf_counter

import pandas as pd
import pytest

import femfit as ff
from tests.support.replays import damped, logs

RUNS, STEPS = 25, 8000
SAMPLES = RUNS * STEPS


@pytest.mark.benchmark
@pytest.mark.parametrize("name", ["ukf", "ekf"])
def test_samples_a_second_of_one_filter(name):
    runs = logs(STEPS, RUNS, seed=7)[1]
    rows = pd.concat([one.rows.assign(run=k + 1.0, segment=k) for k, one in enumerate(runs)], ignore_index=True)
    record = replace(runs[0], rows=rows)
    begin = perf_counter()
    found = ff.observe(damped(), record, filter=name, find=False)
    took = perf_counter() - begin
    turns = found.filters[0].replayed.turns
    print(f"\n{name}: {SAMPLES / took:,.0f} samples a second ({SAMPLES:,} in {took:.1f} s, {turns} turns)")
    assert found.filters[0].replayed.mean.shape == (SAMPLES, 3)


@pytest.mark.benchmark
def test_what_the_search_for_the_noise_adds():
    record = logs(20_000, 1, seed=7)[1][0]
    begin = perf_counter()
    found = ff.observe(damped(), record)
    print(f"\nwith the noise: 20,000 samples in {perf_counter() - begin:.1f} s")
    assert found.noise is not None
