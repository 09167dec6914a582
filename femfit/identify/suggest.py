"""The next measurement that separates what the data leave together.

A measurement is tried as a further run beside the readings that are there: the readings that each explanation predicts
at the old and the new settings are explained by each other one (:func:`femfit.identify.plan.separation`). By a direct
reading of an effect's parameters (a shunt, a weight, a micrometer) two explanations are as far apart as what they say
of it, over its uncertainty and theirs.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import NORMAL_95, FloatArray
from femfit.core.results import Result
from femfit.effects.catalogue import device_effects
from femfit.effects.conditions import TEMPERATURES, Conditions, Nominal
from femfit.effects.effect import AddedEffect, Calibration
from femfit.effects.words import titled, titles_of
from femfit.identify.bench import bench_observations, measurement_of
from femfit.identify.constants import COMPARED, NEEDED_DISTANCE
from femfit.identify.decision.diagnose import Diagnosis
from femfit.identify.decision.diagnose import diagnose as diagnosed
from femfit.identify.misfit import sweep_words
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.plan import Experiment, pair_clauses, planned_noise, possible_experiments, separation
from femfit.identify.plausible import plausible_table
from femfit.identify.refit import Refit, Start, starting_point
from femfit.identify.settings import currents_in, with_currents
from femfit.identify.signatures import columns_at
from femfit.identify.words import printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.readings import predict_readings
from femfit.tables.measurement import CHANNELS, BenchTable, Measurement


@dataclass(frozen=True)
class Suggestion(Result):
    """A measurement and what it would separate."""

    data = ("text", "cost", "separates", "remains")

    text: str
    cost: float
    # Pairs of explanations and their distance in standard deviations with it
    separates: tuple[tuple[str, str, float], ...]
    remains: tuple[tuple[str, str], ...]  # Pairs that it leaves together
    # The settings to be measured, or the direct reading
    experiment: Experiment | None = field(default=None, repr=False, compare=False)


@dataclass(frozen=True, eq=False, repr=False)
class Advice(Result):
    """What to measure next; printed, it is what ``femfit suggest`` prints."""

    explanations: tuple[str, ...]
    # The cheapest for each pair first: taken in turn until nothing remains open, they separate all that can be
    suggestions: tuple[Suggestion, ...] = ()
    never: tuple[tuple[str, str], ...] = ()  # Pairs that no measurement that femfit knows is sure to separate
    # Per effect the measurement that isolates it, the most separating first: for records, to which no readings can be
    # added on trial, where one name alone is left and is not certain, and of what nothing is sure to separate
    isolating: tuple[tuple[str, str], ...] = ()
    note: str = ""  # Why no measurements are compared; empty where there is nothing to say
    further: int = 0  # Explanations beyond the first :data:`COMPARED`, which are not compared
    remarks: tuple[str, ...] = ()  # On what the advice rests, where that is a guess
    titles: Mapping[str, str] = field(default_factory=dict)  # What texts call the numbers of the drawing

    def __str__(self) -> str:
        sets = [name.split(" + ") for name in self.explanations]
        shared = [name for name in sets[0] if all(name in names for names in sets)] if len(sets) > 1 else []
        brief = {" + ".join(names): " + ".join(name for name in names if name not in shared) for names in sets}
        facts = {"clauses": partial(pair_clauses, brief=brief), "alone": list(brief.values()), "shared": shared}
        return titled(printed("advice", r=self, **facts), self.titles)


def suggest(
    model: ActuatorModel | str | Path,
    data: Measurement | str | Path,
    diagnosis: Diagnosis | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Advice:
    """Advise the cheapest measurements that separate what the data leave together.

    Parameters
    ----------
    model : ActuatorModel or path
        With which the data were diagnosed.
    data : BenchTable or TimeSeries, or a path
        What was measured.
    diagnosis : Diagnosis, optional
        The diagnosis of these data, where it was made already.

    Raises
    ------
    TableError
        If no reading can be compared, or ``diagnosis`` is none.

    Examples
    --------
    >>> import femfit as ff
    >>> advice = ff.suggest(ff.read_model("model.json"), "bench.csv")
    >>> len(advice.explanations) > 0
    True
    """
    if not isinstance(diagnosis, Diagnosis | None):
        raise TableError(sentence("refusals", "no_diagnosis", type(diagnosis).__name__))
    say, model, measured = progress or (lambda _: None), model_of(model), measurement_of(data)
    diagnosis = diagnosed(model, measured, progress=say) if diagnosis is None else diagnosis
    nominal, sets = diagnosis.observations.nominal, [set(fit.names) for fit in diagnosis.explanations]
    # What only adds to an explanation would take the place of another one
    every = tuple(fit for fit in diagnosis.explanations if not any(names < set(fit.names) for names in sets))
    names = tuple(" + ".join(fit.names) for fit in every)
    guesses = tuple(str(finding) for finding in diagnosis.findings if finding.code == "guessed-noise")
    advice = Advice(names, remarks=guesses, titles=titles_of(nominal.drawn))
    if diagnosis.campaign is None or len(every) < 2:
        unsure = [] if diagnosis.confident and not diagnosis.excluded else [[each.name for each in diagnosis.missing]]
        note = sentence("advice", "nothing", diagnosis, diagnosis.allowed, sweep_words(diagnosis.model)["finer"])
        return replace(advice, isolating=_isolating(unsure, nominal), note=note)
    if not isinstance(measured, BenchTable) or nominal.circuits:
        return replace(advice, isolating=_isolating([fit.names for fit in every], nominal))
    say("Trying measurements")
    compared = suggest_measurements(model, plausible_table(model, measured), diagnosis.campaign.noise, every[:COMPARED])
    apart = {pair[:2] for suggestion in compared for pair in suggestion.separates}
    never = tuple(pair for pair in combinations(names[:COMPARED], 2) if pair not in apart)
    together = [fit.names for fit, name in zip(every, names, strict=True) if any(name in pair for pair in never)]
    advice = replace(advice, explanations=names[:COMPARED], further=max(0, len(every) - COMPARED))
    return replace(advice, suggestions=tuple(compared), never=never, isolating=_isolating(together, nominal))


def _isolating(explanations: Sequence[Sequence[str]], nominal: Nominal) -> tuple[tuple[str, str], ...]:
    """Experiments on effects of explanations, first on that which most pairs of these disagree about."""
    effects = device_effects(nominal.circuits, nominal.drawn)
    every = [name for names in explanations for name in names if name in effects]
    order = sorted(dict.fromkeys(every), key=lambda name: every.count(name) * (every.count(name) - len(explanations)))
    return tuple((name, effects[name].experiment) for name in order)


def suggest_measurements(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, explanations: Sequence[Refit]
) -> list[Suggestion]:
    """Rank measurements by how cheaply they separate explanations."""
    table = with_currents(model, table)
    observations = bench_observations(model, table)
    d, i = observations.covariates["distance_m"].to_numpy()[:1], currents_in(model, observations.covariates)[:1]
    available = tuple(predict_readings(model, d, i, Conditions(observations.nominal), channels=CHANNELS))
    named = {added.effect.name: added.effect for fit in explanations for added in fit.effects}
    names, result = combinations([" + ".join(fit.names) for fit in explanations], 2), []
    pairs = dict(zip(names, combinations(explanations, 2), strict=True))
    for experiment in possible_experiments(observations, available, list(named.values())):
        apart = _apart_by(model, table, noise, experiment)
        distances = {both: apart(*fits) for both, fits in pairs.items()}
        separates = tuple((*both, round(distance, 1)) for both, distance in distances.items() if distance is not None)
        remains = tuple(both for both, distance in distances.items() if distance is None)
        if separates:
            result.append(Suggestion(experiment.text, experiment.cost, separates, remains, experiment))
    return sorted(result, key=lambda suggestion: (suggestion.cost / len(suggestion.separates), suggestion.cost))


def _apart_by(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, experiment: Experiment
) -> Callable[[Refit, Refit], float | None]:
    """How far apart an experiment brings two explanations, in standard deviations; None where that is too little."""
    if experiment.calibration:
        return partial(_apart_by_direct_reading, experiment.effect, experiment.calibration)
    observations = bench_observations(model, joined(table, experiment))
    whitening = Whitening.granting(observations, planned_noise(observations, noise))

    def one_way(truth: Refit, rival: Refit) -> float | None:
        predicted = whitening.with_values(observations.predict(truth.effects))
        fitted = [variant for added in rival.effects for variant in columns_at(added, observations)]
        starts = [starting_point(predicted, [added.effect for added in rival.effects])]
        return separation(predicted, [*starts, Start.at_null(fitted, predicted)])

    def nearer(a: Refit, b: Refit) -> float | None:
        """By a further run: the smaller of the distances from the other's best refit."""
        there = one_way(a, b)
        back = None if there is None else one_way(b, a)
        return None if there is None or back is None else min(there, back)

    return nearer


