"""Measurements that could be added to a campaign, each as rows of settings or as a direct reading of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.effects.conditions import Nominal
from femfit.effects.effect import Calibration, Effect
from femfit.identify.readings.observations import Observations
from femfit.tables.measurement import CHANNELS, SETTINGS

_NEAR_PART, _NEAR_POINTS, _CURRENTS = 0.25, 6, 6
_HEATED_C = 30.0
_IN_WORDS = {
    "force_N": "force",
    "flux_linkage_Wb": "flux linkage",
    "hall_V": "Hall voltage",
    "voltage_V": "voltage across the winding",
}
_CHANNEL_COST, _HEAT_COST = 60.0, 120.0
"""Readings of a usual sweep that setting up a further sensor, or heating a part, takes the time of."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A measurement that could be added.

    Parameters
    ----------
    text : str
        What to do, as one plain sentence.
    cost : float
        In readings of the usual sweep.
    effect : str
        Of which parameters are read directly; empty for a run.
    """

    text: str
    cost: float
    rows: pd.DataFrame | None = None
    channels: tuple[str, ...] = ()
    effect: str = ""
    calibration: Calibration | None = None


def possible_experiments(
    observations: Observations, available: Sequence[str], effects: Sequence[Effect]
) -> list[Experiment]:
    """Measurements that would add something to a campaign."""
    nominal, measured = observations.nominal, observations.channels
    covariates = observations.covariates
    low, high = float(covariates["current_A"].min()), float(covariates["current_A"].max())
    branch = covariates["branch"]
    both_branches = bool((branch > 0).any() and (branch < 0).any())
    usual = _grid(nominal, low, high, (1.0,))
    near = usual[usual["distance_m"] <= _near_end(nominal)]
    result = [
        _run("Measure the same range once more, on a new mount", usual, measured),
        _run(f"Add {len(near)} points at {_range(near)} over the same currents", near, measured),
    ]
    if not both_branches:
        falling = _grid(nominal, low, high, (-1.0,))
        result.append(_run("Measure with falling current as well", falling, measured))
    if low >= 0.0 or high <= 0.0:
        turned = near.assign(current_A=-near["current_A"])
        result.append(_run(f"Reverse the current: {len(turned)} points at {_range(turned)}", turned, measured))
    wide = max(abs(nominal.current_min_A), abs(nominal.current_max_A))
    if max(abs(low), abs(high)) < 0.95 * wide:
        far = _grid(nominal, 0.7 * wide, wide, (1.0,))
        far = far[far["distance_m"] <= _near_end(nominal)]
        result.append(_run(f"Go up to {wide:.3g} A: {len(far)} points at {_range(far)}", far, measured))
    for name in CHANNELS:
        if name in available and name not in measured:
            more = _run(
                f"Read the {_IN_WORDS[name]} ({name}) too, at {len(near)} points at {_range(near)}",
                near,
                (*measured, name),
            )
            result.append(Experiment(more.text, more.cost + _CHANNEL_COST, more.rows, more.channels))
    for name, part in (("magnet_temperature_C", "magnet"), ("coil_temperature_C", "winding")):
        warm = near.assign(**{name: 20.0 + _HEATED_C})
        more = _run(
            f"Heat the {part} by {_HEATED_C:.0f} K, record its temperature ({name}) and add {len(warm)} points",
            warm,
            measured,
        )
        result.append(Experiment(more.text, more.cost + _HEAT_COST, more.rows, more.channels))
    result += [
        Experiment(calibration.instruction, calibration.cost, effect=effect.name, calibration=calibration)
        for effect in effects
        for calibration in effect.calibrations
    ]
    return sorted(result, key=lambda one: one.cost)


def _run(text: str, rows: pd.DataFrame, channels: tuple[str, ...]) -> Experiment:
    return Experiment(f"{text}.", float(len(rows)), rows.reset_index(drop=True), channels)


def _grid(nominal: Nominal, low: float, high: float, branches: tuple[float, ...]) -> pd.DataFrame:
    distances = np.linspace(nominal.distance_min_m, nominal.distance_max_m, 4 * _NEAR_POINTS)
    points = [(d, i, b) for d in distances for b in branches for i in np.linspace(low, high, _CURRENTS)]
    rows = pd.DataFrame(points, columns=["distance_m", "current_A", "branch"])
    for name, missing in SETTINGS.items():
        if name not in rows:
            rows[name] = missing
    return rows


def _near_end(nominal: Nominal) -> float:
    return nominal.distance_min_m + _NEAR_PART * (nominal.distance_max_m - nominal.distance_min_m)


def _range(rows: pd.DataFrame) -> str:
    return f"{1e3 * rows['distance_m'].min():.3g} to {1e3 * rows['distance_m'].max():.3g} mm"
