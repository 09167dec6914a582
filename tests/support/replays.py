"""Records of a body on a spring whose noises are known, as a lab would log them."""

from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.estimate.noise import FilterNoise, process_covariance
from femfit.model.validity import ProcessNoise
from femfit.tables.measurement import TimeSeries
from support.readings import predict_sensors
from support.solenoids import solenoid
from support.steps import runge_kutta_step

STEP_S = 1e-4
TRUE = {"acceleration": 1e-3**0.5, "voltage": 0.1, "current": 4e-3, "laser": 2e-5}
"""Standard deviations of a sample, and the root of the acceleration's density."""


def damped(noises=TRUE):
    """A solenoid of 25 g with a damper and without stops, whose file says some noises."""
    free = replace(solenoid().motion, near_stop=None, far_stop=None, viscous_N_s_per_m=2.0)
    sensors = (
        CurrentSensor(name="current", noise=noises["current"], circuit="coil"),
        PositionSensor(name="laser", noise=noises["laser"], distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m"),
    )
    known = ProcessNoise(noises["acceleration"] ** 2, noises["voltage"])
    return replace(solenoid(free), sample_time_s=STEP_S, other_sensors=sensors, process_noise=known)


def logs(steps, runs, seed):
    """Truth of shape (steps, runs, 3), and a record a run, of a coil fed with a square wave of 3 and 9 V."""
    model, generator = damped(), np.random.default_rng(seed)
    volts = 6.0 + 3.0 * np.sign(np.sin(np.arange(steps) / 47.0))
    noise = FilterNoise(TRUE["acceleration"] ** 2, TRUE["voltage"], 1.0)
    factor = np.linalg.cholesky(process_covariance(model, noise, 3.05e-3))
    state, truth = np.tile([3.5e-3, 0.0, 0.2], (runs, 1)), np.empty((steps, runs, 3))
    for k in range(steps):
        truth[k] = state
        state = runge_kutta_step(model, state, np.full(runs, volts[k]), STEP_S)
        state = state + generator.standard_normal((runs, 3)) @ factor.T
    readings = predict_sensors(model, truth) + generator.standard_normal((steps, runs, 2)) * [4e-3, 2e-5]
    return truth, [series(volts, readings[:, k, 0], readings[:, k, 1]) for k in range(runs)]


def changed(record, **columns):
    """A record with other columns."""
    return replace(record, rows=record.rows.assign(**columns))


def series(volts, current=None, distance=None, segment=0, source="log"):
    """A record as read from a file."""
    columns = {"voltage_V": volts, "current_A": current, "distance_m": distance}
    given = tuple(name for name, values in columns.items() if values is not None)
    time = STEP_S * np.arange(len(volts))
    empty = np.full(len(volts), np.nan)
    rows = pd.DataFrame({"run": 1.0, "time_s": time, "hall_V": empty, "force_N": empty, "segment": segment})
    rows = rows.assign(**{name: empty if values is None else values for name, values in columns.items()})
    return TimeSeries(rows=rows, given=("time_s", *given), source=source)