def joined(table: BenchTable, experiment: Experiment) -> BenchTable:
    """A table with an experiment as its last run, on a new mount; its readings do not matter and are zero."""
    more = experiment.rows if experiment.rows is not None else table.rows.iloc[:0]
    more = more.assign(run=float(table.rows["run"].max()) + 1.0, order=np.arange(len(more), dtype=float))
    more = more.assign(**dict.fromkeys(CHANNELS, np.nan) | dict.fromkeys(experiment.channels, 0.0))
    columns_given = (*table.given, *(n for n in experiment.channels if n not in table.given))
    mount = table.rows["mount"].where(table.rows["mount"].notna(), table.rows["run"])
    rows = pd.concat([table.rows.assign(mount=mount), more.assign(mount=float(mount.max()) + 1.0)], ignore_index=True)
    varied = tuple(n for n in TEMPERATURES if more[n].notna().any() and n not in columns_given)
    columns = list(dict.fromkeys((*table.rows.columns, *experiment.channels)))
    return replace(table, rows=rows[columns], given=(*columns_given, *varied))


def _apart_by_direct_reading(effect: str, calibration: Calibration, a: Refit, b: Refit) -> float | None:
    """What two explanations say of a direct reading, over its uncertainty and theirs."""
    values, errors = zip(*(_direct_reading(effect, calibration, fit.effects) for fit in (a, b)), strict=True)
    uncertainty = np.sqrt(np.square(list(calibration.reads.values())) + np.sum(np.square(errors), axis=0))
    distance = float(np.linalg.norm((values[0] - values[1]) / uncertainty))
    return distance if distance >= NEEDED_DISTANCE else None


def _direct_reading(
    effect: str, calibration: Calibration, effects: Iterable[AddedEffect]
) -> tuple[FloatArray, FloatArray]:
    """What a direct reading of an effect's parameters shows where some effects act, and how well their fit knows it.

    Both in the parameters' units; the error is 0 where no effect has the parameters.
    """
    values, errors = np.zeros((2, len(calibration.reads)))
    for added in effects:
        if added.effect.name == effect:
            values += [added.parameters[name] for name in calibration.reads]
            limits = [added.ci95.get(name, (0.0, 0.0)) for name in calibration.reads]
            errors = np.asarray(np.ptp(limits, axis=1) / (2.0 * NORMAL_95))
        for name, change in calibration.also.get(added.effect.name, {}).items():
            values[0] += change * added.parameters[name]
    return values, errors
