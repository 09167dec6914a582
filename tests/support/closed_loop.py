"""Records of closed loops: a model's plant with effects, held by controller and filter, seen by noisy sensors."""

import numpy as np
import pandas as pd

from femfit.model.with_effects import with_effects
from femfit.simulation.constants import SUPPORT_TIME_CONSTANTS
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import LoopRuns, run_together
from femfit.simulation.gains import design_backstepping
from femfit.simulation.loop import ClosedLoop, run_loop
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant, SensorErrors
from femfit.simulation.targets import Reference, reference_steps
from femfit.tables.measurement import SERIES_COLUMNS, TimeSeries, check_clock


def run(design, experiment, *, runs=4, steps=600, seed=1, supported_steps=300, plant=None):
    """The result of an experiment on a design's loop, all runs recorded."""
    random = np.random.default_rng(seed)
    loop = LoopRuns(design, experiment, random, runs, steps, steps, supported_steps, plant)
    return run_together([loop], "loop")[0]


def closed_loop(model, effects=(), *, runs=1, seconds=2.0, seed=0):
    """Samples of all runs without any noise but the Hall element's, which the filter acts on."""
    design = design_loop(model)
    plant = with_effects(design.model, effects)
    steps = int(seconds / model.sample_time_s)
    path = reference_steps(design.targets_m, steps, model.sample_time_s, design.reference_rate_rad_s)
    loop = ClosedLoop(
        plant=Plant(plant),
        sensors=design.loop_sensors(plant),
        errors=SensorErrors(),
        observer=design.observer("ukf"),
        controllers=(design_backstepping(design.model, design.points),),
        reference=Reference(*path, np.zeros((steps, 1))),
    )
    start = np.tile(operating_point(design.model, design.targets_m[0]).state[:3], (runs, 1))
    supported = design.steps(SUPPORT_TIME_CONSTANTS)
    (result,) = run_loop(loop, start, np.random.default_rng(seed), supported_steps=supported)
    series, rows = result.series, []
    channels = series.commands[..., 0], series.currents_A[..., 0], series.distance_m, series.readings[..., 0]
    for run in range(runs):
        values = [np.full(steps, run + 1.0), result.time_s, *(channel[:, run] for channel in channels)]
        rows.append(np.stack(values, axis=1)[np.isfinite(series.distance_m[:, run])])
    names = ["run", "time_s", "voltage_V", "current_A", "distance_m", "hall_V"]
    return pd.DataFrame(np.concatenate(rows), columns=names)


def recorded(samples, seed=0, *, distance_m=1e-5, current_A=1e-3, runs=(1,), converter_A=0.0, lost=0.0):
    """A time series of some runs, as instruments with white noise and perhaps a converter record it."""
    generator = np.random.default_rng(seed)
    rows = samples[samples["run"].isin(runs)].copy()
    rows["distance_m"] += distance_m * generator.standard_normal(len(rows))
    rows["current_A"] += current_A * generator.standard_normal(len(rows))
    if converter_A:
        rows["current_A"] = np.round(rows["current_A"] / converter_A) * converter_A
    rows = rows[generator.random(len(rows)) >= lost].reset_index(drop=True).reindex(columns=list(SERIES_COLUMNS))
    rows["segment"], _ = check_clock(rows)
    return TimeSeries(rows, tuple(name for name in SERIES_COLUMNS if rows[name].notna().any()))
