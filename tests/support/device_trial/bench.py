"""Bench tables of a device in one of its forms, through bent meters, a bent stage or a carried spring.

Every reading is a solution of the form's field; the fitted model gives only what some micrometres of a re-mount change.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.trial.virtual_bench import Meter, measured
from support.device_trial.causes import CLEAN, Cause
from support.device_trial.drawings import DRAWN
from support.device_trial.tables import SolvedDevice

MOVED_M = 0.15e-3
"""How much higher a coil sits on its former."""

BENT_STAGE_M = {"solenoid": 40e-6, "voice-coil": 120e-6}
BENT_LOAD_CELL = 0.03
"""Loss at full scale, growing with the cube of the force."""

KINK_M, KINK_N_PER_M = 1.5e-3, 500.0
"""Where the carried spring's coils begin to touch, and its further stiffness from there."""


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign's file, and how much its cause shows: rms over the noise in the channel that shows it most."""

    rows: pd.DataFrame
    over_noise: float


def bench_campaign(device: SolvedDevice, cause: Cause | None, rng: np.random.Generator) -> Campaign:
    """Two to four runs over all settings; nothing is hidden without a cause."""
    runs = int(rng.integers(2, 5))
    dials = _dials(device, runs)
    shift = rng.normal(0.0, rng.uniform(0.0, 12e-6), runs)[dials["run"].to_numpy() - 1]
    real = _readings(device, cause, dials, shift)
    meters = _meters(real, rng)
    rows = dials.drop(columns=["row", "column"])
    for name, meter in meters.items():
        rows[name] = measured(real[name], meter, rows["run"].to_numpy(), rng)
    clean, hidden = (_readings(device, one, dials, 0.0 * shift) for one in (None, cause))
    shown = [float(np.sqrt(np.mean((hidden[name] - clean[name]) ** 2))) / meter.sigma for name, meter in meters.items()]
    return Campaign(rows[rng.random(len(rows)) > 0.02].reset_index(drop=True), max(shown))


def _dials(device: SolvedDevice, runs: int) -> pd.DataFrame:
    distance, current = device.settings
    row, column = (one.ravel() for one in np.mgrid[0 : len(distance), 0 : len(current)])
    one = pd.DataFrame({"distance_m": distance[row], "current_A": current[column], "row": row, "column": column})
    return pd.concat([one.assign(run=k + 1, order=np.arange(len(one))) for k in range(runs)], ignore_index=True)


def _readings(
    device: SolvedDevice, cause: Cause | None, dials: pd.DataFrame, shift: FloatArray
) -> Mapping[str, FloatArray]:
    hidden = CLEAN if cause is None else cause.name
    form = device.forms.get(hidden, device.forms[DRAWN])
    place = dials["row"].to_numpy(), dials["column"].to_numpy()
    d, i = dials["distance_m"].to_numpy(), dials["current_A"].to_numpy()
    true = d + shift
    if hidden == "coil_moved":
        true = true + MOVED_M
    if hidden == "bent_stage":
        x = 2.0 * (d - d.min()) / np.ptp(d) - 1.0
        true = true + BENT_STAGE_M[device.name] * (2.5 * x**3 - 1.5 * x)
    model = device.model.magnetics
    force = form.force[place] + model.force(true, i) - model.force(d, i)
    flux = form.flux_linkage[place] + model.flux_linkage(true, i) - model.flux_linkage(d, i)
    if hidden == "bent_load_cell":
        force = force * (1.0 - BENT_LOAD_CELL * (force / np.abs(force).max()) ** 2)
    if hidden == "carried_spring":
        force = force - device.actuator.mechanics.push_of_springs(true)
        force = force - KINK_N_PER_M * np.maximum(KINK_M - true, 0.0)
    return {"force_N": force, "flux_linkage_Wb": flux, "voltage_V": form.resistance_ohm * i}


def _meters(real: Mapping[str, FloatArray], rng: np.random.Generator) -> dict[str, Meter]:
    """The force and most of the others, with noise of 0.1 to 0.5 % of a channel's span."""
    chance = {"force_N": 1.0, "flux_linkage_Wb": 0.7, "voltage_V": 0.5}
    return {
        name: Meter(
            sigma=float(np.exp(rng.uniform(np.log(1e-3), np.log(5e-3)))) * float(np.ptp(values)),
            rho=float(rng.uniform(0.0, 0.5)),
            full_scale=1.3 * float(np.abs(values).max()),
        )
        for name, values in real.items()
        if rng.random() < chance[name]
    }
