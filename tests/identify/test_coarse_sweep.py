"""A bench beside a model of a sweep that is too coarse: the sweep is named, and no effect."""

import numpy as np
import pytest

import femfit as ff
from support.closed_forms import FEW, NARROW, VALVE
from support.sweeps import force_table


def bench_of(path, turns):
    """Two runs between the points of the sweep, of a winding with so many times the turns, without any other error."""
    currents, distances = np.linspace(0.25, 5.75, 9), 1e-3 * np.array([0.06, 0.1, 0.15, 0.21, 0.3])
    rows, rng = force_table(VALVE.force, currents, distances).rows, np.random.default_rng(1)
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    read = {"force_N": VALVE.force(d, turns * i), "flux_linkage_Wb": turns * VALVE.flux_linkage(d, turns * i)}
    table = rows[["distance_m", "current_A"]].assign(run=1)
    for run in (1, 2):
        noisy = {name: x + 2e-3 * np.ptp(x) * rng.normal(size=len(x)) for name, x in read.items()}
        table.assign(run=run, **noisy).to_csv(path, mode="a", header=run == 1, index=False)
    return ff.read_measurement(path)


@pytest.fixture(scope="module")
def coarse():
    return ff.fit_model(VALVE.table(FEW, NARROW)).model


@pytest.mark.parametrize("turns", [1.0, 0.9])
def test_a_coarse_sweep_is_named_with_what_to_add_in_place_of_an_effect_that_is_none(coarse, tmp_path, turns):
    data = bench_of(tmp_path / "bench.csv", turns)
    diagnosis = ff.diagnose(coarse, data)
    if turns == 1.0:
        assert (diagnosis.verdict, diagnosis.missing) == ("nothing_missing", ())
    else:
        assert diagnosis.verdict != "nothing_missing"
    for text in (str(diagnosis), str(ff.compare(coarse, data))):
        assert "Add to [sweep] the distances" in text
