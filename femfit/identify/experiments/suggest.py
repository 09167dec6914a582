"""The next measurement that separates what is still confounded, and what a planned campaign could never separate.

Two explanations differ at settings x by what the better fit of the one leaves of the other. Over the old and the new
readings together that distance, in standard deviations, is the T-criterion of a discriminating design.

References
----------
A. C. Atkinson and V. V. Fedorov, Biometrika 62 (1975) 57: T-optimal designs.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Effect
from femfit.identify.experiments.experiments import Experiment, possible_experiments
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.bench import bench_observations
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import Refit
from femfit.identify.refit.start import bounded_amplitudes
from femfit.identify.signatures.columns import EffectColumns, effect_columns
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.tables.measurement import CHANNELS, BenchTable

_SPLIT = 4.0
"""Standard deviations between two explanations from which they count as separated."""

_GUESSED_NOISE = 2e-3
"""Of a channel that was never measured, over its largest reading."""


@dataclass(frozen=True)
class Suggestion:
    """A measurement and what it would separate.

    Parameters
    ----------
    cost : float
        In readings of the usual sweep.
    separates : tuple of (str, str, float)
        Pairs of explanations and their distance in standard deviations with it.
    """

    text: str
    cost: float
    separates: tuple[tuple[str, str, float], ...]
    remains: tuple[tuple[str, str], ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return asdict(self)


def suggest_measurements(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, explanations: Sequence[Refit], effects: Sequence[Effect]
) -> list[Suggestion]:
    """Rank measurements by how cheaply they separate explanations that the data leave together.

    Parameters
    ----------
    effects : sequence of Effect
        Whose direct readings may be suggested.

    Returns
    -------
    list of Suggestion
        Those that separate at least one pair, the cheapest for each pair first: taken in turn until nothing remains
        open, they are the greedy cover of all pairs at the least cost.
    """
    observations = bench_observations(model, table)
    d, i = (observations.covariates[name].to_numpy()[:1] for name in ("distance_m", "current_A"))
    available = tuple(predict_readings(model, d, i, Conditions(observations.nominal)))
    named = {name for fit in explanations for name in fit.names}
    direct = [effect for effect in effects if effect.name in named]
    result = []
    for experiment in possible_experiments(observations, available, direct):
        distances = _distances(model, table, noise, explanations, experiment)
        apart = tuple((a, b, round(s, 1)) for (a, b), s in distances.items() if s >= _SPLIT)
        if apart:
            together = tuple(pair for pair, s in distances.items() if s < _SPLIT)
            result.append(Suggestion(experiment.text, experiment.cost, apart, together))
    return sorted(result, key=lambda one: (one.cost / len(one.separates), one.cost))


def _distances(
    model: ActuatorModel, table: BenchTable, noise: NoiseModel, explanations: Sequence[Refit], experiment: Experiment
) -> dict[tuple[str, str], float]:
    """Standard deviations between each two explanations once an experiment is added."""
    joined = table if experiment.rows is None else _joined(table, experiment)
    observations = bench_observations(model, joined)
    whitening = Whitening(observations, noise_for(noise, observations), chains_of(observations))
    signals, columns = [], []
    for fit in explanations:
        change = observations.predict(fit.effects) - observations.base
        signals.append(whitening.full(change))
        columns.append([_columns_at(observations, whitening, fit, k) for k in range(len(fit.effects))])
    result = {}
    for a, b in combinations(range(len(explanations)), 2):
        direct = _direct(experiment, explanations[a], explanations[b])
        apart = min(unlike(signals[a], columns[b]), unlike(signals[b], columns[a]))
        key = (" + ".join(explanations[a].names), " + ".join(explanations[b].names))
        result[key] = float(np.sqrt(apart**2 + direct**2))
    return result


def _columns_at(
    observations: Observations, whitening: Whitening, fit: Refit, k: int
) -> tuple[EffectColumns, FloatArray]:
    """The columns of one effect of an explanation at its fitted shape constants."""
    added = fit.effects[k]
    shape = {p.name: added.parameters[p.name] for p in added.effect.parameters if p.nonlinear}
    variants = effect_columns(added.effect, observations)
    nearest = min(variants, key=lambda one: sum(abs(one.shape[n] - shape[n]) for n in shape)) if variants else None
    if nearest is None:
        empty = EffectColumns(added.effect, (), shape, np.zeros((len(observations.value), 0)))
        return empty, empty.columns
    return nearest, whitening.full(nearest.columns)


def unlike(signal: FloatArray, rival: Sequence[tuple[EffectColumns, FloatArray]]) -> float:
    """Length of a whitened signal that other effects cannot make.

    Parameters
    ----------
    signal : array, shape (M,)
        Whitened.
    rival : sequence of (EffectColumns, array)
        The other effects with their whitened columns.
    """
    columns = np.concatenate([white for _, white in rival], axis=1)
    if not columns.shape[1]:
        return float(np.linalg.norm(signal))
    bounds = np.concatenate([one.bounds for one, _ in rival if one.amplitudes], axis=1)
    _, fall = bounded_amplitudes(signal, columns, bounds)
    return float(np.sqrt(max(float(signal @ signal) - fall, 0.0)))


def _direct(experiment: Experiment, a: Refit, b: Refit) -> float:
    """Standard deviations by which a direct reading of an effect's parameters tells two explanations apart."""
    if experiment.calibration is None:
        return 0.0
    apart = [
        (_parameter(a, experiment.effect, name) - _parameter(b, experiment.effect, name)) / u
        for name, u in experiment.calibration.reads.items()
    ]
    return float(np.linalg.norm(apart))


def _parameter(fit: Refit, effect: str, name: str) -> float:
    """An amplitude of an effect in an explanation; zero, its null, where the explanation lacks the effect."""
    return next((float(e.parameters[name]) for e in fit.effects if e.effect.name == effect), 0.0)


def _joined(table: BenchTable, experiment: Experiment) -> BenchTable:
    """A table with an experiment as its last run; readings do not matter and are zero."""
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


def noise_for(noise: NoiseModel, observations: Observations) -> NoiseModel:
    """A noise model for the channels of other observations.

    Returns
    -------
    NoiseModel
        A channel that was never measured gets 0.2 % of its largest reading.
    """
    known = {name: k for k, name in enumerate(noise.channels)}
    picked = [known.get(name) for name in observations.channels]
    largest = [float(np.abs(observations.base[observations.of(name)]).max()) for name in observations.channels]

    def pick(values: FloatArray, missing: Sequence[float]) -> FloatArray:
        return np.array([m if k is None else values[k] for k, m in zip(picked, missing, strict=True)])

    zeros = [0.0] * len(picked)
    return replace(
        noise,
        channels=observations.channels,
        sigma=pick(noise.sigma, [_GUESSED_NOISE * x for x in largest]),
        rho=pick(noise.rho, zeros),
        run=pick(noise.run, zeros),
        repeats=pick(noise.repeats, zeros),
        degrees_of_freedom=pick(noise.degrees_of_freedom, zeros),
        test_run=pick(noise.test_run, zeros),
    )
