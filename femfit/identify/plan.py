"""Measurements that nobody has made yet: what a planned campaign could show, and what could be added to one.

What could be added is rows of settings, or a direct reading of an effect's parameters. Every setting lies in the
validity domain of the model: outside of it nothing is predicted, so nothing is promised.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.text import amount, amount_range, counted
from femfit.effects.catalogue import device_effects
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Nominal
from femfit.effects.effect import Calibration, Effect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.bench import bench_observations
from femfit.identify.decision.campaign import Campaign, detectable_magnitudes
from femfit.identify.decision.constants import (
    A_DECADE,
    CHANNEL_COST,
    CURRENTS,
    DISTANCES,
    HEAT_COST,
    HEATED_K,
    IMPEDANCE_DISTANCES,
    NEAR_SHARE,
    SMALL,
    VISIBLE,
)
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Start
from femfit.identify.separation import assumed_noise, pair_clauses, planned_noise, separation, starting_points
from femfit.identify.signatures import why_untestable
from femfit.identify.words import Result, printed
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import CHANNEL_WORDS, CHANNELS, SETTINGS, BenchTable
from femfit.tables.measurement_file import read_bench_table


@dataclass(frozen=True, eq=False, repr=False)
class PlanReport(Result):
    """What a plan can show; printed, it is what ``femfit suggest --plan`` prints."""

    noise: dict[str, float]  # Standard deviation of one reading per channel, as assumed or declared
    # Smallest magnitude of each effect's amplitudes that the plan would show nine times in ten
    detectable: dict[str, dict[str, float]]
    # Pairs of effects of which the one could be taken for the other even at its largest plausible size
    together: tuple[tuple[str, str], ...]
    small_together: tuple[tuple[str, str], ...]  # The same at three times the smallest size that the plan would show
    invisible: dict[str, str]  # Effects that the plan cannot show at their largest plausible size, and why
    # Per effect its smallest visible size in words, and the measurement that would read it directly
    smallest: dict[str, str]
    direct: dict[str, str]
    titles: dict[str, str]  # What texts call the numbers of the drawing

    def __str__(self) -> str:
        read = dict.fromkeys(name for pair in self.together for name in pair if name in self.direct)
        return titled(printed("plan", r=self, clauses=pair_clauses, read=read), self.titles)


def examine_plan(
    model: ActuatorModel, plan: BenchTable | str | Path, effects: Sequence[Effect] | None = None
) -> PlanReport:
    """Say what a planned bench campaign could not show or separate."""
    plan = read_bench_table(Path(plan), planned=True) if isinstance(plan, str | Path) else plan
    rows = plan.rows.assign(**dict.fromkeys(plan.channels, 0.0))
    observations = bench_observations(model, replace(plan, rows=rows))
    observations, nominal = observations.with_values(observations.base), observations.nominal
    effects = list(device_effects(nominal.circuits).values()) if effects is None else effects
    noise = planned_noise(observations)
    whitening = Whitening.granting(observations, noise)
    invisible: dict[str, str] = {}
    families: dict[str, list[Start]] = {}
    for effect in effects:
        reason = why_untestable(effect, observations)
        variants = [] if reason else [start for (start,) in starting_points([effect], whitening)]
        if any(_signals(start) for start in variants):
            families[effect.name] = variants
        else:
            invisible[effect.name] = reason or "its largest plausible size stays within the noise"
    starts = tuple(start for variants in families.values() for start in variants)
    campaign = Campaign(whitening, starts, invisible)
    detectable = detectable_magnitudes(campaign)
    small = {name: {p: SMALL * size for p, size in sizes.items()} for name, sizes in detectable.items()}
    return PlanReport(
        noise=noise.floor,
        detectable=detectable,
        together=_together(campaign, families, {}),
        small_together=_together(campaign, families, small),
        invisible=invisible,
        smallest={e.name: smallest_visible(e, detectable[e.name], nominal) for e in effects if e.name in detectable},
        direct={effect.name: effect.calibrations[0].instruction for effect in effects if effect.calibrations},
        titles=titles_of(effects),
    )


def _signals(start: Start, sizes: Mapping[str, float] | None = None) -> list[tuple[float, int]]:
    """(value, number) of each amplitude that can be seen at the further end of its plausible range, or smaller."""
    result = []
    for k, p in enumerate(start.columns.amplitudes):
        end = max((end - p.null for end in p.plausible), key=abs)
        if sizes and sizes[p.name] < abs(end):
            end = float(np.copysign(sizes[p.name], end))
        if np.linalg.norm(start.whitened[:, k] * end) > VISIBLE:
            result.append((end, k))
    return result


def _together(
    campaign: Campaign, families: Mapping[str, list[Start]], sizes: Mapping[str, Mapping[str, float]]
) -> tuple[tuple[str, str], ...]:
    """Pairs of effects of which one can make every visible amplitude of the other: a diagnosis would leave both."""
    signals = {name: _signals(starts[0], sizes.get(name)) for name, starts in families.items()}

    def could_be(effect: str, rival: str) -> bool:
        columns, rivals = families[effect][0].columns.columns, [[start] for start in families[rival]]
        return bool(signals[effect]) and all(
            separation(campaign.whitening, value * columns[:, k], rivals) is None for value, k in signals[effect]
        )

    return tuple((a, b) for a, b in combinations(families, 2) if could_be(a, b) or could_be(b, a))


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
    within_domain = f" from {amount_range(low, high, 'A')}, where the model holds," if held else ""
    usual = _grid(nominal, low, high)
    near = usual[usual["distance_m"] <= nominal.distance_min_m + NEAR_SHARE * nominal.travel_m]
    points = f"{counted(len(near), 'point')} at {_range(near)}"
    runs = {
        f"Measure the same range{within_domain} once more, on a new mount": usual,
        f"Add {points} over the same currents{within_domain.rstrip(',')}": near,
    }
    if not ((branch > 0).any() and (branch < 0).any()):
        runs["Measure with falling current as well"] = usual.assign(branch=-1.0)
    # Currents of the other sign, and larger ones, as far as the validity domain has them
    within = near["current_A"].between(-nominal.current_max_A, -nominal.current_min_A)
    turned = near[within].assign(current_A=-near.loc[within, "current_A"])
    if (low >= 0.0 or high <= 0.0) and (turned["current_A"] != 0.0).any():
        runs[f"Reverse the current: {len(turned)} points at {_range(turned)}"] = turned
    for bound, reached in ((nominal.current_max_A, high), (nominal.current_min_A, low)):
        if abs(bound) > max(abs(low), abs(high)) / 0.95 and bound * reached >= 0.0:
            larger = _grid(nominal, *sorted((0.7 * bound, bound)))
            larger = larger[larger["distance_m"] <= near["distance_m"].max()]
            runs[f"Go up to {bound:.3g} A: {len(larger)} points at {_range(larger)}"] = larger
    result = [_run(text, rows, measured) for text, rows in runs.items()]
    for name in (name for name in CHANNELS if name in available and name not in measured):
        noise = amount(assumed_noise(name, nominal), name)
        text = f"Read the {CHANNEL_WORDS[name]} {_BY.get(name, '')}too, to {noise} rms, at {points}"
        result.append(_run(text, near, (*measured, name), CHANNEL_COST))
    for name, body in {"magnet_temperature_C": "magnet", "coil_temperature_C": "winding"}.items():
        if body != "magnet" or nominal.has_magnet:
            text = f"Heat the {body} by {HEATED_K:.0f} K, record its temperature ({name}) and add "
            warm = near.assign(**{name: REFERENCE_TEMPERATURE_C + HEATED_K})
            result.append(_run(text + counted(len(near), "point"), warm, measured, HEAT_COST))
    return sorted([*result, *_direct(effects)], key=lambda experiment: experiment.cost)


def _direct(effects: Sequence[Effect]) -> list[Experiment]:
    return [
        Experiment(calibration.instruction, calibration.cost, effect=effect.name, calibration=calibration)
        for effect in effects
        for calibration in effect.calibrations
    ]


def _impedances(observations: Observations) -> list[Experiment]:
    """Further impedances: the same again, a decade of frequencies on either side, other distances, a warm winding."""
    nominal, measured = observations.nominal, observations.channels
    usual = observations.covariates[list(observations.settings)].drop_duplicates()
    places, f = usual.drop(columns="frequency_Hz").drop_duplicates(), usual["frequency_Hz"]
    everywhere = np.linspace(nominal.distance_min_m, nominal.distance_max_m, IMPEDANCE_DISTANCES)
    at_one = usual[usual["distance_m"] == usual["distance_m"].iloc[0]].drop(columns="distance_m")
    runs = {"Measure the same range once more, on a new mount": usual}
    for words, ends, far in (("down", (0.1 * f.min(), f.min()), 0), ("up", (f.max(), 10.0 * f.max()), 1)):
        decade = pd.DataFrame({"frequency_Hz": np.geomspace(*ends, A_DECADE)})
        text = f"Go {words} to {amount(ends[far], 'Hz')}, at {A_DECADE} frequencies and the same settings"
        runs[text] = places.merge(decade, how="cross")
    rows = pd.DataFrame({"distance_m": everywhere}).merge(at_one, how="cross")
    runs[f"Read impedances at {IMPEDANCE_DISTANCES} distances of the whole range"] = rows
    warm = _complete(usual).assign(coil_temperature_C=REFERENCE_TEMPERATURE_C + HEATED_K)
    text = (
        f"Heat the winding by {HEATED_K:.0f} K, record its temperature (coil_temperature_C) and measure the same range"
    )
    again = [_run(words, _complete(rows), measured) for words, rows in runs.items()]
    return [*again, _run(text, warm, measured, HEAT_COST)]


def _complete(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with every column of a setting."""
    return rows.assign(**{name: missing for name, missing in SETTINGS.items() if name not in rows})


def _run(text: str, rows: pd.DataFrame, channels: tuple[str, ...], further_cost: float = 0.0) -> Experiment:
    return Experiment(f"{text}.", len(rows) + further_cost, rows.reset_index(drop=True), channels)


def _grid(nominal: Nominal, low: float, high: float) -> pd.DataFrame:
    """Rising currents at every distance of a usual sweep."""
    distances = np.linspace(nominal.distance_min_m, nominal.distance_max_m, DISTANCES)
    points = [(d, i, 1.0) for d in distances for i in np.linspace(low, high, CURRENTS if high > low else 1)]
    return _complete(pd.DataFrame(points, columns=["distance_m", "current_A", "branch"]))


def _range(rows: pd.DataFrame) -> str:
    return f"{1e3 * rows['distance_m'].min():.3g} to {1e3 * rows['distance_m'].max():.3g} mm"
