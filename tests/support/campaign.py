"""Bench campaigns of a model: repeated cycles of the current, re-mounts, correlated noise, quantised readings."""

from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.identify.bench import bench_observations
from femfit.identify.noise.components import estimate_noise
from femfit.identify.settings import conditions_of
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import BenchTable
from support.added_effects import added as hidden

__all__ = ["LARGE", "NOISE", "campaign", "hidden", "noise_of", "observed", "ripple", "rising", "settings", "without"]

LARGE = {"distances": 10, "currents": 7}
"""A campaign of 420 rows, where 240 say too little."""

NOISE = {"force_N": 4e-4, "flux_linkage_Wb": 2e-5, "hall_V": 3e-3, "voltage_V": 3e-3}
OF_POT = {"force_N": 0.1, "flux_linkage_Wb": 5e-5, "voltage_V": 5e-3}


def settings(model, runs=3, distances=8, currents=5):
    """Rows of a campaign without readings: at each distance the current goes up and down once."""
    box = model.validity
    distance = np.linspace(1.02 * box.distance_min_m, 0.98 * box.distance_max_m, distances)
    rising = np.linspace(box.current_min_A, box.current_max_A, currents)
    cycle = np.concatenate([rising, rising[::-1]])
    branch = np.repeat([1.0, -1.0], currents)
    time = np.arange(distances * len(cycle), dtype=float)
    pieces = [
        pd.DataFrame(
            {
                "run": run + 1.0,
                "mount": run + 1.0,
                "order": time,
                "current_A": np.tile(cycle, distances),
                "distance_m": np.repeat(distance, len(cycle)),
                "branch": np.tile(branch, distances),
                "coil_temperature_C": 20.0 + 8.0 * (1.0 - np.exp(-time / 60.0)) + run,
                "magnet_temperature_C": 20.0 + 3.0 * (1.0 - np.exp(-time / 120.0)) + run,
            }
        )
        for run in range(runs)
    ]
    return pd.concat(pieces, ignore_index=True)


def campaign(model, seed, effects=(), *, mount_m=20e-6, rho=0.3, noise=NOISE, change=None, **size):
    """A bench table: the model with effects, seen through re-mounts and AR(1) noise.

    ``change`` maps (readings, rows) to readings, for what is no effect of the catalogue.
    """
    generator = np.random.default_rng(seed)
    rows = settings(model, **size)
    run = rows["run"].to_numpy(dtype=int) - 1
    numbered = rows.assign(run=run, mount=run, elapsed=rows["order"] + run * (1.0 + rows["order"].max()))
    at = conditions_of(numbered, nominal_of(model))
    distance = rows["distance_m"].to_numpy() + generator.normal(0.0, mount_m, run.max() + 1)[run]
    readings = predict_readings(model, distance, rows["current_A"].to_numpy(), at, effects)
    readings = change(readings, rows) if change else readings
    for channel, sigma in noise.items():
        fresh = generator.standard_normal(len(rows))
        error = fresh.copy()
        for k in range(1, len(rows)):
            if run[k] == run[k - 1]:
                error[k] = rho * error[k - 1] + np.sqrt(1.0 - rho**2) * fresh[k]
        value = readings[channel] + sigma * error
        step = 2.0 * np.abs(value).max() / 4096.0
        rows[channel] = np.round(value / step) * step
    kept = rows[generator.random(len(rows)) > 0.02].reset_index(drop=True)
    return BenchTable(rows=kept, given=tuple(kept.columns))


def observed(model, seed, effects=(), **options):
    """What a campaign shows beside the model."""
    return bench_observations(model, campaign(model, seed, effects, **options))


def noise_of(model, table, **changes):
    """The noise that is estimated from a table, or from one with these changes."""
    return estimate_noise(bench_observations(model, replace(table, **changes)))


def ripple(channel, size):
    """A stage's leadscrew of 9 mm pitch that one sensor alone feels: no effect of the catalogue."""

    def change(readings, rows):
        wave = size * np.sin(2.0 * np.pi * rows["distance_m"].to_numpy() / 9e-3)
        return readings | {channel: readings[channel] + wave}

    return change


def rising(table, every=1):
    """The way up of each cycle alone; of every fifth row none has a neighbour to guess a noise from."""
    rows = table.rows[table.rows["branch"] > 0].iloc[::every].reset_index(drop=True)
    return replace(table, rows=rows)


def without(table, *columns):
    """The table as if nobody had read these columns."""
    given = tuple(name for name in table.given if name not in columns)
    return replace(table, rows=table.rows.assign(**dict.fromkeys(columns, np.nan)), given=given)
