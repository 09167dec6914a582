"""Measurements that nobody has made yet: what a planned campaign could show, and what could be added to one.

What could be added is rows of settings, or a direct reading of an effect's parameters. Every setting lies in the
validity domain of the model: outside of it nothing is predicted, so nothing is promised. The noise of such a
measurement is as estimated or declared, or as assumed. What one effect changes of readings, another one explains up to
what its best refit leaves, within its bounds and with its nonlinear parameters free, in standard deviations of the
noise: the T-criterion of a discriminating design.

References
----------
A. C. Atkinson and V. V. Fedorov, Biometrika 62 (1975) 57: T-optimal designs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, groupby, permutations
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import ROUNDING
from femfit.effects.catalogue import device_effects
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Nominal
from femfit.effects.effect import Calibration, Effect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.bench import bench_observations
from femfit.identify.constants import PRIOR_MOUNT_M, PRIOR_RUN
from femfit.identify.decision.campaign import Campaign, detectable_magnitudes
from femfit.identify.decision.constants import (
    CHANNEL_COST,
    CURRENTS,
    DISTANCES,
    GUESSED_NOISE,
    HEAT_COST,
    HEATED_K,
    LARGEST_BENDING,
    NEAR_SHARE,
    NEEDED_DISTANCE,
    VISIBLE,
)
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Start, fitted_together, refit
from femfit.identify.signatures import testable_columns
from femfit.identify.words import Result, printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.header import parts_of
from femfit.tables.measurement import CHANNELS, SETTINGS, BenchTable
from femfit.tables.measurement_file import read_bench_table


@dataclass(frozen=True, eq=False, repr=False)
class PlanReport(Result):
    """What a plan can show; printed, it is what ``femfit suggest --plan`` prints."""

    noise: dict[str, float]  # Standard deviation of one reading per channel, as assumed or declared
    # Smallest magnitude of each effect's amplitudes that the plan would show nine times in ten
    detectable: dict[str, dict[str, float]]
    invisible: dict[str, str]  # Effects that the plan cannot show at their largest plausible size, and why
    # Pairs of effects of which the one could be taken for the other even at its largest plausible size
    together: tuple[tuple[str, str], ...]
    smallest: dict[str, str]  # Per effect its smallest visible size in words
    direct: dict[str, str]  # Per effect the measurement that would read it directly
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
    columns, invisible = testable_columns(observations, effects)
    families = {name: list(all_of) for name, all_of in groupby(Start.at_null(columns, whitening), attrgetter("name"))}
    for name in [name for name, starts in families.items() if not any(map(_signals, starts))]:
        invisible[name] = "its largest plausible size stays within the noise"
        del families[name]
    starts = tuple(start for variants in families.values() for start in variants)
    campaign = Campaign(whitening, starts, invisible)
    detectable = detectable_magnitudes(campaign)
    return PlanReport(
        noise=noise.floor,
        detectable=detectable,
        invisible=invisible,
        together=_together(whitening, families),
        direct={effect.name: effect.calibrations[0].instruction for effect in effects if effect.calibrations},
        smallest={e.name: smallest_visible(e, detectable[e.name], nominal) for e in effects if e.name in detectable},
        titles=titles_of(effects),
    )


def _signals(start: Start) -> list[tuple[float, int]]:
    """(value, number) of each amplitude that can be seen at the further end of its plausible range."""
    ends = [max((end - p.null for end in p.plausible), key=abs) for p in start.columns.amplitudes]
    return [(end, k) for k, end in enumerate(ends) if np.linalg.norm(start.whitened[:, k] * end) > VISIBLE]


def _together(whitening: Whitening, families: Mapping[str, Sequence[Start]]) -> tuple[tuple[str, str], ...]:
    """Pairs of effects of which one can make every visible amplitude of the other: a diagnosis would leave both."""
    base, signals = whitening.observations.base, {name: _signals(starts[0]) for name, starts in families.items()}

    def hidden(effect: str, rival: str) -> bool:
        changes = [value * families[effect][0].columns.columns[:, k] for value, k in signals[effect]]
        rivals = [[start] for start in families[rival]]
        return bool(changes) and all(separation(whitening.with_values(base + c), rivals) is None for c in changes)

    taken_for = {pair for pair in permutations(families, 2) if hidden(*pair)}
    return tuple((a, b) for a, b in combinations(families, 2) if {(a, b), (b, a)} & taken_for)


def separation(whitening: Whitening, rivals: Sequence[Sequence[Start]]) -> float | None:
    """How far the best refit of rivals stays from predicted readings; None where that is less than needed."""
    target = whitening.residual
    total = float(target @ target)
    fits = [fitted_together(target, starts) for starts in rivals]
    begun, fall = max(fits, key=lambda pair: pair[1], default=(None, 0.0))
    least = max(total - fall, 0.0)
    # No refit where the first order leaves less than needed already, nor where no nonlinear parameter makes up for it
    if begun is not None and np.sqrt(least) >= NEEDED_DISTANCE and least <= LARGEST_BENDING**2 * total:
        least = max(min(refit(whitening, begun).chi2, least), 0.0)
    apart = float(np.sqrt(least))
    return None if apart < NEEDED_DISTANCE * (1.0 - ROUNDING) else apart


def pair_clauses(pairs: Iterable[Sequence[str]]) -> list[tuple[str, list[str]]]:
    """Pairs in as few clauses as say them: a name, and those that it stands with."""
    remaining, clauses = [pair[:2] for pair in pairs], []
    while remaining:
        names = [name for pair in remaining for name in pair]
        name = max(dict.fromkeys(names), key=names.count)
        clauses.append((name, [a if b == name else b for a, b in remaining if name in {a, b}]))
        remaining = [pair for pair in remaining if name not in pair]
    return clauses


def planned_noise(observations: Observations) -> NoiseModel:
    """The noise model of a plan: declared noise, and the priors of mounts and runs that estimates start from."""
    channels, declared = observations.channels, observations.declared_noise
    sigma = np.array([declared.get(name, assumed_noise(name, observations.nominal)) for name in channels])
    zeros, many = np.zeros(len(channels)), np.full(len(channels), np.inf)
    source = {name: "declared" if name in declared else "assumed" for name in channels}
    run = PRIOR_RUN * sigma
    return NoiseModel(channels, sigma, zeros, PRIOR_MOUNT_M, run, many, many, source)


def noise_for(noise: NoiseModel, observations: Observations) -> NoiseModel:
    """An estimated noise model, with what is assumed for channels that were never measured."""
    planned, channels = planned_noise(replace(observations, declared_noise={})), list(observations.channels)
    estimated = replace(noise, run=np.where(noise.run > 0.0, noise.run, PRIOR_RUN * noise.sigma))
    filled: dict[str, Any] = {"mount_m": noise.mount_m or PRIOR_MOUNT_M}
    for name in ("sigma", "rho", "run", "repeats", "degrees_of_freedom"):
        measured = pd.Series(getattr(estimated, name), noise.channels).reindex(channels)
        filled[name] = measured.fillna(pd.Series(getattr(planned, name), channels)).to_numpy()
    return replace(noise, channels=observations.channels, **filled)


def assumed_noise(channel: str, nominal: Nominal) -> float:
    """The noise of a channel that was never measured, by its largest reading in the validity domain."""
    if channel == "hall_V":
        return GUESSED_NOISE * nominal.hall_swing_V
    quantity, _ = parts_of(channel)
    if quantity == "voltage_V":
        return GUESSED_NOISE * nominal.resistance_ohm * nominal.peak_current_A
    return GUESSED_NOISE * float(getattr(nominal, quantity))


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
    direct = [
        Experiment(calibration.instruction, calibration.cost, effect=effect.name, calibration=calibration)
        for effect in effects
        for calibration in effect.calibrations
    ]
    if observations.of_impedances:
        return sorted(direct, key=attrgetter("cost"))
    current, branch = observations.covariates["current_A"], observations.covariates["branch"]
    low, high = np.clip([current.min(), current.max()], nominal.current_min_A, nominal.current_max_A).tolist()
    within_domain = (low, high) if low > current.min() or high < current.max() else None
    usual = _grid(nominal, low, high)
    near = usual[usual["distance_m"] <= nominal.distance_min_m + NEAR_SHARE * nominal.travel_m]
    result = [_run(usual, measured, "once_more", within_domain), _run(near, measured, "nearer", within_domain)]
    if not ((branch > 0).any() and (branch < 0).any()):
        result.append(_run(usual.assign(branch=-1.0), measured, "falling"))
    # Currents of the other sign, and larger ones, as far as the validity domain has them
    within = near["current_A"].between(-nominal.current_max_A, -nominal.current_min_A)
    turned = near[within].assign(current_A=-near.loc[within, "current_A"])
    if (low >= 0.0 or high <= 0.0) and (turned["current_A"] != 0.0).any():
        result.append(_run(turned, measured, "reversed"))
    for bound, reached in ((nominal.current_max_A, high), (nominal.current_min_A, low)):
        if abs(bound) > max(abs(low), abs(high)) / 0.95 and bound * reached >= 0.0:
            larger = _grid(nominal, *sorted((0.7 * bound, bound)))
            larger = larger[larger["distance_m"] <= near["distance_m"].max()]
            result.append(_run(larger, measured, "larger", bound))
    for name in (name for name in CHANNELS if name in available and name not in measured):
        read = _run(near, (*measured, name), "read", name, assumed_noise(name, nominal))
        result.append(replace(read, cost=read.cost + CHANNEL_COST))
    for name, body in {"magnet_temperature_C": "magnet", "coil_temperature_C": "winding"}.items():
        if body != "magnet" or nominal.has_magnet:
            warm = near.assign(**{name: REFERENCE_TEMPERATURE_C + HEATED_K})
            heated = _run(warm, measured, "heated", name, body)
            result.append(replace(heated, cost=heated.cost + HEAT_COST))
    return sorted([*result, *direct], key=attrgetter("cost"))


def _run(rows: pd.DataFrame, channels: tuple[str, ...], macro: str, *facts: Any) -> Experiment:
    """Rows to be measured in the words of a macro of ``experiments.j2``."""
    text = sentence("experiments", macro, rows["distance_m"], *facts)
    return Experiment(text, len(rows), rows.reset_index(drop=True), channels)


def _grid(nominal: Nominal, low: float, high: float) -> pd.DataFrame:
    """Rising currents at every distance of a usual sweep."""
    distances = np.linspace(nominal.distance_min_m, nominal.distance_max_m, DISTANCES)
    points = [(d, i, 1.0) for d in distances for i in np.linspace(low, high, CURRENTS if high > low else 1)]
    rows = pd.DataFrame(points, columns=["distance_m", "current_A", "branch"])
    return rows.assign(**{name: missing for name, missing in SETTINGS.items() if name not in rows})
