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
from itertools import combinations, groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import ROUNDING, FloatArray
from femfit.core.results import Result
from femfit.effects.catalogue import device_effects
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Nominal
from femfit.effects.effect import Calibration, Effect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.bench import bench_observations
from femfit.identify.constants import HEATED_K, NEEDED_DISTANCE, PRIOR_MOUNT_M, PRIOR_RUN
from femfit.identify.decision.campaign import detectable_magnitudes
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Start, fitted_together, refit
from femfit.identify.signatures import testable_columns
from femfit.identify.words import printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.header import parts_of
from femfit.tables.measurement import CHANNELS, SETTINGS, BenchTable
from femfit.tables.measurement_file import read_bench_table

VISIBLE = 4.0
"""Conventional: standard deviations from which a whole signal is seen, where nobody asks for its form."""

GUESSED_NOISE = 2e-3
"""Assumed: noise of a channel that was never measured and has none declared, over its largest reading in the validity
domain."""

LARGEST_BENDING = 0.5
"""Assumed: what first-order columns at the trial values of the nonlinear parameters leave of a signal, a refit of these
parameters may lower from up to this share."""

NEAR_SHARE, DISTANCES, CURRENTS = 0.25, 24, 6
"""Assumed: a usual sweep has so many distances and currents; most effects are largest in its nearest quarter."""

CHANNEL_COST, HEAT_COST = 60.0, 120.0
"""Assumed: readings of a usual sweep that setting up a further sensor, or heating a part, takes the time of."""


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
        return titled(printed("plan", r=self, clauses=lambda pairs: pair_clauses(pairs, {}), read=read), self.titles)


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
    detectable = detectable_magnitudes([start for variants in families.values() for start in variants])
    return PlanReport(
        noise=noise.known,
        detectable=detectable,
        invisible=invisible,
        together=_together(whitening, families),
        direct={effect.name: effect.calibrations[0].instruction for effect in effects if effect.calibrations},
        smallest={e.name: smallest_visible(e, detectable[e.name], nominal) for e in effects if e.name in detectable},
        titles=titles_of(effects),
    )


def _signals(start: Start) -> list[FloatArray]:
    """Change of the readings by each amplitude that can be seen at the further end of its plausible range."""
    ends = [max((end - p.null for end in p.plausible), key=abs) for p in start.columns.amplitudes]
    visible = np.linalg.norm(start.whitened * ends, axis=0) > VISIBLE
    return list((start.columns.columns * ends)[:, visible].T)


def _together(whitening: Whitening, families: Mapping[str, Sequence[Start]]) -> tuple[tuple[str, str], ...]:
    """Pairs of effects of which one can make every visible amplitude of the other: a diagnosis would leave both."""
    base = whitening.observations.base

    def hidden(effect: str, rival: str) -> bool:
        rivals = [[start] for start in families[rival]]
        signals = _signals(families[effect][0])
        return bool(signals) and all(separation(whitening.with_values(base + s), rivals) is None for s in signals)

    return tuple((a, b) for a, b in combinations(families, 2) if hidden(a, b) or hidden(b, a))


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


def pair_clauses(pairs: Iterable[Sequence[str]], brief: Mapping[str, str]) -> list[tuple[str, list[str]]]:
    """Pairs in as few clauses as say them: a name, in brief where there is one, and those that it stands with."""
    remaining, clauses = [[brief.get(name, name) for name in pair[:2]] for pair in pairs], []
    while remaining:
        names = [name for pair in remaining for name in pair]
        name = max(dict.fromkeys(names), key=names.count)
        clauses.append((name, [a if b == name else b for a, b in remaining if name in {a, b}]))
        remaining = [pair for pair in remaining if name not in pair]
    return clauses


