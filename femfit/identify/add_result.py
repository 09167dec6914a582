"""What adding effects to a model says: the new model, the effects' sizes, whether they are plausible, and the error."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.effects.words import titled, titles_of
from femfit.identify.constants import HARMS, LEAST_CHANGE
from femfit.identify.lack_of_fit import LackOfFit, pattern_space
from femfit.identify.left_out import FilterFall
from femfit.identify.misfit import ErrorFall, error_fall
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, at_bounds, is_plausible
from femfit.identify.words import Result, plain, printed, sentence
from femfit.model.actuator_model import ActuatorModel


@dataclass(frozen=True)
class EffectSize:
    """What an added effect changes of one channel, where it changes it most within the data."""

    effect: str
    channel: str
    change: float
    ci95: tuple[float, float]
    # ``change`` over the largest magnitude that the base predicts for this channel; None where it predicts nothing
    of_largest: float | None
    distance_m: float
    current_A: float

    def __str__(self) -> str:
        return sentence("add", "size", self)


def effect_sizes(observations: Observations, fit: Refit) -> tuple[EffectSize, ...]:
    """The largest change that each effect makes of each channel within the data, with its 95 % interval."""
    slopes = observations.slopes(fit.effects, [(k, p.name) for k, p in fit.free]) * [p.width for _, p in fit.free]
    result = list[EffectSize]()
    for k, added in enumerate(fit.effects):
        # What the predictions gain by the effect, the others in place
        change = observations.predict(fit.effects) - observations.predict(fit.effects[:k] + fit.effects[k + 1 :])
        fitted = [j for j, (number, _) in enumerate(fit.free) if number == k and not fit.active[j]]
        covariance = fit.covariance[np.ix_(fitted, fitted)]
        result += largest_changes(added.effect.name, observations, change, slopes[:, fitted], covariance)
    return tuple(result)


def largest_changes(
    effect: str, observations: Observations, change: FloatArray, slopes: FloatArray, covariance: FloatArray
) -> Iterator[EffectSize]:
    """The largest change, (M,), of each channel within the data, with its interval.

    The interval follows from the change's slopes by what was fitted, (M, p), and the covariance of that, (p, p).
    """
    weight = np.ones_like(change) if observations.weight is None else observations.weight
    change, base = change / weight, observations.base / weight
    for c, channel in enumerate(observations.channels):
        here = np.flatnonzero(observations.channel == c)
        largest = float(np.abs(base[here]).max(initial=0.0))
        place = int(here[np.argmax(np.abs(change[here]))]) if len(here) else -1
        if place < 0 or abs(change[place]) < LEAST_CHANGE * largest:
            continue
        variance = max(float(slopes[place] @ covariance @ slopes[place]), 0.0)
        half = stats.norm.isf(0.025) * np.sqrt(variance) / weight[place]
        yield EffectSize(
            effect=effect,
            channel=channel,
            change=float(change[place]),
            ci95=(float(change[place] - half), float(change[place] + half)),
            of_largest=float(change[place]) / largest if largest else None,
            distance_m=float(observations.column("distance_m")[place]),
            current_A=float(observations.column("current_A")[place]),
        )


def suspicious_values(observations: Observations, fit: Refit, sizes: tuple[EffectSize, ...]) -> tuple[str, ...]:
    """What is unusual of fitted parameters, one sentence each."""
    nominal = observations.nominal
    unusual = [
        (a, _clocked(p, observations)) for a in fit.effects for p in a.effect.parameters if not is_plausible(a, p)
    ]
    ends = [(fit.effects[k], _clocked(p, observations)) for k, p in at_bounds(fit)]
    absent = [name for name in fit.names if all(s.ci95[0] <= 0.0 <= s.ci95[1] for s in sizes if s.effect == name)]
    text = printed("suspicious", fit=fit, unusual=unusual, ends=ends, absent=absent, nominal=nominal, alone=_alone)
    return tuple(text.splitlines())


def _clocked(p: EffectParameter, observations: Observations) -> EffectParameter:
    """A time with the unit that these data count it in."""
    unit = "s" if "time_s" in observations.given else "readings"
    return replace(p, unit=unit) if p.unit == "readings or s" else p


def _alone(added: AddedEffect, p: EffectParameter) -> AddedEffect:
    """An effect with one of its parameters alone."""
    return AddedEffect(added.effect, added.effect.null() | {p.name: added.parameters[p.name]})


@dataclass(frozen=True)
class Step:
    """One bar of the waterfall: what was added, and the error per channel with it and everything before it."""

    text: str
    rms: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class AddResult(Result):
    """Effects added to a model; printed, it is what ``femfit add`` prints.

    Parameters
    ----------
    model : ActuatorModel
        With the effects, ready to be written.
    added : tuple of AddedEffect
        The effects that were fitted, in order, with 95 % intervals.
    kept : tuple of str
        Effects that the model had before and that these data cannot refit.
    fall : ErrorFall
        Error before and after, over all readings.
    left_out : mapping of str to float
        Root mean square per channel on readings that were not fitted: each run in turn, or quarters of a single run.
    floor : mapping of str to float
        Standard deviation of one reading, in the channels in which it is known.
    steps : tuple of Step
        From the model as it was to the last effect.
    suspicious : tuple of str
        What is unusual of the fitted parameters, one sentence each.
    observations : Observations
        The readings beside the model without what was refitted.
    beyond_noise : mapping of str to float
        Channels whose error after is more than 1.2 times what declared noise, or repeats, show, in times the noise.
    filter : FilterFall or None
        What it does to the filter on runs of a record that were left out; None of a bench table.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "core_saturation")
    >>> force = better.fall.channels[0]
    >>> force.rms_after < force.rms_before
    True
    """

    data = (
        *("added", "kept", "left_out", "floor", "floor_source", "readings", "runs", "steps", "sizes"),
        *("suspicious", "lack_of_fit_before", "lack_of_fit_after", "findings", "accepted", "beyond_noise", "filter"),
    )

    model: ActuatorModel
    added: tuple[AddedEffect, ...]
    kept: tuple[str, ...]
    fall: ErrorFall
    left_out: Mapping[str, float]
    floor: Mapping[str, float]
    floor_source: Mapping[str, str]
    steps: tuple[Step, ...]
    sizes: tuple[EffectSize, ...]
    suspicious: tuple[str, ...]
    lack_of_fit_before: LackOfFit
    lack_of_fit_after: LackOfFit
    readings: int
    runs: int
    observations: Observations
    findings: tuple[Finding, ...] = ()
    beyond_noise: Mapping[str, float] = field(default_factory=dict)
    filter: FilterFall | None = None

    @property
    def accepted(self) -> bool:
        """Whether the effects help on runs left out: the error falls somewhere, and no filter there is worse."""
        helps = any(HARMS * self.left_out[channel.channel] < channel.rms_before for channel in self.fall.channels)
        return (helps or not self.risen) and (self.filter is None or self.filter.accepted)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        temperatures = ("coil_temperature_C", "magnet_temperature_C")
        further = {"error_fall": plain(self.fall), **{name: getattr(self.model, name) for name in temperatures}}
        return super().to_dict() | further

    @property
    def risen(self) -> tuple[str, ...]:
        """Channels whose error on runs left out is larger than before."""
        channels = self.fall.channels
        return tuple(c.channel for c in channels if self.left_out[c.channel] > HARMS * c.rms_before)

    def __str__(self) -> str:
        rms, magnitude = self.fall.rms_after, self.observations.magnitude
        facts = {"r": self, "rms": rms, "magnitude": magnitude, "beyond": self.beyond_noise}
        return titled(printed("add", **facts), titles_of(self.observations.nominal.drawn))


def fit_facts(
    whitening: Whitening, stages: Sequence[tuple[str, Sequence[AddedEffect]]], fitted: FloatArray | None
) -> dict[str, Any]:
    """The fields of a result that follow from the readings and the effects of each stage, the model's own first.

    Parameters
    ----------
    fitted : array, shape (M, k), or None
        Whitened columns of what the last stage was fitted by.
    """
    observations, noise = whitening.observations, whitening.noise
    predictions = [observations.predict(effects) for _, effects in stages]
    misfits = [observations.value - prediction for prediction in predictions]
    patterns = pattern_space(whitening)
    return {
        "fall": error_fall(observations, predictions[0], predictions[-1], noise.known),
        "floor": noise.known,
        "floor_source": noise.source,
        "steps": tuple(Step(text, observations.rms(misfit)) for (text, _), misfit in zip(stages, misfits, strict=True)),
        "lack_of_fit_before": patterns.test(whitening.full(misfits[0])),
        "lack_of_fit_after": patterns.test(whitening.full(misfits[-1]), fitted),
        "readings": len(observations.value),
        "runs": len(np.unique(observations.column("run"))),
        "observations": observations,
    }
