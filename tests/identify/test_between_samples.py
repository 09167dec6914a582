"""Commands that change between the samples of a record: at an edge that no sample sees, or faster than it is logged."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from femfit.identify.series.observations import series_observations
from femfit.identify.series.samples import between_samples, held_from, take_samples
from support.closed_loop import recorded

FINER = 20  # steps of the winding within a sample
HELD_M = 0.022


def record(model, command, step_s):
    """A held body's samples, one of every so many steps of a winding that such commands drive, with noise."""
    time, resistance = step_s / FINER * np.arange(8000 * FINER), model.circuit.resistance_ohm
    volts, kept = command(time), np.exp(-resistance / model.inductance(HELD_M, 0.5) * step_s / FINER)
    current = lfilter([0.0, (1.0 - kept) / resistance], [1.0, -kept], volts)
    here = slice(None, None, FINER)
    columns = {"run": 1.0, "time_s": time[here], "voltage_V": volts[here], "current_A": current[here]}
    return recorded(pd.DataFrame({**columns, "distance_m": HELD_M}), distance_m=0.0)


def switched(edge_s):
    """Commands that go between levels so long after a sample."""
    levels = np.array([0.8, 2.4, 1.2, 2.8, 0.6, 2.0])
    return lambda time: levels[(np.floor((time - edge_s) / 0.4 + 1e-6)).astype(int) % len(levels)]


@pytest.fixture(scope="module")
def model(levitation_model):
    """Held: without a motion, whose force would be compared, and without a Hall element."""
    return replace(levitation_model, motion=None, sensor=None)


@pytest.fixture(scope="module")
def at_samples(model):
    return record(model, switched(0.0), model.sample_time_s)


def misfit(model, series):
    """Of each window's voltage, over its noise."""
    observations = series_observations(model, series)
    return observations.residual / observations.declared_noise["voltage_balance_V"]


@pytest.mark.parametrize("edge_s", [0.0, 0.185e-3, 0.45e-3])
def test_edges_are_balanced_wherever_they_are_between_two_samples(model, edge_s):
    left = misfit(model, record(model, switched(edge_s), model.sample_time_s))
    assert 0.8 < np.sqrt(np.mean(left**2)) < 1.15  # 222 windows: 5 %, and edges at samples make no error
    assert np.abs(left).max() < 4.5


def test_an_edge_still_shows_an_inductance_that_the_model_lacks(model, at_samples):
    longer = replace(model, circuits=(replace(model.circuit, inductance_H=3e-3),))  # 18 % of the winding's own
    assert np.abs(misfit(longer, at_samples)).max() > 4.5


def test_a_command_that_changes_from_sample_to_sample_is_held_between_them(model, at_samples):
    samples = take_samples(model, at_samples)
    volts, held = samples.columns["voltage_V"], held_from(samples, 0)
    mean, error = between_samples(samples, 0, held, model.sample_time_s)
    np.testing.assert_array_equal(mean, volts)
    np.testing.assert_allclose(error, np.append(np.diff(volts), 0.0) ** 2 / 3.0)
    volts += 1e-3 * np.random.default_rng(2).standard_normal(len(volts))
    mean, error = between_samples(samples, 0, held, model.sample_time_s)
    np.testing.assert_array_equal(mean, volts)
    assert not error.any()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_commands_that_a_slow_record_does_not_show_count_as_its_noise(model, seed):
    fast = replace(model, sample_time_s=0.1 * model.sample_time_s)
    scatter = 0.15 * np.random.default_rng(seed).standard_normal(80000)

    def command(time):
        place = np.floor(time / fast.sample_time_s + 1e-6).astype(int)
        return 1.6 + 0.4 * np.sin(2.0 * np.pi * time / 0.37) + scatter[place]

    left = misfit(fast, record(model, command, model.sample_time_s))
    assert 0.85 < np.sqrt(np.mean(left**2)) < 1.15
