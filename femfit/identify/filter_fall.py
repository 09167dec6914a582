"""What added effects do to the filter on runs that they were not fitted to.

The filter of the model as it was and that of the model with the effects run over each run left out, with the same
noises: once with all sensors, which gives the innovations and their likelihood, and once without the distance, which
then checks the estimate.

How likely the innovations are decides, block by block; their mean square does not, since noises that are guessed too
large make it small whatever the model. An estimate that is off by as much as one that knows nothing but the travel
checks nothing: both filters are lost there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import binomtest

from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.effect import AddedEffect
from femfit.estimate.follow import OneFilter, can_be_filtered, followed
from femfit.estimate.noise import default_noise
from femfit.identify.checked_refit import left_out_groups
from femfit.identify.constants import (
    FILTER_BLOCK,
    FILTER_CHANCE,
    FILTER_GREW,
    FILTER_RUNS,
    FILTER_SAMPLES,
    FILTER_WORSE,
)
from femfit.identify.observations import Observations
from femfit.identify.words import Result, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import TimeSeries

_Pair = tuple[OneFilter, OneFilter]


@dataclass(frozen=True)
class Change:
    """A number before and after, and whether it grew by more than its scatter."""

    before: float
    after: float
    worse: bool


@dataclass(frozen=True, eq=False, repr=False)
class FilterFall(Result):
    """The filter before and after, on runs left out."""

    data = ("runs", "samples", "accepted", "less_likely", "unread")

    runs: int
    samples: int  # Of all these runs that the filter went through
    single: bool  # Whether quarters of a single run were left out
    mean_square: tuple[float, float]  # Of the normalised innovations, which should be 1, before and after
    less_likely: bool  # Whether the innovations are, in the mean and in more blocks than chance gives
    gain: float  # Logarithm of the likelihood of a sample, after less before
    gain_error: float  # Its standard error
    unread: Mapping[str, Change]  # Rms of recorded less estimated, of channels that the filter does not read
    lost: Mapping[str, Change]  # Runs in which the filter was lost, by the column that it did not read; "" for none

    @property
    def accepted(self) -> bool:
        """Whether nothing of it is worse with the effects than without."""
        return not (self.less_likely or any(change.worse for change in (*self.lost.values(), *self.unread.values())))

    @property
    def better(self) -> bool:
        """Whether the innovations are more likely beyond their scatter, and their mean square no farther from 1."""
        before, after = np.abs(np.log(self.mean_square))
        return self.accepted and self.gain > FILTER_WORSE * self.gain_error and bool(after <= before)

    def __str__(self) -> str:
        return sentence("add", "filtered", self)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return super().to_dict() | {
            "mean_square": dict(zip(("before", "after"), self.mean_square, strict=True)),
            "log_likelihood_gain": self.gain,
            "log_likelihood_gain_error": self.gain_error,
            "lost": {f"without_{name}" if name else "every_sensor": vars(change) for name, change in self.lost.items()},
        }


def filter_fall(
    before: ActuatorModel,
    after: ActuatorModel,
    staying: Sequence[AddedEffect],
    series: TimeSeries,
    observations: Observations,
    left_out: Mapping[int, tuple[AddedEffect, ...]],
) -> FilterFall | None:
    """Run both filters over the last runs left out; None where the record or the model allows none.

    Parameters
    ----------
    before, after : ActuatorModel
        As it was, and with all effects; of the latter its temperatures and the effects in ``kept`` count.
    left_out : mapping of int to tuple of AddedEffect
        What was fitted without each run.
    """
    if not can_be_filtered(before, series):
        return None
    noise, all_sensors, checked = default_noise(before), [], []
    groups = sorted(left_out)[-FILTER_RUNS:]
    for group in groups:
        run = _liveliest(_left_out(series, observations, group), FILTER_SAMPLES // len(groups))
        models = before, with_effects(after, (*staying, *left_out[group]))
        all_sensors.append([followed(model, run, (), noise) for model in models])
        if {"current_A", "hall_V"} & set(series.given):
            checked.append([followed(model, run, ("distance_m",), noise) for model in models])
    pairs, beside = (
        [(first, second) for first, second in scores if first is not None and second is not None]
        for scores in (all_sensors, checked)
    )
    if not pairs:
        return None
    gain = np.concatenate([after.likelihood - before.likelihood for before, after in pairs])
    mean, error = _mean(gain)
    squares = [float(np.mean([pair[k].mean_square for pair in pairs])) for k in (0, 1)]
    domain = before.validity
    unknowing = (domain.distance_max_m - domain.distance_min_m) / np.sqrt(12.0)  # deviation of an even spread

    return FilterFall(
        runs=len(pairs),
        samples=sum(len(pair[0].likelihood) for pair in pairs),
        single=observations.column("run").max() == observations.column("run").min(),
        mean_square=(squares[0], squares[1]),
        less_likely=less_likely(gain),
        gain=mean,
        gain_error=error,
        unread=_unread(beside, unknowing),
        lost={"": lost_runs(pairs)} | ({"distance_m": lost_runs(beside)} if beside else {}),
    )


def less_likely(gain: FloatArray) -> bool:
    """Whether the innovations of the second filter are less likely: in the mean, and in more blocks than chance gives.

    The mean alone is that of the few blocks in which a filter is lost for a moment, whatever the model.
    """
    means = _block_means(gain)
    return bool(means.mean() < 0.0) and _outnumber(int(np.sum(means < 0.0)), int(np.sum(means > 0.0)))


def lost_runs(pairs: Sequence[_Pair]) -> Change:
    """In how many runs each filter is lost, and whether the second loses more than chance gives.

    A filter is lost for a moment in one run or another of a body that bounces, whatever the model; how likely the
    innovations are counts beside this.
    """
    lost = [[score.broke_down for score in pair] for pair in pairs]
    newly, regained = (sum(after is new and before is not new for before, after in lost) for new in (True, False))
    before, after = (float(sum(pair[k] for pair in lost)) for k in (0, 1))
    return Change(before, after, worse=_outnumber(newly, regained))


def _outnumber(worse: int, better: int) -> bool:
    """Whether the worse ones outnumber the better ones beyond chance: a sign test at 5 %."""
    return worse > better and bool(binomtest(worse, worse + better, alternative="greater").pvalue < FILTER_CHANCE)


def _unread(pairs: Sequence[_Pair], unknowing_m: float) -> dict[str, Change]:
    """Of channels that no filter read, where both filters ran through and one at least knew the distance.

    Parameters
    ----------
    unknowing_m : float
        Error of a distance of which only the travel is known, in m.
    """
    ran = [pair for pair in pairs if all(not score.broke_down for score in pair)]
    ran = [pair for pair in ran if not all(_error(score, "distance_m") > unknowing_m for score in pair)]
    result = {}
    for name in sorted({name for pair in ran for name in pair[0].unread}):
        squares = [np.concatenate([pair[k].unread[name] for pair in ran]) ** 2 for k in (0, 1)]
        if not np.isfinite(squares[0] + squares[1]).any():  # both claim to be blind throughout
            continue
        mean, error = _mean(squares[1] - squares[0])
        sizes = [float(np.sqrt(np.nanmean(square))) for square in squares]
        result[name] = Change(
            sizes[0], sizes[1], worse=mean > FILTER_WORSE * error and sizes[1] > FILTER_GREW * sizes[0]
        )
    return result


def _error(score: OneFilter, name: str) -> float:
    """Rms of recorded less estimated; zero where it was read, or where the filter claims to be blind throughout."""
    error = score.unread.get(name, np.zeros(1))
    return float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else 0.0


def _mean(values: FloatArray) -> tuple[float, float]:
    """Mean of a series and its standard error, by means of blocks, since neighbours depend on each other."""
    means = _block_means(values)
    if len(means) < 2:
        return float(np.nanmean(values)), float("inf")
    return float(means.mean()), float(means.std(ddof=1) / np.sqrt(len(means)))


def _block_means(values: FloatArray) -> FloatArray:
    """Means of blocks of a series that have a value."""
    count = max(2, len(values) // FILTER_BLOCK)
    return np.array([float(np.nanmean(block)) for block in np.array_split(values, count) if np.isfinite(block).any()])


def _left_out(series: TimeSeries, observations: Observations, group: int) -> TimeSeries:
    """The samples of a run, or of a quarter of the only run, with their clipped ones."""
    rows, run = series.rows, observations.column("run")
    if run.max() > run.min():
        label = observations.column("run_label")[run.astype(int) == group][0]
        here = (rows["run"] == label).to_numpy()
    else:
        order = observations.column("order")[left_out_groups(observations) == group]
        span, last = (order.min(), order.max()), observations.column("order").max()
        place = np.arange(len(rows)) / len(rows) * (last + 1.0)
        here = (place >= span[0]) & (place < span[1] + 1.0)
    return _rows(series, here)


def _liveliest(run: TimeSeries, samples: int) -> TimeSeries:
    """The stretch of a run with so many samples, all of it where it has no more, in which most moves."""
    if len(run.rows) <= samples:
        return run
    name = "distance_m" if "distance_m" in run.given else next(n for n in run.given if n not in {"run", "time_s"})
    values = run.rows[name].to_numpy()
    starts = range(0, len(values) - samples + 1, max(samples // 2, 1))
    spread = [np.nan_to_num(np.nanstd(values[k : k + samples])) for k in starts]
    first = starts[int(np.argmax(spread))]
    place = np.arange(len(values))
    return _rows(run, (place >= first) & (place < first + samples))


def _rows(series: TimeSeries, here: BoolArray) -> TimeSeries:
    clipped = {name: values[here] for name, values in series.clipped.items()}
    return replace(series, rows=series.rows[here].reset_index(drop=True), clipped=clipped, findings=())
