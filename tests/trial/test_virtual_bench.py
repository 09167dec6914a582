"""The virtual bench measures what the model says, and nothing is missing from a model measured on itself."""

import numpy as np
import pytest

from femfit.identify.decision.diagnose import diagnose
from femfit.tables.measurement import BenchTable
from femfit.trial.truth.thermal import COPPER_PER_K
from femfit.trial.virtual_bench import VirtualBench, measure


@pytest.fixture(scope="module")
def rows(levitation_model):
    return measure(levitation_model, VirtualBench(runs=3), np.random.default_rng(5))


def test_a_seed_gives_the_same_campaign(levitation_model, rows):
    again = measure(levitation_model, VirtualBench(runs=3), np.random.default_rng(5))
    np.testing.assert_array_equal(again.to_numpy(), rows.to_numpy())


def test_the_winding_follows_copper(levitation_model, rows):
    warm = 1.0 + COPPER_PER_K * (rows["coil_temperature_C"] - 20.0)
    expected = levitation_model.circuit.resistance_ohm * warm * rows["current_A"]
    # Noise of 0.1 % of the span, 336 readings
    assert abs((rows["voltage_V"] - expected).mean()) < 2e-3
    assert np.ptp(rows["coil_temperature_C"]) > 5.0


def test_a_model_measured_on_itself_lacks_nothing_but_the_winding_s_warming(levitation_model, rows):
    cold = rows.drop(columns="voltage_V")
    result = diagnose(levitation_model, BenchTable(_complete(cold), tuple(cold.columns)), bootstrap=0)
    assert result.verdict == "nothing_missing"
    full = diagnose(levitation_model, BenchTable(_complete(rows), tuple(rows.columns)), bootstrap=0)
    assert [one.name for one in full.missing] == ["coil_temperature"]


def _complete(rows):
    return rows.assign(voltage_V=rows.get("voltage_V", np.nan)).astype(float)
