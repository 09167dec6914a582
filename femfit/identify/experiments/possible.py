"""Measurements that could be added to a campaign: rows of settings, or a direct reading of an effect's parameters.

Every setting lies in the validity domain of the model: outside of it nothing is predicted, so nothing is promised.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.core.amount import amount, amount_range, counted
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Nominal
from femfit.effects.effect import Calibration, Effect
from femfit.identify.experiments.constants import (
    A_DECADE,
    CHANNEL_COST,
    CURRENTS,
    DISTANCES,
    HEAT_COST,
    HEATED_K,
    IMPEDANCE_DISTANCES,
    NEAR_SHARE,
)
from femfit.identify.experiments.noise import assumed_noise
from femfit.identify.readings.observations import Observations
from femfit.tables.measurement import CHANNEL_WORDS, CHANNELS, SETTINGS

_BY = {"inductance_H": "by an LCR meter ", "resistance_ohm": "by an LCR meter "}
"""What a channel is read by, where that is no part of the bench itself."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A measurement that could be added."""

    text: str
    cost: float
    rows: pd.DataFrame | None = None
    channels: tuple[str, ...] = ()
    effect: str = ""  # Whose parameters are read directly; empty for a run
    calibration: Calibration | None = None


def possible_experiments(
    observations: Observations, available: Sequence[str], effects: Sequence[Effect]
) -> list[Experiment]:
    """Measurements that would add something to a campaign, the cheapest first; equally dear ones as they stand here."""
    nominal, measured = observations.nominal, observations.channels
    if observations.of_impedances:
        return sorted([*_impedances(observations), *_direct(effects)], key=lambda experiment: experiment.cost)
    current, branch = observations.covariates["current_A"], observations.covariates["branch"]
    low, high = np.clip([current.min(), current.max()], nominal.current_min_A, nominal.current_max_A).tolist()
    held = low > current.min() or high < current.max()
    part = f" from {amount_range(low, high, 'A')}, where the model holds," if held else ""
    usual = _grid(nominal, low, high)
    near = usual[usual["distance_m"] <= nominal.distance_min_m + NEAR_SHARE * nominal.travel_m]
    result = [
        _run(f"Measure the same range{part} once more, on a new mount", usual, measured),
        _run(
            f"Add {counted(len(near), 'point')} at {_range(near)} over the same currents{part.rstrip(',')}",
            near,
            measured,
        ),
    ]
    if not ((branch > 0).any() and (branch < 0).any()):
        result.append(_run("Measure with falling current as well", usual.assign(branch=-1.0), measured))
    result += [
        _run(text.format(count=len(more), where=_range(more)), more, measured)
        for text, more in _other_currents(nominal, near, low, high)
    ]
    result += [
        _run(
            f"Read the {CHANNEL_WORDS[name]} {_BY.get(name, '')}too, to "
            f"{amount(assumed_noise(name, nominal), name)} rms, at {counted(len(near), 'point')} at {_range(near)}",
            near,
            (*measured, name),
            CHANNEL_COST,
        )
        for name in CHANNELS
        if name in available and name not in measured
    ]
    parts = {"magnet_temperature_C": "magnet", "coil_temperature_C": "winding"}
    result += [
        _run(
            f"Heat the {part} by {HEATED_K:.0f} K, record its temperature ({name}) and add "
            f"{counted(len(near), 'point')}",
            near.assign(**{name: REFERENCE_TEMPERATURE_C + HEATED_K}),
            measured,
            HEAT_COST,
        )
        for name, part in parts.items()
        if part != "magnet" or nominal.has_magnet
    ]
    result += _direct(effects)
    return sorted(result, key=lambda experiment: experiment.cost)


def _direct(effects: Sequence[Effect]) -> list[Experiment]:
    return [
        Experiment(one.instruction, one.cost, effect=effect.name, calibration=one)
        for effect in effects
        for one in effect.calibrations
    ]


def _impedances(observations: Observations) -> list[Experiment]:
    """Further impedances: the same again, a decade of frequencies on either side, other distances, a warm winding."""
    nominal, measured = observations.nominal, observations.channels
    usual = observations.covariates[list(observations.settings)].drop_duplicates()
    places, f = usual.drop(columns="frequency_Hz").drop_duplicates(), usual["frequency_Hz"]
    decades = {"Go down": (0.1 * f.min(), f.min()), "Go up": (f.max(), 10.0 * f.max())}
    result = [_run("Measure the same range once more, on a new mount", _complete(usual), measured)]
    for words, ends in decades.items():
        rows = places.merge(pd.DataFrame({"frequency_Hz": np.geomspace(*ends, A_DECADE)}), how="cross")
        far = amount(ends[words == "Go up"], "Hz")
        result.append(
            _run(f"{words} to {far}, at {A_DECADE} frequencies and the same settings", _complete(rows), measured)
        )
    everywhere = np.linspace(nominal.distance_min_m, nominal.distance_max_m, IMPEDANCE_DISTANCES)
    at_one = usual[usual["distance_m"] == usual["distance_m"].iloc[0]].drop(columns="distance_m")
    rows = pd.DataFrame({"distance_m": everywhere}).merge(at_one, how="cross")
    result.append(
        _run(f"Read impedances at {IMPEDANCE_DISTANCES} distances of the whole range", _complete(rows), measured)
    )
    warm = _complete(usual).assign(coil_temperature_C=REFERENCE_TEMPERATURE_C + HEATED_K)
    text = (
        f"Heat the winding by {HEATED_K:.0f} K, record its temperature (coil_temperature_C) and measure the same range"
    )
    return [*result, _run(text, warm, measured, HEAT_COST)]


def _complete(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with every column of a setting."""
    return rows.assign(**{name: missing for name, missing in SETTINGS.items() if name not in rows})


def _other_currents(nominal: Nominal, near: pd.DataFrame, low: float, high: float) -> list[tuple[str, pd.DataFrame]]:
    """Currents of the other sign, and larger ones, as far as the validity domain has them."""
    result = []
    within = near["current_A"].between(-nominal.current_max_A, -nominal.current_min_A)
    turned = near[within].assign(current_A=-near.loc[within, "current_A"])
    if (low >= 0.0 or high <= 0.0) and (turned["current_A"] != 0.0).any():
        result.append(("Reverse the current: {count} points at {where}", turned))
    for bound, reached in ((nominal.current_max_A, high), (nominal.current_min_A, low)):
        if abs(bound) > max(abs(low), abs(high)) / 0.95 and bound * reached >= 0.0:
            larger = _grid(nominal, *sorted((0.7 * bound, bound)))
            larger = larger[larger["distance_m"] <= near["distance_m"].max()]
            result.append((f"Go up to {bound:.3g} A: {{count}} points at {{where}}", larger))
    return result


def _run(text: str, rows: pd.DataFrame, channels: tuple[str, ...], further_cost: float = 0.0) -> Experiment:
    return Experiment(f"{text}.", len(rows) + further_cost, rows.reset_index(drop=True), channels)


def _grid(nominal: Nominal, low: float, high: float) -> pd.DataFrame:
    """Rising currents at every distance of a usual sweep."""
    distances = np.linspace(nominal.distance_min_m, nominal.distance_max_m, DISTANCES)
    points = [(d, i, 1.0) for d in distances for i in np.linspace(low, high, CURRENTS if high > low else 1)]
    return _complete(pd.DataFrame(points, columns=["distance_m", "current_A", "branch"]))


def _range(rows: pd.DataFrame) -> str:
    return f"{1e3 * rows['distance_m'].min():.3g} to {1e3 * rows['distance_m'].max():.3g} mm"
