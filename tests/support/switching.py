"""Records of a solenoid that switches, and of one whose body is blocked, as a lab would log them."""

import numpy as np
import pandas as pd

import femfit as ff
from femfit.simulation.profile import Profile
from femfit.tables.measurement import SERIES_COLUMNS, TimeSeries
from support.parts import with_motion
from support.replays import series
from support.solenoids import solenoid

STEP_S = 1e-4
CURRENT_A, DISTANCE_M = 5e-3, 2e-5
"""Standard deviations of a sample."""


def pulse(kind, on, off=0.0, end=0.02):
    """A command that is held until then, and the one from there on."""
    return Profile(kind, np.array([0.0, end]), np.array([on, off]))


def switched(turns_s, volts, seconds, model=None, start_m=None, blocked=False):
    """An open loop with these commands from these times on; a blocked body stays where it begins."""
    model = model or solenoid()
    if blocked:  # too heavy to move
        model = with_motion(model, mass_kg=1e9, near_stop=None, far_stop=None)
    drive = Profile("voltage", np.array(turns_s, float), np.array(volts, float))
    return ff.simulate(model, drive=drive, duration_s=seconds, sample_time_s=STEP_S, start_m=start_m)


def logged(loops, seed=1, noise=(CURRENT_A, DISTANCE_M), drop=()):
    """One record with a run an open loop, with noise of current in A and distance in m, and the commands as given."""
    generator, rows = np.random.default_rng(seed), []
    for number, loop in enumerate(loops):
        table, (command,) = loop.table, loop.profiles
        held = np.searchsorted(command.time_s, table["time_s"] + 1e-9, side="right") - 1
        current, distance = (
            table[name] + size * generator.standard_normal(len(held))
            for name, size in zip(("current_A", "distance_m"), noise, strict=True)
        )
        log = series(command.value[np.maximum(held, 0)], current, distance, segment=number)
        rows.append(log.rows.assign(run=number + 1.0, time_s=table["time_s"]))
    given = tuple(name for name in ("run", "time_s", "voltage_V", "current_A", "distance_m") if name not in drop)
    table = pd.concat(rows, ignore_index=True).reindex(columns=[*SERIES_COLUMNS, "segment"])
    return TimeSeries(rows=table.assign(**dict.fromkeys(drop, np.nan)), given=given, source="switched.csv")