def planned_noise(observations: Observations, noise: NoiseModel | None = None) -> NoiseModel:
    """The noise of a plan as declared or estimated, and the priors of mounts and runs that estimates start from.

    What is assumed stands for channels of which neither is known; beside an estimate no declaration counts.
    """
    channels, declared = observations.channels, {} if noise else observations.declared_noise
    sigma = np.array([declared.get(name, assumed_noise(name, observations.nominal)) for name in channels])
    planned = pd.DataFrame({"sigma": sigma, "rho": 0.0, "run": PRIOR_RUN * sigma}, index=channels)
    planned["repeats"] = planned["degrees_of_freedom"] = np.inf
    if noise:
        estimated = pd.DataFrame({name: getattr(noise, str(name)) for name in planned}, index=noise.channels)
        planned.update(estimated.assign(run=estimated["run"].where(noise.run > 0.0, PRIOR_RUN * noise.sigma)))
    columns: dict[str, Any] = {str(name): values.to_numpy() for name, values in planned.items()}
    if noise:
        return replace(noise, channels=channels, mount_m=noise.mount_m or PRIOR_MOUNT_M, **columns)
    source = {name: "declared" if name in declared else "assumed" for name in channels}
    return NoiseModel(channels, mount_m=PRIOR_MOUNT_M, source=source, **columns)


def assumed_noise(channel: str, nominal: Nominal) -> float:
    """The noise of a channel that was never measured, by its largest reading in the validity domain."""
    quantity, _ = parts_of(channel)
    if quantity == "voltage_V":
        return GUESSED_NOISE * nominal.resistance_ohm * nominal.peak_current_A
    return GUESSED_NOISE * float(getattr(nominal, "hall_swing_V" if channel == "hall_V" else quantity))


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
    runs, direct = list[Experiment](), list[Experiment]()
    for effect in effects:
        direct += [Experiment(c.instruction, c.cost, effect=effect.name, calibration=c) for c in effect.calibrations]
    if observations.of_impedances:
        return sorted(direct, key=attrgetter("cost"))

    def add(macro: str, rows: pd.DataFrame, *facts: Any, cost: float = 0.0, channels: Sequence[str] = measured) -> None:
        """Rows to be measured, in the words of a macro of ``experiments.j2``."""
        text = sentence("experiments", macro, rows["distance_m"], *facts)
        runs.append(Experiment(text, len(rows) + cost, rows.reset_index(drop=True), tuple(channels)))

    current, branch = observations.covariates["current_A"], observations.covariates["branch"]
    low, high = np.clip([current.min(), current.max()], nominal.current_min_A, nominal.current_max_A).tolist()
    within_domain = (low, high) if low > current.min() or high < current.max() else None
    usual = _grid(nominal, low, high)
    near = usual[usual["distance_m"] <= nominal.distance_min_m + NEAR_SHARE * nominal.travel_m]
    add("once_more", usual, within_domain)
    add("nearer", near, within_domain)
    if not ((branch > 0).any() and (branch < 0).any()):
        add("falling", usual.assign(branch=-1.0))
    # Currents of the other sign, and larger ones, as far as the validity domain has them
    within = near["current_A"].between(-nominal.current_max_A, -nominal.current_min_A)
    turned = near[within].assign(current_A=-near.loc[within, "current_A"])
    if (low >= 0.0 or high <= 0.0) and (turned["current_A"] != 0.0).any():
        add("reversed", turned)
    for bound, reached in ((nominal.current_max_A, high), (nominal.current_min_A, low)):
        if abs(bound) > max(abs(low), abs(high)) / 0.95 and bound * reached >= 0.0:
            larger = _grid(nominal, *sorted((0.7 * bound, bound)))
            add("larger", larger[larger["distance_m"] <= near["distance_m"].max()], bound)
    for name in (name for name in CHANNELS if name in available and name not in measured):
        add("read", near, name, assumed_noise(name, nominal), cost=CHANNEL_COST, channels=(*measured, name))
    for name, body in {"magnet_temperature_C": "magnet", "coil_temperature_C": "winding"}.items():
        if body != "magnet" or nominal.has_magnet:
            add("heated", near.assign(**{name: REFERENCE_TEMPERATURE_C + HEATED_K}), name, body, cost=HEAT_COST)
    return sorted([*runs, *direct], key=attrgetter("cost"))


def _grid(nominal: Nominal, low: float, high: float) -> pd.DataFrame:
    """Rising currents at every distance of a usual sweep."""
    distances = np.linspace(nominal.distance_min_m, nominal.distance_max_m, DISTANCES)
    points = [(d, i, 1.0) for d in distances for i in np.linspace(low, high, CURRENTS if high > low else 1)]
    rows = pd.DataFrame(points, columns=["distance_m", "current_A", "branch"])
    return rows.assign(**{name: missing for name, missing in SETTINGS.items() if name not in rows})
