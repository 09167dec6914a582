"""The next measurement that separates what the data leave together.

A measurement is tried as a further run beside the readings that are there: the readings that each explanation predicts
at the old and the new settings are explained by each other one (:mod:`femfit.identify.experiments.separation`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration
from femfit.identify.decision.diagnose import diagnose as diagnosed
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.experiments.constants import COMPARED, SHOWN
from femfit.identify.experiments.noise import noise_for
from femfit.identify.experiments.possible import Experiment, possible_experiments
from femfit.identify.experiments.separation import (
    change_of,
    needed_distance,
    parameters_of,
    starting_points,
    unexplained,
)
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.bench import bench_observations
from femfit.identify.readings.plausible import plausible_table
from femfit.identify.refit.refit import Refit
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.tables.measurement import CHANNELS, BenchTable, Measurement
from femfit.tables.measurement_file import read_measurement


@dataclass(frozen=True)
class Suggestion:
    """A measurement and what it would separate.

    Parameters
    ----------
    separates : tuple of (str, str, float)
        Pairs of explanations and their distance in standard deviations with it.
    remains : tuple of (str, str)
        Pairs that it leaves together.
    experiment : Experiment or None
        The settings to be measured, or the direct reading.
    """

    text: str
    cost: float
    separates: tuple[tuple[str, str, float], ...]
    remains: tuple[tuple[str, str], ...]
    experiment: Experiment | None = field(default=None, repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return {name: getattr(self, name) for name in ("text", "cost", "separates", "remains")}


@dataclass(frozen=True)
class Advice:
    """What to measure next; printed, it is what ``femfit suggest`` prints.

    Parameters
    ----------
    suggestions : tuple of Suggestion
        The cheapest for each pair first: taken in turn until nothing remains open, they separate all that can be.
    never : tuple of (str, str)
        Pairs that no measurement that femfit knows would separate.
    isolating : tuple of (str, str)
        Per effect the measurement that isolates it, for records, to which no readings can be added on trial.
    note : str
        Why nothing is advised; empty where there is nothing to say.
    """

    explanations: tuple[str, ...]
    suggestions: tuple[Suggestion, ...] = ()
    never: tuple[tuple[str, str], ...] = ()
    isolating: tuple[tuple[str, str], ...] = ()
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return vars(self) | {"suggestions": [one.to_dict() for one in self.suggestions]}

    def __str__(self) -> str:
        if self.note:
            return self.note
        lines = []
        for k, one in enumerate(self.suggestions[:SHOWN]):
            lines.append(f"{'Next' if k == 0 else 'Or'}: {one.text}")
            lines.append(f"  This separates {_pairs([pair[:2] for pair in one.separates])}, and takes as long as about "
                         f"{one.cost:.0f} readings.")  # fmt: skip
            if one.remains:
                lines.append(f"  It leaves open: {'; '.join(_listed(group, 'or') for group in _chained(one.remains))}.")
        if self.never:
            lines.append(f"No measurement that femfit knows separates {_pairs(self.never)}.")
        lines += [f"{name}: {experiment}" for name, experiment in self.isolating]
        return "\n".join([*lines, f"The data leave {_listed(self.explanations, 'or')}."])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


def suggest(
    model: ActuatorModel,
    data: Measurement | str | Path,
    diagnosis: Diagnosis | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Advice:
    """Advise the cheapest measurements that separate what the data leave together.

    Parameters
    ----------
    model : ActuatorModel
        With which the data were diagnosed.
    data : BenchTable or TimeSeries, or a path
        What was measured.
    diagnosis : Diagnosis, optional
        Of these data, where it was made already.

    Raises
    ------
    TableError
        If no reading can be compared.

    Examples
    --------
    >>> import femfit as ff
    >>> advice = ff.suggest(ff.read_model("model.json"), "bench.csv")
    >>> len(advice.explanations) > 0
    True
    """
    say = progress or (lambda _: None)
    measured = read_measurement(data) if isinstance(data, str | Path) else data
    found = diagnosed(model, measured, bootstrap=0, progress=say) if diagnosis is None else diagnosis
    explanations = found.explanations[:COMPARED]
    names = tuple(" + ".join(fit.names) for fit in explanations)
    if found.campaign is None:
        return Advice(names, note=str(found.findings[-1]))
    if not explanations:
        return Advice(names, note="There is nothing to separate: no effect is named, see femfit diagnose.")
    if len(explanations) == 1:
        return Advice(names, note=f"There is nothing to separate: the data leave {names[0]} alone.")
    if not isinstance(measured, BenchTable):
        effects = all_effects()
        used = dict.fromkeys(name for fit in explanations for name in fit.names)
        return Advice(names, isolating=tuple((name, effects[name].experiment) for name in used))
    say("Trying measurements")
    suggestions = suggest_measurements(model, plausible_table(model, measured), found.campaign.noise, explanations)
    apart = {pair[:2] for one in suggestions for pair in one.separates}
    return Advice(names, tuple(suggestions), tuple(p for p in combinations(names, 2) if p not in apart))


def suggest_measurements(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, explanations: Sequence[Refit]
) -> list[Suggestion]:
    """Rank measurements by how cheaply they separate explanations that the data leave together."""
    observations = bench_observations(model, table)
    d, i = (observations.covariates[name].to_numpy()[:1] for name in ("distance_m", "current_A"))
    available = tuple(predict_readings(model, d, i, Conditions(observations.nominal)))
    named = {added.effect.name: added.effect for fit in explanations for added in fit.effects}
    direct = [named[name] for name in dict.fromkeys((*all_effects(), *named)) if name in named]
    result = []
    for experiment in possible_experiments(observations, available, direct):
        separates, remains = _tried(model, table, noise, explanations, experiment)
        if separates:
            result.append(Suggestion(experiment.text, experiment.cost, separates, remains, experiment))
    return sorted(result, key=lambda one: (one.cost / len(one.separates), one.cost))


def _tried(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, explanations: Sequence[Refit], experiment: Experiment
) -> tuple[tuple[tuple[str, str, float], ...], tuple[tuple[str, str], ...]]:
    """Pairs that an experiment separates, with their distance, and pairs that it leaves together."""
    separates, remains = [], []
    distance = _direct if experiment.rows is None else _joint(model, table, noise, experiment)
    for a, b in combinations(explanations, 2):
        pair = (" + ".join(a.names), " + ".join(b.names))
        apart = distance(experiment, a, b)
        if apart is None:
            remains.append(pair)
        else:
            separates.append((*pair, round(apart, 1)))
    return tuple(separates), tuple(remains)


def _direct(experiment: Experiment, a: Refit, b: Refit) -> float | None:
    """Distance by a direct reading of an effect's parameters; None where it is less than needed."""
    if experiment.calibration is None:
        return None
    first, second = (_read(experiment.effect, experiment.calibration, fit) for fit in (a, b))
    apart = float(np.linalg.norm((first - second) / np.array(list(experiment.calibration.reads.values()))))
    return apart if apart >= needed_distance(1) else None


