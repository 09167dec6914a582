"""What effects do on runs that they were not fitted to: to the error of the readings, and to the filter.

Each run is left out in turn and the effects are fitted to the others, without any linearisation.

The filter of the model as it was and that of the model with the effects run over each run left out of a record, with
the same noises: once with all sensors, which gives the innovations and their likelihood, and once without the distance,
which then checks the estimate. How likely the innovations are decides, block by block; their mean square does not,
since noises that are guessed too large make it small whatever the model. An estimate that is off by as much as one that
knows nothing but the travel checks nothing: both filters are lost there.

References
----------
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.effects.effect import AddedEffect
from femfit.estimate.follow import OneFilter, can_be_filtered, followed
from femfit.estimate.noise import default_noise
from femfit.identify.constants import (
    FILTER_BLOCK,
    FILTER_CHANCE,
    FILTER_GREW,
    FILTER_RUNS,
    FILTER_SAMPLES,
    FILTER_WORSE,
    SETTLED,
)
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, Start, refit
from femfit.identify.words import Result, finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import TimeSeries


@dataclass(frozen=True, eq=False)
class UnseenError:
    """Error on runs left out, all of them in turn; on quarters of a single run."""

    rms: Mapping[str, float]  # Root mean square of recorded minus predicted per channel
    chi2: float  # Weighted sum of squares over all noise, re-mounts and offsets
    # What was fitted without each group, by its number, as the rows are grouped
    effects: Mapping[int, tuple[AddedEffect, ...]]


def unseen_error(whitening: Whitening, fit: Refit) -> UnseenError:
    """Cross-validate the effects of a fit over the runs of a campaign."""

    def fitted(keep: BoolArray) -> tuple[AddedEffect, ...]:
        readings = whitening.observations.select(keep)
        return refit(Whitening.granting(readings, whitening.noise), fit.restart).effects

    return cross_validated(whitening, fitted)


def cross_validated(whitening: Whitening, fitted: Callable[[BoolArray], tuple[AddedEffect, ...]]) -> UnseenError:
    """The error on each run by the effects that are fitted to the readings that stay, which have the shape (M,)."""
    observations = whitening.observations
    group = left_out_groups(observations)
    as_read = np.zeros(len(group))
    chi2, effects = 0.0, {}
    for number in np.unique(group):
        out = group == number
        unseen, effects[int(number)] = observations.select(out), fitted(~out)
        as_read[out] = unseen.value - unseen.predict(effects[int(number)])
        white = Whitening(unseen, whitening.noise).full(as_read[out])
        chi2 += float(white @ white)
    return UnseenError(observations.rms(as_read), chi2, effects)


def left_out_groups(observations: Observations) -> IntArray:
    """The run of each reading, shape (M,); with a single run, four stretches of it."""
    run = observations.column("run").astype(int)
    if len(np.unique(run)) > 1:
        return run
    order: FloatArray = observations.column("order")
    return np.asarray(np.searchsorted(np.quantile(order, [0.25, 0.5, 0.75]), order))


@dataclass(frozen=True, eq=False)
class CheckedRefit:
    """A refit, its error on runs left out, and what was held."""

    fit: Refit
    error: UnseenError
    findings: tuple[Finding, ...] = ()


def checked_refit(whitening: Whitening, start: Sequence[Start]) -> CheckedRefit:
    """A refit of what the data show: without amplitudes that they do not identify, and without extrapolated ends."""
    fit = refit(whitening, start)
    for values_of in (_unsettled, _unidentified):
        held = values_of(whitening.observations, fit)
        if any(held):
            restart = zip(fit.restart, held, strict=True)
            fit = refit(whitening, [replace(effect, held={**effect.held, **values}) for effect, values in restart])
    slow = [
        effect.name
        for effect in fit.start
        if any(p.name in effect.held for p in effect.columns.effect.parameters if p.nonlinear)
    ]
    findings = tuple(finding("not-settled", name=name) for name in slow)
    return CheckedRefit(fit, unseen_error(whitening, fit), findings)


def _unsettled(observations: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect time constants of the circuit that are longer than the runs, held at these.

    The new model runs with the end of such a change. A fit to its beginning says only its rate, and would put an end
    into the circuit that nobody has seen.
    """
    clock = observations.column("time_s" if "time_s" in observations.covariates else "order")
    longest = float(clock.max()) / SETTLED
    held: list[dict[str, float]] = [{} for _ in fit.effects]
    for k, p in fit.free:
        added = fit.effects[k]
        slow = p.nonlinear and p.name.endswith("_time") and added.parameters[p.name] > longest
        if slow and added.effect.circuit is not None:
            held[k] = {p.name: max(longest, p.lower)}
    return held


def _unidentified(_: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect the amplitudes that the data do not identify, held at their nulls; one stays free at least.

    Their interval holds the null and more than their plausible range.
    """
    held: list[dict[str, float]] = []
    for start, added in zip(fit.start, fit.effects, strict=True):
        free = [p for p in start.columns.amplitudes if p.name not in start.held]
        limits = [(p, *added.ci95.get(p.name, (np.nan, np.nan))) for p in free]
        vague = {p.name: p.null for p, low, high in limits if low < p.null < high and high - low > p.width}
        held.append(vague if len(vague) < len(free) else {})
    return held


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

    @property
    def accepted(self) -> bool:
        """Whether nothing of it is worse with the effects than without."""
        return not (self.less_likely or any(change.worse for change in self.unread.values()))

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
        single=observations.runs == 1,
        mean_square=(squares[0], squares[1]),
        less_likely=less_likely(gain),
        gain=mean,
        gain_error=error,
        unread=unread_changes(beside, unknowing),
    )


def less_likely(gain: FloatArray) -> bool:
    """Whether the innovations of the second filter are less likely: in the mean, and in more blocks than chance gives.

    The mean alone is that of the few blocks in which a filter is lost for a moment, whatever the model.
    """
    means = _block_means(gain)
    return bool(means.mean() < 0.0 and -np.sign(means).sum() > FILTER_CHANCE * np.sqrt(len(means)))


def unread_changes(pairs: Sequence[_Pair], unknowing_m: float) -> dict[str, Change]:
    """Of channels that no filter read, where both filters ran through and one at least knew the distance.

    Parameters
    ----------
    unknowing_m : float
        Error of a distance of which only the travel is known, in m.
    """
    ran = [pair for pair in pairs if all(not score.broke_down for score in pair)]
    ran = [
        pair for pair in ran if min(_rms(score.unread.get("distance_m", np.zeros(1))) for score in pair) <= unknowing_m
    ]
    result = {}
    for name in sorted({name for pair in ran for name in pair[0].unread}):
        squares = [np.concatenate([pair[k].unread[name] for pair in ran]) ** 2 for k in (0, 1)]
        if not np.isfinite(squares[0] + squares[1]).any():  # both claim to be blind throughout
            continue
        mean, error = _mean(squares[1] - squares[0])
        sizes = [float(np.sqrt(np.nanmean(square))) for square in squares]
        worse = mean > FILTER_WORSE * error and sizes[1] > FILTER_GREW * sizes[0]
        result[name] = Change(sizes[0], sizes[1], worse=worse)
    return result


def _rms(error: FloatArray) -> float:
    """Root mean square; zero where there is no number, since the filter claims to be blind throughout."""
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
    rows = series.rows
    if observations.runs == 1:
        return _rows(series, 4 * np.arange(len(rows)) // len(rows) == group)
    label = observations.column("run_label")[observations.column("run").astype(int) == group][0]
    return _rows(series, (rows["run"] == label).to_numpy())


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