def _read(effect: str, calibration: Calibration, fit: Refit) -> FloatArray:
    """What a direct reading gives where an explanation is true."""
    values = np.zeros(len(calibration.reads))
    for added in fit.effects:
        if added.effect.name == effect:
            values += [added.parameters[name] for name in calibration.reads]
        for name, change in calibration.also.get(added.effect.name, {}).items():
            values[0] += change * added.parameters[name]
    return values


def _joint(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, experiment: Experiment
) -> Callable[[Experiment, Refit, Refit], float | None]:
    """The judge of a further run: the smaller of two distances, None where one of them is less than needed."""
    observations = bench_observations(model, joined(table, experiment))
    whitening = Whitening(observations, noise_for(noise, observations), chains_of(observations))

    def distance(_: Experiment, a: Refit, b: Refit) -> float | None:
        smallest = np.inf
        for truth, rival in ((a, b), (b, a)):
            change = change_of(observations, truth.effects)
            more = parameters_of(truth.effects) - parameters_of(rival.effects)
            needed = needed_distance(len(change), more)
            starts = starting_points([added.effect for added in rival.effects], observations, whitening, rival.effects)
            seen = observations.with_values(observations.base + change)
            apart = unexplained(seen, whitening, starts, needed)
            if apart < needed:
                return None
            smallest = min(smallest, apart)
        return smallest

    return distance


def joined(table: BenchTable, experiment: Experiment) -> BenchTable:
    """A table with an experiment as its last run, on a new mount; its readings do not matter and are zero."""
    more = experiment.rows if experiment.rows is not None else table.rows.iloc[:0]
    more = more.assign(run=float(table.rows["run"].max()) + 1.0, order=np.arange(len(more), dtype=float))
    more = more.assign(**{name: 0.0 if name in experiment.channels else np.nan for name in CHANNELS})
    given = (*table.given, *(n for n in experiment.channels if n not in table.given))
    mount = table.rows["mount"].where(table.rows["mount"].notna(), table.rows["run"])
    rows = pd.concat([table.rows.assign(mount=mount), more.assign(mount=float(mount.max()) + 1.0)], ignore_index=True)
    varied = tuple(
        n for n in ("coil_temperature_C", "magnet_temperature_C") if more[n].notna().any() and n not in given
    )
    return replace(table, rows=rows[table.rows.columns], given=(*given, *varied))


def _pairs(pairs: Sequence[tuple[str, ...]]) -> str:
    """Pairs in as few words as say them: ``a from b and c; d from e``."""
    left, parts = list(pairs), []
    while left:
        names = [name for pair in left for name in pair]
        name = max(dict.fromkeys(names), key=names.count)
        partners = [a if b == name else b for a, b in left if name in {a, b}]
        parts.append(f"{name} from {_listed(partners, 'and')}")
        left = [pair for pair in left if name not in pair]
    return "; ".join(parts)


def _chained(pairs: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Names that pairs connect, group by group."""
    groups: list[list[str]] = []
    for pair in pairs:
        met = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in met]
        groups.append(list(dict.fromkeys([name for group in (*met, pair) for name in group])))
    return groups


def _listed(names: Sequence[str], word: str) -> str:
    return f" {word} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
